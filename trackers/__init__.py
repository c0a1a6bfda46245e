"""Trackers of people, as used on a real robot, independent of the twin.

Input: observations and the rig (`trackers.observations`, `trackers.rig`); output: tracks (`trackers.tracks`).
"""

DISTRIBUTION = "roomtwin"
"""Distribution of this package: others have a package of the same name, and installers overwrite it."""
