"""What holds for every test."""

import gc
import logging
import os
from collections import defaultdict
from collections.abc import Generator, Iterator
from typing import Any

import pytest
from hypothesis import settings

# Before anything imports mujoco: tests that use its own renderer draw through EGL too.
os.environ["MUJOCO_GL"] = "egl"
# Before anything imports numpy, and as the command does: matrices are small, and a thread of BLAS that waits for the next
# one spins, for a quarter of the time of the trackers' tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.pop("COLUMNS", None)  # tables are as wide as in a file, unless a test says how wide

OURS = ("twin", "trackers")

# No test is about time: a machine with other work to do makes any example late.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# As the command does; Python's 700 new objects cost a tenth of some folders' time, since everything tested stays loaded.
gc.set_threshold(10_000)
gc.disable()  # until everything is collected, all of which stays

import shape_checks  # noqa: E402
import worker_memory  # noqa: E402

worker_memory.map_large_arrays()
PEAKS = worker_memory.Peaks()
WORKERS: dict[str, list[tuple[float, str]]] = {}
"""Peak memory of each worker [MiB] in its heaviest files of tests."""

# Before anything imports them: calls into the trackers have their arguments' and results' types and shapes checked.
shape_checks.install()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option of the nightly run."""
    parser.addoption(
        "--all-cases", action="store_true", help="run every case of tests marked sample, and those marked nightly"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests marked `nightly`, and all but n cases, evenly spaced, of those marked `sample(n)`.

    `--all-cases` runs everything, and so does a test's own name (`FILE::TEST`) on the command line.
    """
    if config.getoption("--all-cases") or any("::" in each for each in config.args):
        return
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("nightly"):
            cases[item.nodeid] = []
        else:
            cases[item.nodeid.partition("[")[0]].append(item)
    kept: set[pytest.Item] = set()
    for of_test in cases.values():
        marker = of_test[0].get_closest_marker("sample") if of_test else None
        count = len(of_test) if marker is None else min(marker.args[0], len(of_test))
        kept.update(of_test[(2 * each + 1) * len(of_test) // (2 * count)] for each in range(count))
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = [item for item in items if item in kept]


def pytest_collection_finish() -> None:
    """Leave modules and tests out of every search for garbage: a quarter of the time of collecting them, and more later."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Check each function's first calls anew in each file of tests."""
    shape_checks.begin_test_of(item.path)


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_runtest_teardown(item: pytest.Function, nextitem: pytest.Item | None) -> Generator[None, object, object]:
    """Free what tests leave, before it adds up: recordings, worlds and pictures for no other file."""
    result = yield
    if nextitem is None or nextitem.path != item.path:
        assert item.module is not None
        PEAKS.note(item.nodeid.partition("::")[0])
        worker_memory.end_file(item.module)
    else:
        worker_memory.collect_if_grown()
    return result


@pytest.fixture(autouse=True)
def nothing_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A command that lifts the limits in this process lifts them for its own test alone; no logger is left disabled."""
    from trackers.user_input.text_file import NO_LIMITS

    monkeypatch.setenv(NO_LIMITS, "")
    yield
    assert logging.root.manager.disable == logging.NOTSET
    loggers = logging.root.manager.loggerDict
    disabled = [
        name for name in loggers if name.partition(".")[0] in OURS and getattr(loggers[name], "disabled", False)
    ]
    assert not disabled, "a library configured logging, which disables the loggers that there are"


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand this worker's peak memory to the process that started it."""
    if (output := getattr(session.config, "workeroutput", None)) is not None:
        output["peaks"] = PEAKS.heaviest()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take a worker's peak memory; one that crashed has none."""
    if peaks := getattr(node, "workeroutput", {}).get("peaks"):
        WORKERS[node.gateway.id] = peaks


def pytest_terminal_summary(terminalreporter: "pytest.TerminalReporter") -> None:  # not in pytest 8.3
    """Print the peak memory of each worker."""
    for worker, peaks in sorted(WORKERS.items()):
        of_files = "; ".join(f"{mib:.0f} MiB in {file}" for mib, file in peaks)
        terminalreporter.write_line(f"worker {worker}: peak {of_files}")
