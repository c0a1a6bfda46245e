"""Pictures and pages: the preview video, the HTML report, and the bird's-eye drawing they share."""
