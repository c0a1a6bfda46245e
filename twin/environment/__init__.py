"""Scan of the empty room, and the environment that trackers get from it."""
