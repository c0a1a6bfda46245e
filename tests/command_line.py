"""The command `twin` in the process of the tests: a start of Python costs more than most of what is looked at."""

from __future__ import annotations

import io
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from twin.cli import main

Ended = subprocess.CompletedProcess[str]


def twin(*arguments: str | Path, cwd: Path | None = None, **environment: str) -> Ended:
    """Run the command with these arguments; return its exit code, and what it writes.

    cwd: the current folder; environment: variables set besides. Everything of the process is as it was afterwards, but for
    modules that were imported: classes of a user's own have module names of their own in each test.
    """
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", newline="", write_through=True) for _ in range(2))
    warnings = logging.StreamHandler(err)  # without handlers, logging writes to stderr: pytest's are in the way of that
    warnings.setLevel(logging.WARNING)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    with pytest.MonkeyPatch.context() as patch:
        for name in ("MUJOCO_GL", "OPENBLAS_NUM_THREADS"):
            patch.setenv(name, os.environ.get(name, ""))  # set back, whatever becomes of them
        for name, value in environment.items():
            patch.setenv(name, value)
        patch.setattr(sys, "argv", ["twin", *map(str, arguments)])
        patch.setattr(sys, "path", [*sys.path])
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", err)
        if cwd is not None:
            patch.chdir(cwd)
        logging.getLogger().addHandler(warnings)
        try:
            with pytest.raises(SystemExit) as ended:
                main()
        finally:
            logging.getLogger().removeHandler(warnings)
            for number, handler in handlers.items():
                signal.signal(number, handler)
    assert isinstance(ended.value.code, int)
    said, told = (stream.buffer.getvalue().decode() for stream in (out, err))  # pyright: ignore[reportAttributeAccessIssue]
    return Ended(["twin", *map(str, arguments)], ended.value.code, said, told)
