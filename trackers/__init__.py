"""Trackers of people: what a user would put on a real robot; nothing here knows of the twin.

Observations and the rig go in (`trackers.observations`, `trackers.rig`), tracks come out (`trackers.tracks`).
"""
