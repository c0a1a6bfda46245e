"""Trackers of people: what a user would put on a real robot; nothing here knows of the twin.

Observations and the rig go in (`trackers.observations`, `trackers.rig`), tracks come out (`trackers.tracks`).
"""

DISTRIBUTION = "roomtwin"
"""Distribution that this package belongs to: others have a package of the same name, and installers overwrite it."""
