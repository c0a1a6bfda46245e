"""Trackers by name: the published systems' variants, plug-ins by `module:Class`, and installed entry points.

Nothing heavy is imported until a tracker is made.
"""

from __future__ import annotations

import importlib
import inspect
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import metadata
from typing import TYPE_CHECKING, Any

from trackers.camera_floor_particle import rules as floor_rules
from trackers.errors import InputError, check_no_path, valid_names
from trackers.laser_fisheye_imm.rules import PAPER_RULES, paper_options
from trackers.laser_vision_learning import rules as learning_rules
from trackers.paper_rules import PaperRule
from trackers.rgbd_head import rules as head_rules
from trackers.user_input.plain_data import deep_merge

if TYPE_CHECKING:
    import numpy as np
    from pydantic import BaseModel

    from trackers.observations import Observation
    from trackers.rig import Rig
    from trackers.tracks import Tracker

entry_points = lru_cache(metadata.entry_points)
"""Installed entry points, by group: what is installed stays so for a process."""

ENTRY_POINT_GROUP = "roomtwin.trackers"


@dataclass(frozen=True)
class Preset:
    """A tracker class with options: what a name stands for. `target` is `module:Class`; `rules`: a paper's own.

    needs: options that state what a paper takes as known, and what each states.
    """

    target: str
    description: str
    citation: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    rules: tuple[PaperRule, ...] = ()
    needs: Mapping[str, str] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """The description, with the options that the preset needs."""
        return "; ".join([self.description, *(f"needs `{option}`: {what}" for option, what in self.needs.items())])


_BAI = "Bai, Takahashi: Identification and Tracking Using Laser and Vision of Maneuvering People (Doshisha University)"
_SONG = (
    "Song, Zhao, Cui, Shao, Shibasaki, Zha: Fusion of Laser and Vision for Multiple Targets Tracking via On-line Learning "
    "(Peking University, University of Tokyo)"
)
_MORI = (
    "Mori, Matsumoto, Shimosaka, Noguchi, Sato: Multiple Persons Tracking with Data Fusion of Multiple Cameras "
    "and Floor Sensors Using Particle Filters (M2SFA2 2008)"
)
_SUZUKI = (
    "Suzuki, Iwasaki, Kobayashi, Sato, Sugimoto: "
    "Incorporating Environment Models for Improving Vision-Based Tracking of People (Systems and Computers in Japan 38, 2007)"
)
_HEADS = "trackers.rgbd_head.tracker:RgbdHead"
_START = {"start": "where each head is at a time, and faces"}
_CAMERA_FLOOR = "trackers.camera_floor_particle.tracker:CameraFloorParticle"
_CLUSTERS = "trackers.camera_floor_particle.baseline:ClusterKalman"
_LASER_LEARNING = "trackers.laser_vision_learning.tracker:LaserVisionLearning"
_LASER_FISHEYE = "trackers.laser_fisheye_imm.tracker:LaserFisheyeImm"

_PAPER_SENSORS = {
    "laser-fisheye": "both layers and the camera",
    "waist-fisheye": "the waist layer and the camera",
    "laser": "both layers without the camera",
}

PRESETS: Mapping[str, Preset] = {
    "fusion": Preset(
        "trackers.fusion.tracker:Fusion",
        "whatever a rig has: scanners, cameras, stereo cameras, pressure floors, each at its own stamp; bodies and heads",
        "Mušicki, Evans, Stanković: Integrated probabilistic data association (1994), here with every kind of sensor",
    ),
    "laser-fisheye-imm": Preset(
        _LASER_FISHEYE,
        "two laser layers and a fisheye camera, IMM of three motion models: the paper's full system",
        _BAI,
    ),
    "laser-imm": Preset(
        _LASER_FISHEYE, "the same without a camera; runs on a single scanner too", _BAI, {"camera": False}
    ),
    "waist-fisheye-imm": Preset(
        _LASER_FISHEYE, "the waist scanner and the camera alone, IMM", _BAI, {"layers": ("waist",)}
    ),
    "laser-fisheye-kalman": Preset(
        _LASER_FISHEYE,
        "the full sensor set, one motion model instead of three: a Kalman filter",
        _BAI,
        {"filter": "kalman"},
    ),
    "laser-kalman": Preset(
        _LASER_FISHEYE, "two laser layers without a camera, Kalman filter", _BAI, {"filter": "kalman", "camera": False}
    ),
    "waist-fisheye-kalman": Preset(
        _LASER_FISHEYE,
        "the waist scanner and the camera alone, Kalman filter",
        _BAI,
        {"filter": "kalman", "layers": ("waist",)},
    ),
    **{
        f"{sensors}-{filter_}-paper": Preset(
            _LASER_FISHEYE,
            f"by the rules of Bai and Takahashi alone: {described}, {'IMM' if filter_ == 'imm' else 'Kalman filter'}",
            _BAI,
            paper_options(waist_only=sensors[0] == "w", camera=sensors != "laser", kalman=filter_ == "kalman"),
            PAPER_RULES,
        )
        for sensors, described in _PAPER_SENSORS.items()
        for filter_ in ("imm", "kalman")
    },
    "laser-vision-learning": Preset(
        _LASER_LEARNING,
        "the points of low scanners while people are apart, classifiers of a camera's patches learned on-line when they meet",
        _SONG,
    ),
    "laser-vision-learning-laser": Preset(
        _LASER_LEARNING,
        "every knee scanner's points, a particle filter per person with a two-feet walking model: the laser half",
        _SONG,
        {"camera": False},
    ),
    "laser-vision-learning-vision": Preset(
        "trackers.laser_vision_learning.vision_only.tracker:VisionOnly",
        "one camera alone: background subtraction, a learned detector of people, a particle filter per person",
        "Song, Cui, Zha, Zhao: Probabilistic Detection-Based Particle Filter for Multi-target Tracking (BMVC 2008)",
    ),
    "laser-vision-learning-paper": Preset(
        _LASER_LEARNING,
        "the fused system by the paper's rules alone",
        _SONG,
        learning_rules.PAPER,
        learning_rules.PAPER_RULES,
    ),
    "laser-vision-learning-paper-laser": Preset(
        _LASER_LEARNING,
        "the paper's laser half: one time for all who are missing",
        _SONG,
        learning_rules.PAPER_LASER,
        learning_rules.LASER_RULES,
    ),
    "laser-vision-learning-paper-vision": Preset(
        "trackers.laser_vision_learning.vision_only.tracker:VisionOnly",
        "the paper's baseline by one camera alone",
        "Song, Cui, Zha, Zhao: Probabilistic Detection-Based Particle Filter for Multi-target Tracking (BMVC 2008)",
        learning_rules.PAPER_VISION,
        learning_rules.VISION_RULES,
    ),
    "sort": Preset(
        "trackers.sort:Sort",
        "every scanner's clusters fused, a Kalman filter per person, optimal assignment: the plain baseline",
        "Bewley, Ge, Ott, Ramos, Upcroft: Simple Online and Realtime Tracking (2016), here on the ground plane",
    ),
    "laser-legs": Preset(
        "trackers.laser_legs.tracker:LaserLegs",
        "low scanners that stand or drive: a learned classifier of legs, scan matching, a map, existence by evidence",
        "Arras, Martínez Mozos, Burgard: Using Boosted Features for the Detection of People in 2D Range Data (2007)",
    ),
    "camera-floor-particle": Preset(
        _CAMERA_FLOOR,
        "body and head of each person in 3-D by cameras and a pressure floor, a pair of particle filters each",
        _MORI,
    ),
    "camera-floor-particle-paper": Preset(
        _CAMERA_FLOOR,
        "by the rules of Mori and others alone: body and head by cameras and a pressure floor",
        _MORI,
        floor_rules.PAPER,
        floor_rules.PAPER_RULES,
    ),
    "camera-floor-particle-floor": Preset(
        _CAMERA_FLOOR, "the same by the floor alone, without any picture", _MORI, floor_rules.FLOOR_ONLY
    ),
    "camera-floor-particle-colour": Preset(
        _CAMERA_FLOOR, "the same by the cameras alone; the floor only detects", _MORI, floor_rules.COLOUR_ONLY
    ),
    "camera-floor-particle-no-exclusion": Preset(
        _CAMERA_FLOOR,
        "the same without the exclusion of particles of different persons",
        _MORI,
        floor_rules.NO_EXCLUSION,
    ),
    "camera-floor-particle-no-mixture": Preset(
        _CAMERA_FLOOR, "the same without head particles drawn about the body", _MORI, floor_rules.NO_MIXTURE
    ),
    "rgbd-head": Preset(
        _HEADS,
        "heads in 3-D, place and direction, by stereo cameras and a model of the room, a particle filter each",
        _SUZUKI,
    ),
    **{
        f"rgbd-head-paper{suffix}": Preset(_HEADS, description, _SUZUKI, options, rules, _START)
        for suffix, description, options, rules in (
            ("", "the same by the paper's cues alone", head_rules.PAPER, head_rules.PAPER_RULES),
            ("-colour", "the paper's by colours and the room alone", head_rules.COLOUR, ()),
            ("-depth", "the paper's by distances and the room alone", head_rules.DEPTH, ()),
            ("-no-environment", "the paper's without the model of the room", head_rules.NO_ENVIRONMENT, ()),
        )
    },
    "floor-kalman": Preset(
        _CLUSTERS,
        "clusters of a pressure floor, a Kalman filter per person, nearest neighbours: the naive baseline",
        "Kalman (1960); nearest neighbours by optimal assignment",
    ),
    "floor-colour-kalman": Preset(
        _CLUSTERS,
        "the same with the colours that cameras see over each cluster",
        "Kalman (1960); nearest neighbours by optimal assignment",
        {"colour": 1.0},
    ),
}


def rules_of(name: str) -> tuple[PaperRule, ...]:
    """Return the table of a paper's own system. Raises InputError for a name without one, naming those that have one."""
    found = available().get(name)
    if found is None or not found.rules:
        having = valid_names(name, [each for each, preset in PRESETS.items() if preset.rules])
        raise InputError(f"--rules {name}: no table of a paper's rules has this name; {having}")
    return found.rules


def options_of(name: str) -> tuple[type[BaseModel], Mapping[str, Any]]:
    """Return the model of a tracker's options, and the values that the preset sets. Raises InputError for one without a model."""
    known = available()
    if name not in known and ":" not in name:
        raise InputError(
            f"--options {name}: there is no tracker {name!r}; {valid_names(name, known, ', or module:Class')}"
        )
    preset = known.get(name, Preset(name, ""))
    model = getattr(_load(preset.target, name), "Options", None)
    if model is None:
        raise InputError(
            f"--options {name}: the class names no model of its options; a field `Options` of it is expected"
        )
    return model, preset.options


def available() -> dict[str, Preset]:
    """Every tracker that has a name: the presets, then the installed entry points of `roomtwin.trackers`."""
    installed = {
        point.name: Preset(
            point.value, f"plug-in installed by {point.dist.name if point.dist else 'an unnamed package'}"
        )
        for point in entry_points(group=ENTRY_POINT_GROUP)
    }
    return {**installed, **PRESETS}


def make_tracker(
    name: str,
    rig: Rig,
    background: Iterable[Observation] = (),
    rng: np.random.Generator | None = None,
    options: Mapping[str, Any] | None = None,
) -> Tracker:
    """Make the tracker `name` (a preset, an entry point or `module:Class`) for a rig, ready to be fed.

    background: observations of the empty room, or a `trackers.prior.Prior`, which the tracker is handed in any
    case; rng: the tracker's own generator; options: merged over the preset's, at every depth. Raises InputError for a name,
    module, class or option that does not exist. What is imported here runs: callers refuse names that a file holds.
    """
    from trackers.prior import Prior
    from trackers.rig import check_arguments

    check_arguments(rig, name=name, background=background, rng=rng, options=options)
    known = PRESETS if name in PRESETS else available()  # what is installed is looked up where it is asked for
    check_no_path(name, f"tracker {name!r}")
    if name in known:
        preset = known[name]
    elif ":" in name:
        preset = Preset(name, "")
    else:
        also = ", or a class of yours as module:Class"
        raise InputError(f"tracker {name!r} is unknown; {valid_names(name, known, also, start='valid ones are')}")
    maker = _load(preset.target, name)
    given = deep_merge(preset.options, _with_current_names(maker, options or {}, name))
    try:
        return maker(rig, Prior.of(background), rng, **given)
    except InputError as error:  # a class calls itself by one name, or none
        named = re.sub(r"^(tracker [\w-]+: )?", f"tracker {name}: ", str(error), flags=re.MULTILINE)
        raise InputError(named) from error
    except TypeError as error:
        if error.__traceback__ is None or error.__traceback__.tb_next is not None:
            raise  # from within the class
        raise InputError("\n".join(_unfit_call(maker, name, given, error))) from error


def _with_current_names(maker: Any, options: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return options with the current names of those that were renamed, where the class says by `Options` which it takes."""
    from trackers.user_input.former_options import checked_current_names

    model = getattr(maker, "Options", None)
    return options if model is None else checked_current_names(model, dict(options), f"tracker {name}")


def _unfit_call(maker: Any, name: str, options: Mapping[str, Any], error: TypeError) -> Iterator[str]:
    """Name the options that the class does not take; else return Python's message."""
    takes = list(inspect.signature(maker).parameters.values())[3:]
    valid = [each.name for each in takes if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]
    unknown = [option for option in options if option not in valid]
    if any(each.kind is each.VAR_KEYWORD for each in takes) or not unknown:
        called = f"{getattr(maker, '__name__', name)}(rig, background, rng, **options)"
        yield f"tracker {name!r}: {error}; a class made as {called} is expected"
        return
    for option in unknown:
        instead = valid_names(option, valid, start="valid here:", none="none, as it takes no options")
        yield f"tracker {name!r}: {option}: unknown key; {instead}"


def _load(target: str, name: str) -> Any:
    module_name, _, class_name = target.partition(":")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        # a module that the plug-in itself fails to import is its fault, and stays loud
        if error.name is None or not (module_name == error.name or module_name.startswith(f"{error.name}.")):
            raise
        raise InputError(
            f"tracker {name!r}: there is no module {error.name!r}, installed or in {os.getcwd()}; module:Class is expected"
        ) from error
    except ValueError as error:  # an empty module name
        raise InputError(f"tracker {name!r}: {module_name!r} names no module; module:Class is expected") from error
    maker = getattr(module, class_name, None)
    if not callable(maker):
        raise InputError(
            f"tracker {name!r}: module {module_name!r} has no class {class_name!r}; module:Class is expected"
        )
    return maker
