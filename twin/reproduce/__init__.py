"""Reproductions of published tables and figures, theirs beside ours: what `twin reproduce` runs."""
