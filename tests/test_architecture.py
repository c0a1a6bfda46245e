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


def test_importing_every_tracker_module_never_loads_the_twin() -> None:
    modules = [info.name for info in pkgutil.walk_packages(trackers.__path__, "trackers.")]
    assert "trackers.laser_fisheye_imm" in modules
    code = f"import importlib, sys\nfor name in {modules!r}: importlib.import_module(name)\n"
    code += "loaded = [name for name in sys.modules if name == 'twin' or name.startswith(('twin.', 'mujoco'))]\n"
    code += "assert not loaded, loaded"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_imports_go_in_one_direction_and_in_no_circle() -> None:
    """Contracts of pyproject.toml: layers, no circle of files, no twin in trackers, no inside of a system elsewhere."""
    # in a process of its own: import-linter configures logging, which disables the loggers of this one
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_room_without_a_name_of_its_own() -> None:
    nameless = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}
    assert not [path for path in PYTHON_FILES if path.stem in nameless or nameless & set(path.parts)]


def test_no_module_is_longer_than_350_lines() -> None:
    lengths = {path.relative_to(ROOT).as_posix(): len(path.read_text("utf-8").splitlines()) for path in PYTHON_FILES}
    assert {name: lines for name, lines in lengths.items() if lines > 350} == {}


def test_errors_name_what_is_valid_by_one_function() -> None:
    """With the nearest of the valid names: `trackers.errors.valid_names`."""
    own = [path for path in PYTHON_FILES if path.name != "errors.py"]
    listing = ("valid are {', '.join", "valid ones are {", "get_close_matches")
    found = [path.relative_to(ROOT).as_posix() for path in own if any(each in path.read_text() for each in listing)]
    assert found == []


def test_the_command_line_loads_nothing_heavy_before_it_is_asked() -> None:
    heavy = (
        "numpy",
        "scipy",
        "mujoco",
        "cv2",
        "pydantic",
        "matplotlib",
        "rosbags",
        "av",
        "filterpy",
        "sklearn",
        "jinja2",
    )
    code = f"import sys, twin.cli\nprint([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_command_loads_only_what_it_needs() -> None:
    """`twin list` loads no library of numbers, and a run without images none of films, figures or windows.

    SciPy 1.18 loads `numpy.testing`, and with it `unittest`, in its own hulls; nothing else may.
    """
    ends = "\ntry: main()\nexcept SystemExit: pass\n"
    listing = "sys.argv[1:] = ['list']" + ends
    running = (
        "sys.argv[1:] = ['list', 'rooms']" + ends + "import twin.run.live, twin.world.simulation, twin.sensors.laser\n"
        "import trackers.sort, trackers.laser_fisheye_imm.tracker"
    )
    for code, heavy in (
        (listing, ("numpy", "scipy", "mujoco", "cv2", "matplotlib", "rosbags", "jinja2", "rich")),
        (
            running,
            (
                "scipy.linalg",
                "scipy.sparse",
                "scipy.optimize",
                "scipy.special",
                "glfw",
                "OpenGL",
                "av",
                "matplotlib",
                "sklearn",
                "filterpy",
                "distributed",
                "optuna",
                "jaxtyping",
                "asyncio",
                "unittest",
                "rosbags.typesys.stores.ros2_humble",
                "rosbags.rosbag1",
                "twin.recording.reader",
            ),
        ),
    ):
        script = (
            f"import sys\nfrom twin.cli import main\n{code}\nby_scipy = ('unittest',) if 'numpy.testing' in sys.modules else ()\n"
            f"print('heavy', [n for n in {heavy!r} if n in sys.modules and n not in by_scipy])"
        )
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == "heavy []"


def test_a_scenario_is_read_without_mujoco() -> None:
    code = "import sys; from twin.scenario import load_scenario\nload_scenario('lab-five-people')\nprint('mujoco' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_what_editors_see_of_the_twin_is_what_it_loads() -> None:
    tree = ast.parse((ROOT / "twin" / "__init__.py").read_text(encoding="utf-8"))
    (seen,) = (node for node in tree.body if isinstance(node, ast.If))
    homes = {alias.name: node.module for node in seen.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert sorted(homes) == dir(twin) == sorted(twin.__all__)
    for name, module in homes.items():
        assert module is not None and getattr(twin, name) is getattr(importlib.import_module(module), name)
    with pytest.raises(AttributeError, match=r"has no attribute 'simulate'; it has .*load_scenario"):
        twin.simulate  # noqa: B018


def test_test_modules_have_names_of_their_own() -> None:
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert not {name for name in names if names.count(name) > 1}


def test_folders_of_tests_are_those_of_the_code() -> None:
    """But `twin/api`, what holds for all of the Python interface."""
    folders = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py")} - {Path()}
    assert {each.as_posix() for each in folders if not (ROOT / each).is_dir()} == {"twin/api"}


def test_a_function_fits_a_screen() -> None:
    """At most 60 lines without its parameters and its docstring: of a command, parameters are its help."""
    long = {}
    for path in PYTHON_FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                first = node.body[len(node.body) > 1 and ast.get_docstring(node) is not None]
                if (lines := (node.end_lineno or 0) - first.lineno + 1) > 60:
                    long[f"{path.relative_to(ROOT)}:{node.name}"] = lines
    assert long == {}
