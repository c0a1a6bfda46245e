"""Every remaining result is there and none twice, whatever becomes of the workers."""

from __future__ import annotations

import errno
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial
from http.client import HTTPException
from io import StringIO
from pathlib import Path
from threading import Event
from typing import Any
from urllib.request import urlopen

import numpy as np
import psutil
import pytest
from dask import config
from distributed import LocalCluster
from synthetic_work import do, work_of

from trackers.errors import InputError
from twin.suites import dask_runner, local_cluster, tasks
from twin.suites.cluster import Cluster, open_cluster, read_resources
from twin.suites.dask_runner import run_on
from twin.suites.local_cluster import PrivateCluster
from twin.suites.tasks import MAX_RETRIES, OutOfSpaceError, State, Task, TaskListener, TaskResult, run_serial

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    with open_cluster(jobs=2) as opened:
        yield opened


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A scheduler of the user's own, without certificates."""
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50) as theirs:
        yield theirs.scheduler_address


class Record:
    """Everything that a listener is told."""

    def __init__(self) -> None:
        self.starts: list[tuple[str, int]] = []
        self.ends: list[TaskResult] = []
        self.states: list[State] = []

    def listener(self) -> TaskListener:
        return TaskListener(
            lambda task, number: self.starts.append((task.id, number)), self.ends.append, self.states.append
        )

    def by_id(self) -> dict[str, TaskResult]:
        assert max(Counter(end.task.id for end in self.ends).values()) == 1
        return {end.task.id: end for end in self.ends}


def squares(n: int, limit_s: float = 60) -> list[Task]:
    return [Task(f"square-{k}", work_of("square", n=k), limit_s) for k in range(n)]


def test_tasks_run_in_spawned_processes_without_rendering_threads(cluster: Cluster) -> None:
    record = Record()
    run_on(cluster, [Task(str(k), work_of("where"), 60) for k in range(4)], do, record.listener())
    pids = {end.value[0] for end in record.ends}
    assert os.getpid() not in pids and {end.value[1] for end in record.ends} == {"0"}
    assert record.states[-1] == State(waiting=0, running=0, done=4, failed=0, workers=2)
    assert max(state.running for state in record.states) == 2


def test_a_case_that_raises_fails_at_once_with_traceback_and_log_and_the_rest_goes_on(
    cluster: Cluster, tmp_path: Path
) -> None:
    record = Record()
    bad = [Task("raises", work_of("raise"), 60), Task("bad", work_of("bad input"), 60)]
    run_on(cluster, [*bad, *squares(6)], do, record.listener(), tmp_path)
    ends = record.by_id()
    assert [ends[f"square-{k}"].value for k in range(6)] == [k**2 for k in range(6)]
    assert ends["raises"].status == "failed" and ends["raises"].attempts == 1
    assert (
        ends["raises"].error.startswith("RuntimeError: nothing works today\nTraceback")
        and "about to raise" in ends["raises"].error
    )
    assert ends["bad"].error == "sensors.waist: is no good; a better one is expected"
    assert [path.name for path in tmp_path.iterdir()] == ["raises.1.log"]  # logs without a word are not kept


def test_a_case_that_kills_its_worker_is_tried_twice_again_and_fails_with_its_log(
    cluster: Cluster, tmp_path: Path
) -> None:
    record = Record()
    once = Task("once", work_of("die once", mark=str(tmp_path / "mark"), n=7), 60)
    run_on(cluster, [Task("dies", work_of("die"), 60), once, *squares(6)], do, record.listener(), tmp_path)
    ends = record.by_id()
    assert ends["dies"].status == "failed" and ends["dies"].attempts == MAX_RETRIES + 1 == 3
    assert "its worker died" in ends["dies"].error and "about to die" in ends["dies"].error
    assert (ends["once"].value, ends["once"].attempts) == (49, 2)
    assert all(ends[f"square-{k}"].value == k**2 for k in range(6))
    assert record.starts.count(("dies", 3)) == 1


def test_a_case_that_hangs_is_ended_and_its_stack_is_in_the_log(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_runner, "_GRACE_S", 300.0)  # the worker ends it, however late on a busy machine
    monkeypatch.setattr(tasks, "MAX_RETRIES", 1)
    record = Record()
    run_on(cluster, [Task("hangs", work_of("hang"), 0.5), *squares(6)], do, record.listener(), tmp_path)
    ends = record.by_id()
    assert ends["hangs"].status == "failed" and ends["hangs"].attempts == 2
    assert "did not end within its time limit of 0.5 s" in ends["hangs"].error
    assert "synthetic_work.py" in ends["hangs"].error
    assert all(ends[f"square-{k}"].value == k**2 for k in range(6))


def test_a_process_that_stands_still_altogether_is_replaced_by_its_nanny(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_runner, "_GRACE_S", 0.5)
    monkeypatch.setattr(tasks, "MAX_RETRIES", 0)
    record = Record()
    run_on(cluster, [Task("stops", work_of("stop"), 0.5), *squares(4)], do, record.listener())
    ends = record.by_id()
    assert ends["stops"].status == "failed" and "time limit" in ends["stops"].error
    assert all(ends[f"square-{k}"].value == k**2 for k in range(4))
    run_on(cluster, squares(2), do, record.listener())  # the cluster is as good as new


@pytest.mark.nightly
def test_workers_killed_at_random_cost_no_result(cluster: Cluster) -> None:
    rng = np.random.default_rng(5)
    doomed = set(rng.choice(30, size=4, replace=False).tolist())
    record = Record()

    def started(task: Task, number: int) -> None:
        if len(record.starts) in doomed:
            pids = list(cluster.client.run(os.getpid, on_error="ignore").values())
            os.kill(int(rng.choice([pid for pid in pids if isinstance(pid, int)])), signal.SIGKILL)
        record.starts.append((task.id, number))

    todo = [Task(f"{k}", work_of("sleep", s=0.05, n=k), 60) for k in range(30)]
    run_on(cluster, todo, do, TaskListener(started, record.ends.append))
    ends = record.by_id()
    assert {end.task.id: end.value for end in ends.values()} == {f"{k}": k for k in range(30)}
    assert max(end.attempts for end in ends.values()) <= 3


def test_what_one_case_makes_for_others_is_made_once_at_a_time_and_first(cluster: Cluster) -> None:
    record = Record()
    todo = [Task(f"{group}{k}", work_of("sleep", s=0.05), 60, shares=group) for group in "abc" for k in range(3)]
    running: dict[str, str] = {}
    ended: set[str] = set()

    def started(task: Task, number: int) -> None:
        assert task.shares in ended or task.shares not in running.values()
        running[task.id] = task.shares or ""
        record.starts.append((task.id, number))

    def end(ended_task: TaskResult) -> None:
        ended.add(running.pop(ended_task.task.id))
        record.ends.append(ended_task)

    run_on(cluster, todo, do, TaskListener(started, end))
    assert len(record.by_id()) == 9
    assert [name for name, _ in record.starts][:3] == ["a0", "b0", "c0"]


@pytest.mark.parametrize("here", [True, False])
def test_a_full_disk_ends_the_run_with_one_sentence(cluster: Cluster, here: bool) -> None:
    record = Record()
    todo = [*squares(2), Task("full", work_of("full"), 60), Task("never", work_of("sleep", s=30), 60)]
    said = r"^/full/disk: cannot be written \(No space left on device\); .*--resume"
    run = run_serial if here else partial(run_on, cluster)
    with pytest.raises(OutOfSpaceError, match=said):
        run(todo, do, record.listener())
    assert "never" not in {end.task.id for end in record.ends}


def test_in_this_process_tasks_run_in_order_and_failures_are_noted() -> None:
    record = Record()
    run_serial(
        [Task("raises", work_of("raise"), 1), *squares(3), Task("pid", work_of("where"), 1)], do, record.listener()
    )
    assert [end.task.id for end in record.ends] == ["raises", "square-0", "square-1", "square-2", "pid"]
    assert record.ends[0].status == "failed" and record.ends[-1].value[0] == os.getpid()


def test_what_a_listener_raises_ends_the_run_and_frees_the_workers(cluster: Cluster) -> None:
    def refuse(end: TaskResult) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_on(cluster, [*squares(1), Task("long", work_of("sleep", s=0.5), 60)], do, TaskListener(ended=refuse))
    time.sleep(0.6)
    record = Record()
    run_on(cluster, squares(4), do, record.listener())
    assert len(record.by_id()) == 4


def test_a_scheduler_elsewhere_is_used_and_its_workers_with_the_resources_alone(address: str) -> None:
    with open_cluster(scheduler=address) as elsewhere:
        record = Record()
        run_on(elsewhere, squares(4), do, record.listener())
        assert len(record.by_id()) == 4
    with open_cluster(scheduler=address, resources={"GPU": 1.0}) as choosy:
        assert choosy.workers() == {}


def test_workers_at_work_are_never_taken_for_gone(address: str) -> None:
    """Dask's client keeps a note of the scheduler, refreshed in its own thread without the workers."""
    with config.set({"distributed.client.scheduler-info-interval": "1ms"}), open_cluster(scheduler=address) as busy:
        assert all(busy.workers() for _ in range(500))


def test_a_scheduler_that_is_gone_is_told_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackers.scheduler._CONNECT_S", 3.0)  # to connect and, once it is gone, to give up
    with (
        LocalCluster(n_workers=1, processes=False, dashboard_address="127.0.0.1:0") as theirs,
        open_cluster(scheduler=theirs.scheduler_address) as elsewhere,
    ):
        left = TaskListener(ended=lambda end: theirs.close())
        with pytest.raises(InputError, match=r"^the Dask scheduler does not answer any more; .*--resume"):
            run_on(elsewhere, [Task(str(k), work_of("sleep", s=0.6), 60) for k in range(6)], do, left)


def test_bad_places_are_told_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackers.scheduler._CONNECT_S", 0.2)
    with pytest.raises(InputError, match=r"^--scheduler tcp://127.0.0.1:9: nobody answers there"):
        open_cluster(scheduler="tcp://127.0.0.1:9").__enter__()


@pytest.mark.parametrize(
    "address",
    ["nonsense", "nonsense://x", "nonsense://x:1", "tcp://", "tcp://x", "x:port", "tcp://x:99999", "tcp://[x:1", ""],
)
def test_what_is_no_address_of_a_scheduler_is_said_at_once(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "create_connection", lambda *arguments, **options: pytest.fail("somebody was asked"))
    with pytest.raises(
        InputError, match=rf"^--scheduler {re.escape(address)}: is no address.*tcp://host:8786, is expected$"
    ):
        open_cluster(scheduler=address).__enter__()


def test_a_host_that_does_not_exist_and_one_that_is_no_scheduler_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"^--scheduler tcp://nobody.invalid:8786: nobody answers there \("):
        open_cluster(scheduler="tcp://nobody.invalid:8786").__enter__()
    monkeypatch.setattr("trackers.scheduler._ANSWER_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        port = mute.getsockname()[1]
        with pytest.raises(InputError, match=rf"^--scheduler tcp://127.0.0.1:{port}: nobody answers there \("):
            open_cluster(scheduler=f"tcp://127.0.0.1:{port}").__enter__()
    for text in ("GPU", "GPU=x", "=1", "GPU=0", "GPU=nan"):
        with pytest.raises(InputError, match=r"^--resource .*: is no resource; NAME=N"):
            read_resources([text])
    assert read_resources(["GPU=1", "lidar=2"]) == {"GPU": 1.0, "lidar": 2.0}


def listening() -> set[int]:
    """Ports at which this process or one of its descendants listens."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    found = [each for process in processes for each in process.net_connections("tcp")]
    return {each.laddr.port for each in found if each.status == psutil.CONN_LISTEN}


def test_who_has_not_the_certificate_of_the_run_cannot_reach_its_scheduler_or_workers() -> None:
    from distributed import Client
    from distributed.security import Security

    before = listening()
    with open_cluster(jobs=1) as cluster:  # of its own: those that other tests kill workers of are never quite at rest
        assert cluster.local is not None
        cluster.client.wait_for_workers(1, timeout=60)
        addresses = [cluster.local.scheduler_address, *cluster.client.scheduler_info(n_workers=-1)["workers"]]
        assert len(addresses) >= 2 and all(each.startswith("tls://") for each in addresses)
        for address in addresses:
            host, _, port = address.removeprefix("tls://").rpartition(":")
            for scheme, security in (("tcp", None), ("tls", Security.temporary())):
                with pytest.raises((OSError, TimeoutError)):
                    Client(f"{scheme}://{host}:{port}", timeout=2, set_as_default=False, security=security)
        ports = listening() - before
        assert len(ports) >= len(addresses)
        for port in ports:  # no web page either
            with pytest.raises((OSError, HTTPException)), urlopen(f"http://127.0.0.1:{port}/health", timeout=5):
                pass


def test_workers_that_cannot_be_started_are_told_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(self: PrivateCluster) -> None:
        try:
            raise OSError(errno.EMFILE, "Too many open files")
        except OSError as error:
            raise RuntimeError("Nanny failed to start.") from error

    monkeypatch.setattr(PrivateCluster, "_correct_state", start)
    with pytest.raises(InputError, match=r"^--jobs 1: the workers cannot be started \(.*Too many open files\); memory"):
        open_cluster(jobs=1).__enter__()


_INTERRUPTED = """
import signal, time
from twin.suites import local_cluster
from twin.suites.cluster import open_cluster

begin = local_cluster._Nanny.instantiate

async def told(nanny):
    print("starting", flush=True)
    return await begin(nanny)

def stop(number, frame):
    raise KeyboardInterrupt

if __name__ == "__main__":
    local_cluster._Nanny.instantiate = told
    signal.signal(signal.SIGINT, stop)
    try:
        with open_cluster(jobs=2):
            time.sleep(60)
    except KeyboardInterrupt:
        print("interrupted")
"""


def _log_later() -> None:
    """Log in a worker as Dask does in its loop, at the level that a server has that closed."""
    logger = logging.getLogger("distributed")
    for handler in logger.handlers:
        handler.setLevel(logging.NOTSET)
    logger.warning("from a worker")


@pytest.mark.parametrize("name", ["distributed", "distributed.core", "root"])
def test_dask_is_silent_to_the_end_of_a_run_and_only_in_it(
    name: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its connections end after it has closed."""
    core, close = logging.getLogger("distributed.core"), local_cluster._Scheduler.close
    written, ended = StringIO(), Event()
    handler, logger = logging.StreamHandler(written), logging.getLogger(name)
    monkeypatch.setattr(logging.getLogger("distributed"), "propagate", name == "root")

    async def close_and_log(scheduler: local_cluster._Scheduler, *arguments: Any, **options: Any) -> None:
        await close(scheduler, *arguments, **options)
        handler.setLevel(logging.NOTSET)
        core.warning("a stream ended")
        ended.set()

    monkeypatch.setattr(local_cluster._Scheduler, "close", close_and_log)
    logger.addHandler(handler)
    try:
        with open_cluster(jobs=1) as opened:
            opened.client.run(_log_later)
        assert ended.is_set()
        core.warning("of the user's own")
    finally:
        logger.removeHandler(handler)
    assert "a stream" not in written.getvalue() and written.getvalue().endswith("of the user's own\n")
    assert "a worker" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("after_s", [0.2, 1.0])
def test_an_interrupt_while_workers_start_ends_them_without_a_traceback(after_s: float, tmp_path: Path) -> None:
    """A terminal sends it to every process."""
    (tmp_path / "interrupted.py").write_text(_INTERRUPTED)
    command = [sys.executable, str(tmp_path / "interrupted.py")]
    scratch, here = tmp_path / "scratch", tmp_path / "here"
    for folder in (scratch, here):
        folder.mkdir()
    (here / "signal.py").write_text("print('the module of the user')")  # nothing to those that start
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(scratch)},
        cwd=here,
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "starting\n"
        time.sleep(after_s)
        os.killpg(running.pid, signal.SIGINT)
        said, _ = running.communicate(timeout=60)
    assert set(said.split()) <= {"starting", "interrupted"} and running.returncode == 0
    assert {each.name for each in scratch.iterdir()} <= {"dask-scratch-space"}  # of the scheduler, and empty
