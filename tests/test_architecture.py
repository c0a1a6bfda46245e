"""The rules that keep the house a house."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import trackers
import twin

ROOT = Path(__file__).parents[1]
PYTHON_FILES = sorted([*(ROOT / "trackers").rglob("*.py"), *(ROOT / "twin").rglob("*.py")])


def imported_modules(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module)
    return names


@pytest.mark.parametrize("path", sorted((ROOT / "trackers").rglob("*.py")), ids=lambda path: path.stem)
def test_a_tracker_module_never_names_the_twin(path: Path) -> None:
    assert not {name for name in imported_modules(path) if name.split(".")[0] == "twin"}


def test_importing_every_tracker_module_never_loads_the_twin() -> None:
    modules = [info.name for info in pkgutil.walk_packages(trackers.__path__, "trackers.")]
    assert "trackers.laser_fisheye_imm" in modules
    code = f"import importlib, sys\nfor name in {modules!r}: importlib.import_module(name)\n"
    code += "loaded = [name for name in sys.modules if name == 'twin' or name.startswith(('twin.', 'mujoco'))]\n"
    code += "assert not loaded, loaded"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


TWIN_UPWARDS = (
    "models",
    "streams",
    "progress",
    "limits",
    "interruption",
    "shown",
    "geometry",
    "instant",
    "sensors",
    "tables",
    "drawn",
    "scenario",
    "room",
    "people",
    "truth",
    "recording",
    "evaluate",
    "world",
    "report",
    "run",
    "view",
    "console",
    "options",
    "environment",
    "suites",
    "reproduce",
    "studies",
    "check",
    "commands",
    "cli",
    "__main__",
)
"""The rooms of the twin: each imports from those before it alone."""
PEOPLE_UPWARDS = ("body", "gait", "posture", "crowd", "script")


def room_of(module: str, under: str) -> str | None:
    """The room right under a package that a module is in, or none."""
    return module.removeprefix(f"{under}.").split(".")[0] if module.startswith(f"{under}.") else None


@pytest.mark.parametrize(("package", "upwards"), [("twin", TWIN_UPWARDS), ("twin.people", PEOPLE_UPWARDS)])
def test_rooms_import_in_one_direction(package: str, upwards: tuple[str, ...]) -> None:
    folder = ROOT / package.replace(".", "/")
    rooms = {path.stem for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    if package == "twin":
        assert rooms - {"__init__"} == set(upwards)
    backwards = []
    for path in folder.rglob("*.py"):
        here = room_of(".".join(path.relative_to(ROOT).with_suffix("").parts), package)
        if here not in upwards:
            continue
        for name in imported_modules(path):
            there = room_of(name, package)
            if there in upwards and upwards.index(there) > upwards.index(here):
                backwards.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not backwards


def test_folders_of_trackers_do_not_import_each_other() -> None:
    imports: dict[str, set[str]] = {}
    for path in (ROOT / "trackers").rglob("*.py"):
        here = path.relative_to(ROOT).parts[1].removesuffix(".py")
        there = {room_of(name, "trackers") for name in imported_modules(path)} - {None, here}
        imports.setdefault(here, set()).update(each for each in there if each is not None)

    def reached(room: str) -> set[str]:
        found, waiting = set(), [room]
        while waiting:
            new = imports.get(waiting.pop(), set()) - found
            found |= new
            waiting += new
        return found

    assert not [room for room in imports if room in reached(room)]


def test_no_room_without_a_name_of_its_own() -> None:
    nameless = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}
    assert not [path for path in PYTHON_FILES if path.stem in nameless or nameless & set(path.parts)]


def test_the_command_line_loads_nothing_heavy_before_it_is_asked() -> None:
    heavy = ("numpy", "scipy", "mujoco", "cv2", "pydantic", "matplotlib", "rosbags", "av", "filterpy", "sklearn")
    code = f"import sys, twin.cli\nprint([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_what_editors_see_of_the_twin_is_what_it_loads() -> None:
    tree = ast.parse((ROOT / "twin" / "__init__.py").read_text(encoding="utf-8"))
    (seen,) = (node for node in tree.body if isinstance(node, ast.If))
    homes = {alias.name: node.module for node in seen.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert sorted(homes) == dir(twin) == sorted(twin.__all__)
    for name, module in homes.items():
        assert module is not None and getattr(twin, name) is getattr(importlib.import_module(module), name)
    with pytest.raises(AttributeError, match=r"has no attribute 'simulate'; it has .*load_scenario"):
        twin.simulate  # noqa: B018
