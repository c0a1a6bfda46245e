"""Loads on the floor and steps of the twin's people, beside published data."""
