"""What holds for every test."""

import logging
import os
from collections.abc import Iterator

import pytest
import shape_checks

# Before anything imports mujoco: tests that use its own renderer draw through EGL too.
os.environ["MUJOCO_GL"] = "egl"

OURS = ("twin", "trackers")

# Before anything imports them: calls into the trackers have their arguments' and results' types and shapes checked.
shape_checks.install()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Check each function's first calls anew in each test."""
    shape_checks.begin_test()


@pytest.fixture(autouse=True)
def nothing_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A command that lifts the limits in this process lifts them for its own test alone; no logger is left disabled."""
    from trackers.limits import NO_LIMITS

    monkeypatch.setenv(NO_LIMITS, "")
    yield
    assert logging.root.manager.disable == logging.NOTSET
    loggers = logging.root.manager.loggerDict
    disabled = [
        name for name in loggers if name.partition(".")[0] in OURS and getattr(loggers[name], "disabled", False)
    ]
    assert not disabled, "a library configured logging, which disables the loggers that there are"
