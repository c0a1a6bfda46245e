"""`twin new`: write a commented template of anything, which runs as it is, or a random scene as plain files."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from trackers.errors import InputError
from twin.command_options import Seed, Set, command_group, overrides

SCENARIO = """\
# A scenario of your own; `twin schema > scenario.schema.json` gives editors completion. Run it: twin run {file}
name: {name}
room: lab                       # a shipped room (see `twin list`), or the path of an MJCF file, relative to this one
duration_s: 20
people:                         # what is left out, height and clothes say, is drawn from the seed
  ann: {{height_m: 1.68, shirt: pink, script: {{kind: wander}}}}
  bob:
    start: [-1.5, 1.0]          # metres in the room frame
    script:
      - {{kind: walk, waypoints: [[1.5, 2.0], [-1.5, 1.0]]}}
      - {{kind: stand, for_s: 3}}
      - {{kind: wander}}
sensors:
  waist: {{kind: laser, role: waist, rate_hz: 10, mount: {{xyz: [0, 0, 0.95], yaw_deg: 90}}}}
  knee: {{kind: laser, role: knee, rate_hz: 10, mount: {{xyz: [0, 0, 0.45], yaw_deg: 90}}}}
"""

ROOM = """\
<!--
  A room of your own: 6 m x 4 m, 2.6 m high, with a door, a desk and a chair. Look at it: twin view {file}
  Lengths are in metres, z is up, the floor is at z = 0. Every element of MJCF that is modelled: docs/mjcf.md.
-->
<mujoco model="{name}">
  <compiler angle="degree"/>
  <asset>
    <material name="plaster" rgba="0.85 0.84 0.80 1"/>
    <material name="oak" rgba="0.60 0.45 0.30 1"/>
    <material name="cloth" rgba="0.25 0.35 0.50 1"/>
    <material name="carpet" rgba="0.45 0.47 0.50 1"/>
  </asset>
  <worldbody>
    <!-- Lamps; without any a room gets two. -->
    <light pos="-1.5 0 2.5" dir="0 0 -1" cutoff="80" exponent="1" diffuse="0.8 0.8 0.8"/>
    <light pos="1.5 0 2.5" dir="0 0 -1" cutoff="80" exponent="1" diffuse="0.8 0.8 0.8"/>
    <!-- Boxes by their middle (pos) and half their size. What reaches from 0.5 m or less to 1.8 m or more is a wall. -->
    <geom name="floor" type="box" pos="0 0 -0.05" size="3.1 2.1 0.05" material="carpet"/>
    <geom name="west" type="box" pos="-3.05 0 1.3" size="0.05 2 1.3" material="plaster"/>
    <geom name="east" type="box" pos="3.05 0 1.3" size="0.05 2 1.3" material="plaster"/>
    <geom name="north" type="box" pos="0 2.05 1.3" size="3.1 0.05 1.3" material="plaster"/>
    <!-- The south wall has a gap of 0.9 m: a door. -->
    <geom name="south_west" type="box" pos="-0.55 -2.05 1.3" size="2.55 0.05 1.3" material="plaster"/>
    <geom name="south_east" type="box" pos="3 -2.05 1.3" size="0.1 0.05 1.3" material="plaster"/>
    <geom name="lintel" type="box" pos="2.45 -2.05 2.35" size="0.45 0.05 0.25" material="plaster"/>
    <!-- A desk: a top on legs, so that the legs of a person at it have room; no person could sit at a solid box. -->
    <body name="desk" pos="-2.55 1 0">
      <geom type="box" pos="0 0 0.72" size="0.4 0.7 0.02" material="oak"/>
      <geom type="box" pos="0 0.65 0.35" size="0.35 0.02 0.35" material="oak"/>
      <geom type="box" pos="0 -0.65 0.35" size="0.35 0.02 0.35" material="oak"/>
    </body>
    <!-- A seat: a body whose site seat_NAME says where one sits; its x axis is where one faces. One sits down from free floor
         before the seat or, at a desk, beside it. -->
    <body name="chair" pos="-1.7 1 0" euler="0 0 180">
      <geom type="box" pos="0 0 0.22" size="0.22 0.22 0.22" material="cloth"/>
      <site name="seat_desk" pos="0 0 0.44"/>
    </body>
  </worldbody>
</mujoco>
"""

SUITE = """\
# A suite of your own: scenarios x seeds x trackers. Run it: twin suite run {file}
# As a gate: twin suite run {file} --baseline baseline.json --update-baseline once, then without --update-baseline.
# `twin schema suite > suite.schema.json` gives editors completion.
name: {name}
seeds: 6                        # how many from 0 on (fewer: no intervals); or a list, or {{from: 1000, count: 20}}
trackers: [sort, laser-imm]     # names of `twin list trackers`, or module:Class with --allow-plugins
reference: sort                 # the others are compared with it, paired by seed
reports: false                  # true: a page for each case
scenarios:
  - scenario: lab-five-people   # a shipped scenario, or the path of a file, relative to this one
    set: {{duration_s: 8, sensors.fisheye: null}}
    require: {{sort: {{mota: ">= 0.5"}}}}       # exit code 1 where it is not reached
# Bags are cases too, the twin's or a robot's:
# recordings:
#   - recording: bags/*.mcap
#     rig: rig.yaml
#     truth: truth.csv
#     require: {{sort: {{misses: "<= 5"}}}}
#     set: {{trackers.sort.radius_m: 0.8}}
"""

STUDY = """\
# A study of your own: where should the sensors go, how many? Run it: twin study run {file}
# What they see as they stand: twin study coverage lab-five-people. `twin schema study` gives editors completion.
name: {name}
scenarios: [{{scenario: lab-five-people}}]
devices:
  scanner:
    sensors: [waist]            # sensors of the scenario that are moved
    walls: {{height_m: [0.95, 0.95], off_m: 0.1, every_m: 1.0}}   # places to try: along the walls
    aim: area                   # where they look: to the tracked area
    count: [1, 2]               # how many
    price: 1000
objectives: [{{kind: coverage}}, {{kind: price}}]
coverage: {{seeds: [0], samples: 20}}
search: {{method: exact, limit_s: 30}}
"""

TRACKER = '''\
"""A tracker of your own: clusters of one scanner, each assigned to the nearest track.

Check it: twin check {module}:Mine
Run it:   twin run lab-five-people --tracker {module}:Mine --no-images
"""

import numpy as np
from scipy.optimize import linear_sum_assignment
from trackers.laser.layer import LaserLayer, WaistOptions
from trackers.tracks import Track

_FARTHEST_M = 0.5  # from a track to the cluster that continues it
_COAST_S = 0.5  # a track without a cluster for longer than this is deleted


class Mine:
    """Made for each run with the rig, observations of the empty room, and a random generator; options by --set."""

    def __init__(self, rig, background, rng, **options):
        self.main = rig.main_sensor
        empty_room = [scan for scan in background if scan.sensor == self.main]
        self.layer = LaserLayer(rig.sensors[self.main], empty_room, WaistOptions())
        self.people = {{}}  # by id: place (2,) [m] in the room, and when it was last seen [s]
        self.latest_id = 0

    def update(self, observation):
        """Take the next observation; they come in order of their stamps."""
        if observation.sensor != self.main:
            return
        found = self.layer.detect(observation).position  # (n, 2) [m]
        ids = list(self.people)
        places = np.array([self.people[number][0] for number in ids]).reshape(-1, 2)
        distance = np.linalg.norm(places[:, None] - found[None], axis=-1)  # (tracks, clusters)
        taken = set()
        for row, column in zip(*linear_sum_assignment(distance), strict=True):
            if distance[row, column] < _FARTHEST_M:
                self.people[ids[row]] = found[column], observation.t
                taken.add(column)
        for column in set(range(len(found))) - taken:
            self.latest_id += 1
            self.people[self.latest_id] = found[column], observation.t
        self.people = {{k: each for k, each in self.people.items() if observation.t - each[1] <= _COAST_S}}

    def tracks(self):
        """Return the tracks after the latest observation of the main sensor."""
        return [Track(number, float(x), float(y)) for number, ((x, y), _) in self.people.items()]
'''


app = command_group(
    "Write a commented start of your own: room, scenario, tracker, suite, study; a bag's rig; or a scene drawn at random."
)


@app.command(epilog="Example: twin new scenario --drawn --seed 7 --out office; twin run office/scenario.yaml")
def scenario(
    drawn: Annotated[bool, typer.Option("--drawn", help="Room, people and sensors drawn at random.")] = False,
    set_: Set = None,
    seed: Seed = None,
    out: Annotated[Path, typer.Option(help="Folder to write scenario.yaml into, and room.xml of a drawn one.")] = Path(
        "scenario"
    ),
) -> None:
    """Write scenario.yaml into a folder: a commented start, or a drawn scene with its room, as plain files that run."""
    from twin.console import print_paths
    from twin.recording.atomic_file import write_atomic
    from twin.scenario import load_scenario
    from twin.scenario.load import dump_scenario

    if out.suffix in (".yaml", ".yml"):
        raise InputError(
            f"--out {out}: is a folder's, into which scenario.yaml is written; {out.with_suffix('')} is expected"
        )
    path, room = out / "scenario.yaml", out / "room.xml"
    if not drawn and (set_ or seed is not None):
        option = "--set" if set_ else "--seed"
        raise InputError(f"{option}: changes what is drawn; --drawn beside it is expected")
    for file in (path, *([room] if drawn else [])):
        if file.exists():
            raise InputError(f"{file}: is there already; another folder (--out) is expected")
    following = f"twin run {quote(str(path))}"
    if not drawn:
        write_atomic(path, SCENARIO.format(name=_name(out), file=path))
        print_paths({"scenario": path, "next": following})
        return
    loaded = load_scenario("drawn", overrides(set_, seed))
    write_atomic(room, Path(loaded.room).read_text(encoding="utf-8"))
    about = f"Drawn with seed {loaded.seed}."
    plain = loaded.model_copy(update={"room": room.name, "name": f"drawn-{loaded.seed}", "description": about})
    write_atomic(path, dump_scenario(plain))
    print_paths({"scenario": path, "room": room, "next": following})


@app.command(epilog="Example: twin new room --out office.xml; twin view office.xml")
def room(out: Annotated[Path, typer.Option(metavar="FILE.xml", help="File to write.")] = Path("room.xml")) -> None:
    """Write a room of walls, a door, lamps, a desk and a seat, with comments (MJCF)."""
    _write("room", _filled(ROOM, out), out, ".xml")


@app.command(epilog="Example: twin new tracker --out mine.py; twin check mine:Mine")
def tracker(out: Annotated[Path, typer.Option(metavar="FILE.py", help="File to write.")] = Path("mine.py")) -> None:
    """Write a tracker of 40 lines: clusters of one scanner, each assigned to the nearest track."""
    _write("tracker", _filled(TRACKER, out), out, ".py")


@app.command(epilog="Example: twin new suite --out gate.yaml; twin suite run gate.yaml")
def suite(out: Annotated[Path, typer.Option(metavar="FILE.yaml", help="File to write.")] = Path("suite.yaml")) -> None:
    """Write a suite of one scenario, two trackers and six seeds, with a requirement."""
    _write("suite", _filled(SUITE, out), out, ".yaml")


@app.command(epilog="Example: twin new study --out places.yaml; twin study run places.yaml")
def study(out: Annotated[Path, typer.Option(metavar="FILE.yaml", help="File to write.")] = Path("study.yaml")) -> None:
    """Write a study of where one or two scanners should hang in the lab."""
    _write("study", _filled(STUDY, out), out, ".yaml")


@app.command(epilog="Example: twin new rig walk.bag --out rig.yaml; twin check rig.yaml")
def rig(
    recording: Annotated[Path, typer.Argument(help="A ROS 1 or ROS 2 bag.")],
    frame: Annotated[
        str | None, typer.Option(help="Frame of the given poses, as map; default: the highest above each sensor.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FILE.yaml", help="File to write.")] = Path("rig.yaml"),
) -> None:
    """Write a rig.yaml of a bag's sensors: topics, lenses and poses that its messages tell, the rest marked."""
    from twin.console import print_warning
    from twin.recording.rig_of_bag.rig_guess import describe_rig

    text, undecided = describe_rig(recording, frame)
    _write("rig", text, out, ".yaml")
    for each in undecided:
        print_warning(each)


def _filled(template: str, path: Path) -> str:
    return template.format(name=_name(path.with_suffix("")), file=quote(str(path)), module=path.stem)


def _write(what: str, text: str, path: Path, suffix: str) -> None:
    from importlib.util import find_spec
    from keyword import iskeyword

    from twin.console import print_paths
    from twin.recording.atomic_file import write_atomic

    if path.suffix != suffix or (suffix == ".py" and not path.stem.isidentifier()):
        expected = (
            f"the name of a Python module, {suffix} included," if suffix == ".py" else f"a name ending in {suffix}"
        )
        raise InputError(f"--out {path}: is no file for a {what}; {expected} is expected")
    if path.exists():
        raise InputError(f"--out {path}: is there already; the name of a new file is expected")
    if suffix == ".py" and (iskeyword(path.stem) or find_spec(path.stem) is not None):
        raise InputError(
            f"--out {path}: {path.stem} is a word or a module of Python's, or installed; another name is expected"
        )
    write_atomic(path, text)
    file = quote(str(path))
    following = {
        "room": f"twin view {file}",
        "suite": f"twin suite run {file}",
        "study": f"twin study run {file}",
        "rig": f"twin check {file}",
        "tracker": f"twin check {path.stem}:Mine",
    }[what]
    if what == "tracker" and path.parent != Path():  # modules are imported from the current folder
        following = f"cd {quote(str(path.parent))} && {following}"
    print_paths({what: path, "next": following})


def _name(folder: Path) -> str:
    """Make a scenario's name from the folder's: letters, digits, '-' and '_', a letter first."""
    name = "".join(
        each if each.isascii() and (each.isalnum() or each in "-_") else "-" for each in folder.resolve().name
    )
    return name if name[:1].isalpha() else f"scenario-{name}".rstrip("-")
