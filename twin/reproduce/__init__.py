"""Published figures and tables again, theirs beside ours: what `twin reproduce` runs."""
