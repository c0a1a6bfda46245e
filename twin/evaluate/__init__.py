"""Evaluation of trackers: metrics from a table of truth and a table of tracks, in metres.

py-motmetrics and TrackEval, against which tests hold the metrics, are not used: errors are followed from the matches of each
frame to their causes.
"""

from twin.evaluate.causes import PersonOcclusion, long_occlusions
from twin.evaluate.continuity import TrackEvent
from twin.evaluate.summary import Evaluation, evaluate_tracks, evaluate_with_details

__all__ = ["Evaluation", "PersonOcclusion", "TrackEvent", "evaluate_tracks", "evaluate_with_details", "long_occlusions"]
