"""Many scenarios, seeds and trackers at once, on every core or a cluster, and whether anything got worse."""
