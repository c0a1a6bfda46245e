"""Evaluation of trackers: metrics from a table of truth and a table of tracks, in metres."""

from twin.evaluate.causes import Occlusion, long_occlusions
from twin.evaluate.continuity import Event
from twin.evaluate.summary import Evaluation, evaluate_tracks, evaluate_with_details

__all__ = ["Evaluation", "Event", "Occlusion", "evaluate_tracks", "evaluate_with_details", "long_occlusions"]
