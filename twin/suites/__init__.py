"""Suites: many scenarios, seeds and trackers, on every core or a cluster, compared with a baseline."""
