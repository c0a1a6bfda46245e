"""The subcommands of `twin` that are no room's own: what each does lives elsewhere and is imported when it is asked for."""
