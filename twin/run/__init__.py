"""Runs of scenarios and replays of recordings, and their folder of results."""
