"""Evaluation of trackers: metrics from a table of truth and a table of tracks, in metres."""

from twin.evaluate.causes import PersonOcclusion, long_occlusions
from twin.evaluate.continuity import TrackEvent
from twin.evaluate.summary import Evaluation, evaluate_tracks, evaluate_with_details

__all__ = ["Evaluation", "PersonOcclusion", "TrackEvent", "evaluate_tracks", "evaluate_with_details", "long_occlusions"]
