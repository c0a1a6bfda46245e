"""Subcommands of `twin`: arguments and help; the work is imported when a command runs."""
