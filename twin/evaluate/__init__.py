"""How well a tracker did, in metres: figures from a table of truth and a table of tracks."""

from twin.evaluate.continuity import Event
from twin.evaluate.occlusion import Occlusion, long_occlusions
from twin.evaluate.summary import Evaluation, evaluate_tracks, evaluate_with_details

__all__ = ["Evaluation", "Event", "Occlusion", "evaluate_tracks", "evaluate_with_details", "long_occlusions"]
