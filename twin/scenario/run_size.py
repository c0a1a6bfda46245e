"""Size of a run, estimated in advance and limited against mistakes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

from trackers.user_input.text_file import refuse_unless_lifted
from twin.messages import counted
from twin.scenario.camera_descriptions import PinholeDescription, StereoDescription
from twin.scenario.sensor_descriptions import AnyDescription, FisheyeDescription, FloorDescription

if TYPE_CHECKING:
    from twin.scenario.scenario import Scenario

MOST_PEOPLE = 1000
MOST_BYTES = 20e9
"""Size of a recording."""
MOST_PIXELS = 2**24
"""Pixels of one picture: rendering more takes gigabytes."""
MOST_HELD_BYTES = 1e9
"""Size of the pictures of the empty room, held in memory together."""

_HEADER_BYTES = 60.0
_CAMERA_INFO_BYTES = 360.0
_TRUTH_BYTES = 1800.0
"""Size of one person at one stamp: in the bag under /truth, and in the tables."""
_JPEG_BYTES_PER_PIXEL = 0.25
_DEPTH_BYTES_PER_PIXEL = 0.77


@dataclass(frozen=True)
class RunSize:
    """Size of a run: simulated seconds, people, observations, about how many bytes; of several, `people` is the most."""

    seconds: float = 0.0
    people: int | None = 0
    """None where they are not known, as in a bag."""
    observations: int = 0
    n_bytes: float = 0.0
    of_several: bool = False

    def __str__(self) -> str:
        n = self.people
        people = "" if n is None else f"{'at most ' * self.of_several}{counted(n, 'person', 'people')}, "
        looks = counted(self.observations, "observation", "observations")
        return f"{self.seconds:g} s, {people}{looks}, about {_bytes(self.n_bytes)}"


def size_of(scenario: Scenario, *, images: bool = True) -> RunSize:
    """Estimate the size of a run from measurements of shipped scenarios: bytes within a factor of about two."""
    observations, n_bytes, most_looks = 0, 0.0, 0
    for sensor in scenario.sensors.values():
        if _pixels(sensor) and not images:
            continue
        looks = max(0, ceil((scenario.duration_s - sensor.phase_s) * sensor.rate_hz))
        frames = scenario.background_frames if scenario.background == "captured" else 0
        most_looks = max(most_looks, looks)
        observations += looks
        n_bytes += (looks + frames) * _bytes_of_a_look(sensor)
    n_bytes += most_looks * len(scenario.people) * _TRUTH_BYTES
    return RunSize(scenario.duration_s, len(scenario.people), observations, n_bytes)


def total(sizes: Iterable[RunSize]) -> RunSize:
    """Sum the sizes of runs, with the largest number of people."""
    sizes = list(sizes)
    return RunSize(
        sum(each.seconds for each in sizes),
        max((each.people for each in sizes if each.people is not None), default=None if sizes else 0),
        sum(each.observations for each in sizes),
        sum(each.n_bytes for each in sizes),
        of_several=len(sizes) > 1,
    )


def check_size(scenario: Scenario, *, images: bool = True, source: str | None = None) -> None:
    """Raise InputError for an implausibly large run: people, bytes, pixels.

    `source`: start of the sentence; None: the scenario's name.
    """
    size = size_of(scenario, images=images)
    refuse = _refuser(source or scenario.source)
    if len(scenario.people) > MOST_PEOPLE:
        refuse("people", f"{len(scenario.people)} are there", f"at most {MOST_PEOPLE}")
    for name, sensor in scenario.sensors.items():
        if images and _pixels(sensor) > MOST_PIXELS:
            refuse(f"sensors.{name}", f"a picture has {_pixels(sensor)} pixels", f"at most {MOST_PIXELS}")
    held = sum(3.0 * _pixels(sensor) for sensor in scenario.sensors.values()) * scenario.background_frames
    if images and scenario.background == "captured" and held > MOST_HELD_BYTES:
        refuse(
            "background_frames",
            f"{scenario.background_frames} pictures of the empty room by every camera are {_bytes(held)} in memory",
            f"at most {_bytes(MOST_HELD_BYTES)}",
        )
    if size.n_bytes > MOST_BYTES:
        refuse("duration_s", f"the recording would be {size}", f"at most {_bytes(MOST_BYTES)}")


def _refuser(source: str) -> Callable[[str, str, str], None]:
    def refuse(field: str, what: str, valid: str) -> None:
        refuse_unless_lifted(f"{source}: {field}: {what}", valid)

    return refuse


def _pixels(sensor: AnyDescription) -> int:
    """Count the pixels of a sensor's picture; 0 without one."""
    if isinstance(sensor, FisheyeDescription | PinholeDescription | StereoDescription):
        lens = sensor.intrinsics()
        return lens.width * lens.height
    return 0


def _bytes_of_a_look(sensor: AnyDescription) -> float:
    pixels = _pixels(sensor)
    if pixels:
        per_pixel = _JPEG_BYTES_PER_PIXEL + isinstance(sensor, StereoDescription) * _DEPTH_BYTES_PER_PIXEL
        return _HEADER_BYTES + _CAMERA_INFO_BYTES + pixels * per_pixel
    if isinstance(sensor, FloorDescription):
        return _HEADER_BYTES + sensor.rows * sensor.columns
    return _HEADER_BYTES + 4.0 * getattr(sensor, "n_beam", 0)


def _bytes(count: float) -> str:
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count / 1e3:.3g} kB"
