"""Every path that the public functions take may be a text, a Path, or anything else with a path."""

from __future__ import annotations

import importlib
import inspect
import os
import pkgutil
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import twin as command
from pydantic import BaseModel

import trackers
import twin
from trackers.environment import build_environment, load_environment, save_environment
from trackers.rig import Rig
from twin.environment.run import scan_scenario
from twin.environment.scan import TiltingScanner


class Mine:
    """What pathlib is not, and os.PathLike is."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __fspath__(self) -> str:
        return str(self.path)


def at_home(path: Path) -> str:
    return f"~/{path.relative_to(os.environ['HOME'])}"


KINDS: dict[str, Callable[[Path], Any]] = {"text": str, "Path": Path, "PathLike": Mine, "~": at_home}


def public() -> Iterator[tuple[str, Any]]:
    for name in twin.__all__:
        yield f"twin.{name}", getattr(twin, name)
    for module in pkgutil.walk_packages(trackers.__path__, "trackers."):
        found = importlib.import_module(module.name)
        for name, value in vars(found).items():
            if not name.startswith("_") and getattr(value, "__module__", None) == module.name and callable(value):
                yield f"{module.name}.{name}", value


def parameters() -> Iterator[tuple[str, str]]:
    for name, value in public():
        members = [("", value)]
        if inspect.isclass(value):
            members = [
                (f".{each}", member)
                for each, member in inspect.getmembers(value, callable)
                if each == "__init__" or not (each.startswith("_") or hasattr(BaseModel, each))
            ]
        for suffix, member in members:
            try:
                taken = inspect.signature(member).parameters
            except (TypeError, ValueError):
                continue
            for parameter, described in taken.items():
                yield f"{name}{suffix}({parameter})", str(described.annotation)


def test_no_public_parameter_is_a_path_alone() -> None:
    found = dict(parameters())
    assert found["twin.run_scenario(out)"] == "AnyPath | None"
    only = {name: annotation for name, annotation in found.items() if re.search(r"(?<!Any)Path\b", annotation)}
    assert not {name for name in only if "(learned)" not in name}  # a mapping, of Paths, which trackers read


TAKERS: dict[str, Callable[[Any], object]] = {
    "scenario": twin.load_scenario,
    "folder": lambda given: twin.load_scenario("pair", folder=given),
    "recording": twin.Recording,
    "rig": Rig.load,
    "a truth table": twin.read_truth,
    "a tracks table": twin.read_tracks,
    "out": lambda given: twin.run_scenario(twin.load_scenario("pair"), trackers=["sort"], out=given),
    "rig_path": lambda given: twin.track_recording("none.bag", trackers=["sort"], rig_path=given),
    "truth_path": lambda given: twin.track_recording("none.bag", trackers=["sort"], truth_path=given),
    "bag_copy": lambda given: twin.track_recording("none.bag", trackers=["sort"], bag_copy=given),
}


@pytest.mark.parametrize("taken", TAKERS)
@pytest.mark.parametrize("given", [3, b"pair", ["pair"], np.zeros(3), "", "a\0b"], ids=repr)
def test_what_is_no_path_is_refused_in_a_sentence(taken: str, given: Any) -> None:
    with pytest.raises(twin.InputError, match=rf"^{taken}: .* is no path; a text .* is expected$"):
        TAKERS[taken](given)


def test_a_path_too_long_for_any_folder_is_refused_in_a_sentence() -> None:
    with pytest.raises(twin.InputError, match=r"^--out a+: cannot be written \(File name too long\)"):
        twin.run_scenario(twin.load_scenario("pair"), trackers=["sort"], out="a" * 5000)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_run_track_and_read_by_any_path(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    of, folder = KINDS[kind], tmp_path / "run"
    source = tmp_path / "mine.yaml"
    source.write_text("name: mine\nextends: lab-five-people\nduration_s: 1\nbackground_frames: 2\n")
    scenario = twin.load_scenario(of(source))
    result = twin.run_scenario(scenario, trackers=["sort"], out=of(folder), images=False, video=False)
    assert result.files["recording"] == folder / "recording.mcap"

    rig = tmp_path / "rig.yaml"
    rig.write_text(twin.Recording(of(folder / "recording.mcap")).rig.dump_yaml())
    tracked = twin.track_recording(
        of(folder / "recording.mcap"),
        trackers=["sort"],
        rig_path=of(rig),
        out=of(tmp_path / "tracked"),
        bag_copy=of(tmp_path / "copy.mcap"),
        video=False,
    )
    assert tracked.files["report"].parent == tmp_path / "tracked" and (tmp_path / "copy.mcap").stat().st_size
    assert Rig.load(of(rig)) == twin.Recording(of(folder / "recording.mcap"), of(rig)).rig

    truth, tracks = (twin.read_truth(of(folder / "truth.csv")), twin.read_tracks(of(folder / "tracks/sort.csv")))
    assert truth.source == os.fspath(folder / "truth.csv") and len(tracks.t)


def test_the_command_takes_a_home_that_no_shell_has_expanded(tmp_path: Path) -> None:
    given = {"cwd": tmp_path, "HOME": str(tmp_path / "me")}
    (tmp_path / "me").mkdir()
    assert command("new", "suite", "--out=~/mine.yaml", **given).returncode == 0
    assert command("new", "study", "--out", "~/mine2.yaml", **given).returncode == 0
    assert command("check", "~/mine.yaml", **given).stdout.startswith(f"{tmp_path}/me/mine.yaml: a valid suite")
    assert not (tmp_path / "~").exists() and (tmp_path / "me" / "mine2.yaml").exists()
    assert "~nobody" in command("check", "~nobody.yaml", **given).stderr


def test_environment_by_any_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    cloud, _ = scan_scenario(twin.load_scenario("pair"), scanner=TiltingScanner(beams=91, tilt_step_deg=2.0))
    environment = build_environment(cloud)
    for kind, of in KINDS.items():
        save_environment(environment, of(tmp_path / f"{kind}.npz"))
        assert load_environment(of(tmp_path / f"{kind}.npz")).room == environment.room
