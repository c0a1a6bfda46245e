"""Runs of scenarios, replays of recordings, and their folder of results."""
