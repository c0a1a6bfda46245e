"""The process that mutants are handed to, a JSON request a line; what the twin does is watched from inside.

`python -m benchmarks.fuzz.child` answers each request on its output. Besides `twin`, a command may be one of `DIRECT`: a
function of the Python interface, for which InputError is exit code 2 as on the command line; or
`twin-without-simulation`, a suite's command that expands, checks and notes its cases and runs none of them.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

from benchmarks.fuzz import direct

DIRECT: dict[str, Callable[[list[str]], None]] = {"messages": direct.track_messages, "environment": direct.environment}

_MIB = 2**20
_LIBRARIES_MIB = 1024
"""Address space that the libraries may take when they are first needed; what counts is the memory that is touched."""
_TOUCHING = {
    "os.remove": ((0, 1),),
    "os.rename": ((0, 2), (1, 3)),
    "os.mkdir": ((0, 2),),
    "os.rmdir": ((0, 1),),
    "os.link": ((1, 3),),
    "os.symlink": ((1, 2),),
    "os.truncate": ((0, None),),
    "os.chmod": ((0, 2),),
    "os.chown": ((0, 3),),
    "os.utime": ((0, 3),),
    "sqlite3.connect": ((0, None),),
}
"""Audit events that change files: which of their arguments are paths, and which the folders these are relative to."""


class _TimeIsUpError(BaseException):
    """Raised by the alarm; no handler of the twin's takes it for its own."""


class _Watch:
    """Notes every path that is written to, made or removed outside the allowed folders; a hook cannot be taken off again."""

    def __init__(self) -> None:
        self._allowed: tuple[Path, ...] | None = None
        self.written: list[str] = []
        sys.addaudithook(self._heard)

    def begin(self, allowed: list[str]) -> None:
        self.written = []
        self._allowed = tuple(Path(path).resolve() for path in [*allowed, "/dev/null"])

    def end(self) -> None:
        self._allowed = None

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        allowed = self._allowed
        if allowed is None:
            return
        if event == "open":
            path, mode, flags = arguments
            writes = (flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            paths = [path] if writes or (isinstance(mode, str) and set(mode) & set("wax+")) else []
        elif event in ("os.system", "subprocess.Popen"):
            self.written.append(f"{event} {arguments[0]}")
            return
        else:
            paths = [_path(arguments, place, folder) for place, folder in _TOUCHING.get(event, ())]
        for path in paths:
            if not isinstance(path, str | bytes | os.PathLike):
                continue  # a descriptor: it was opened before
            self._allowed = None  # what is looked up here is not the twin's doing
            place = Path(os.fsdecode(path)).absolute()
            if not place.parent.resolve().joinpath(place.name).is_relative_to(allowed[0]) and not any(
                place.resolve().is_relative_to(folder) for folder in allowed
            ):
                self.written.append(f"{event} {place}")
            self._allowed = allowed


def _path(arguments: tuple[Any, ...], place: int, folder: int | None) -> Any:
    """A path among an audit event's arguments, joined to the folder that a descriptor beside it stands for."""
    path = arguments[place]
    if folder is None or arguments[folder] in (-1, None) or not isinstance(path, str | bytes | os.PathLike):
        return path
    return Path(os.readlink(f"/proc/self/fd/{arguments[folder]}"), os.fsdecode(path))


def _alarm(number: int, frame: FrameType | None) -> None:
    raise _TimeIsUpError


def _twin(arguments: list[str]) -> int:
    from twin.cli import main

    sys.argv = ["twin", *arguments]
    path = list(sys.path)
    try:
        with mock.patch("twin.cli.run_in_child", return_value=None):  # the time and memory counted are this process's
            main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    finally:
        sys.path[:] = path
    return 0


def _run(command: list[str]) -> int:
    from trackers.errors import InputError

    if command[0] == "twin":
        return _twin(command[1:])
    if command[0] == "twin-without-simulation":
        with mock.patch("twin.suites.run._run_cases"):
            return _twin(command[1:])
    try:
        DIRECT[command[0]](command[1:])
    except InputError as error:
        sys.stderr.write(f"twin: {error}\n")
        return 2
    except Exception:
        traceback.print_exc()
        return 70
    return 0


def _status_mib(name: str) -> float:
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith(name):
            return int(line.split()[1]) / 1024
    raise ValueError(name)


def _judged(request: dict[str, Any], watch: _Watch) -> dict[str, Any]:
    os.chdir(request["folder"])
    os.environ |= request["environment"]
    log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.close(log)
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")  # the peak counts from here
    limit = int((_status_mib("VmSize") + request["limit_mib"] + _LIBRARIES_MIB) * _MIB)
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
    code: int | None = None
    start_s = time.process_time()
    watch.begin(request["may_write"])
    try:
        signal.setitimer(signal.ITIMER_PROF, request["limit_s"])
        signal.setitimer(signal.ITIMER_REAL, request["clock_limit_s"])
        code = _run(request["command"])
    except _TimeIsUpError:
        traceback.print_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        watch.end()
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    spent_s = time.process_time() - start_s
    sys.stdout.flush()
    sys.stderr.flush()
    for name in request["environment"]:
        del os.environ[name]
    return {
        "exit_code": code,
        "timed_out": code is None,
        "spent_s": spent_s,
        "peak_mib": _status_mib("VmHWM"),
        "written": watch.written,
        "said": Path(request["log"]).read_text(encoding="utf-8", errors="replace")[-20_000:],
    }


def main() -> None:
    """Answer requests until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    for alarm in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(alarm, _alarm)
    watch = _Watch()
    for line in sys.stdin:
        print(json.dumps(_judged(json.loads(line), watch)), file=answers, flush=True)


if __name__ == "__main__":
    main()
