"""Truth details on their way out: into the folder of a run as tables, into its bag as strings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from twin.recording import topics
from twin.recording.boxes import box_writer, encode_boxes
from twin.recording.rays import encode_rays, ray_writer
from twin.recording.situations import encode_situation, situation_writer
from twin.truth.frames import BoxFrame, RayFrame, Situation, TruthDetail

DETAIL_FILES = ("truth_boxes.csv", "truth_rays.csv", "truth_situations.csv")
DETAIL_TOPICS = (topics.TRUTH_BOXES, topics.TRUTH_RAYS, topics.TRUTH_SITUATIONS)


@contextmanager
def detail_writer(folder: Path) -> Iterator[Callable[[TruthDetail], None]]:
    """A function that takes details and writes each into its table; the files are there when the block has ended well.

    Raises InputError where a file cannot be written.
    """
    with ExitStack() as stack:
        box_file, ray_file, situation_file = (folder / name for name in DETAIL_FILES)
        boxes = stack.enter_context(box_writer(box_file))
        rays = stack.enter_context(ray_writer(ray_file))
        situations = stack.enter_context(situation_writer(situation_file))

        def write(detail: TruthDetail) -> None:
            match detail:
                case BoxFrame():
                    boxes.write(detail)
                case RayFrame():
                    rays.write(detail)
                case Situation():
                    situations.write(detail)

        yield write


def encode_detail(detail: TruthDetail) -> tuple[str, int, memoryview]:
    """Where a detail goes in a bag: its topic, its log time [ns] (a situation's is its end), its message (CDR)."""
    match detail:
        case BoxFrame():
            return topics.TRUTH_BOXES, detail.stamp_ns, encode_boxes(detail)
        case RayFrame():
            return topics.TRUTH_RAYS, detail.stamp_ns, encode_rays(detail)
        case Situation():
            return topics.TRUTH_SITUATIONS, detail.end_ns, encode_situation(detail)
