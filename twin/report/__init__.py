"""Pictures and pages of a run: preview video, HTML report, and their common bird's-eye drawing."""
