"""Workers for tasks: processes of this machine, or those of a Dask scheduler."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, cast

from trackers.errors import InputError
from trackers.scheduler import check_scheduler, connected
from trackers.user_input.plain_data import parse_number

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

_CLOSE_S = 15
_ENDING_S = 5.0
"""Workers that were ended may write for so long [s]."""
_SAFE_PATH = "PYTHONSAFEPATH"

ENVIRONMENT = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
"""Environment of workers that share the cores: renderer, linear algebra and OpenCV use one thread."""

_CONFIGURATION = {
    "distributed.worker.multiprocessing-method": "spawn",  # a process forked after rendering hangs
    "distributed.scheduler.allowed-failures": 0,  # retries are counted by us, and a death is reported at once
    "distributed.worker.profile.enabled": False,
    # Dask's housekeeping runs up to 50 times a second in every process and rebalances work; our tasks take seconds and
    # are placed by us. At the default rate it took 4 % of a core of the two that the workers need.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "60s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.logging": {"distributed": "critical"},  # deaths and restarts are reported by us
}


@dataclass(frozen=True)
class Cluster:
    """Open connection to workers, one task at a time on each.

    resources: those a task needs, as in `dask worker --resources GPU=1`; dashboard: its address, None without one; local:
    the cluster of `n_worker` processes of ours.
    """

    client: Client
    dashboard: str | None
    local: LocalCluster | None
    n_worker: int
    resources: Mapping[str, float] = field(default_factory=dict)

    def replace_missing(self, n_there: int) -> None:
        """Start processes of ours in place of those that died.

        A nanny whose worker dies soon after its start does not start it again; another nanny has to.
        """
        if self.local is not None and n_there < self.n_worker:
            self.local.scale(len(self.local.worker_spec) + self.n_worker - n_there)

    def workers(self) -> dict[str, bool] | None:
        """List the workers with the resources: by address, whether each accepts work.

        One that does not, for lack of memory for example, may still be at work. None where the scheduler does not answer
        now; raises InputError where the client has given it up.
        """
        if self.client.status in ("closing", "closed"):
            raise InputError(
                "the Dask scheduler does not answer any more; a running one is expected, and --resume then does the rest"
            )
        scheduler: Any = self.client.scheduler
        try:
            # Not `scheduler_info()`, whose data the client's own thread sometimes overwrites with no workers.
            known = cast("Any", self.client.sync(scheduler.identity, n_workers=-1))["workers"]
        except OSError:
            return None
        return {
            address: worker.get("status", "running") == "running"
            for address, worker in sorted(known.items())
            if worker.get("status") not in ("closing", "closed", "failed")
            and all(worker.get("resources", {}).get(name, 0) >= need for name, need in self.resources.items())
        }


def core_count() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_cluster(
    jobs: int | None = None, scheduler: str | None = None, resources: Mapping[str, float] | None = None
) -> Iterator[Cluster]:
    """Open `jobs` processes of this machine (None: one per core), or connect to the scheduler at this address.

    Raises InputError where no scheduler answers.
    """
    from dask import config
    from distributed import Client
    from distributed.security import Security

    needs = dict(resources or {})
    n_worker, local = (jobs or core_count()) if scheduler is None else 0, None
    with ExitStack() as stack:
        if scheduler is None:
            scratch = stack.enter_context(_scratch_folder())
            stack.enter_context(_without_current_folder())
            stack.enter_context(config.set(_CONFIGURATION))
            local = _started(
                n_workers=n_worker,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                # Access to a scheduler means running code as its user: this run's certificate, never on disk, keeps
                # others out.
                security=Security.temporary(),
                silence_logs=50,
                env={**ENVIRONMENT, "TMPDIR": scratch},
                local_directory=scratch,
                resources=needs,
            )
            stack.callback(_close, local)
            client = Client(local, set_as_default=False)
        else:
            client = connected(scheduler, f"--scheduler {scheduler}")
        stack.callback(_close, client)
        dashboard = client.dashboard_link if scheduler is not None else None
        yield Cluster(client, dashboard or None, local, n_worker, needs)


@contextmanager
def _scratch_folder() -> Iterator[str]:
    """Yield a folder for this run, and remove it with what workers were writing that are ended, or that still end."""
    folder = mkdtemp(prefix="roomtwin-")
    try:
        yield folder
    finally:
        until_s = time.monotonic() + _ENDING_S
        while os.path.exists(folder) and time.monotonic() < until_s:
            rmtree(folder, ignore_errors=True)
            time.sleep(0.02)


@contextmanager
def _without_current_folder() -> Iterator[None]:
    """Keep the modules of the current folder from those that processes import first: a `random.py` there is the user's."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(_SAFE_PATH)
        os.environ.update({} if before is None else {_SAFE_PATH: before})


def _started(n_workers: int, **options: Any) -> LocalCluster:
    """Start processes of this machine. Raises InputError where they cannot be started, or one dies meanwhile."""
    from twin.suites.local_cluster import PrivateCluster

    try:
        return PrivateCluster(n_workers=n_workers, **options)
    except (RuntimeError, OSError) as error:
        causes: list[BaseException] = [error]
        while (cause := causes[-1].__cause__ or causes[-1].__context__) is not None:
            causes.append(cause)
        what = str(causes[-1]) or type(causes[-1]).__name__
        raise InputError(
            f"--jobs {n_workers}: the workers cannot be started ({what}); memory and open files (ulimit -v, -n) for so "
            "many processes, or --jobs 1, are expected"
        ) from error


def _close(opened: Client | LocalCluster) -> None:
    """Close; workers that take longer, for example while starting, end with this process."""
    with suppress(TimeoutError):
        opened.close(timeout=_CLOSE_S)


def read_resources(texts: Sequence[str]) -> dict[str, float]:
    """Parse 'NAME=N' texts as Dask resources. Raises InputError for any other text."""
    resources = {}
    for text in texts:
        name, _, value = text.partition("=")
        need = parse_number(value) or 0
        if not name or need <= 0:
            raise InputError(
                f"--resource {text}: is no resource; NAME=N with a number above 0, like GPU=1, is expected"
            )
        resources[name] = float(need)
    return resources


@dataclass(frozen=True)
class Workers:
    """Workers of a run: `jobs` processes here (None: one per core; 1: this very process), or those of a Dask scheduler."""

    jobs: int | None = None
    scheduler: str | None = None
    resources: Mapping[str, float] | None = None


def parse_workers(jobs: int | None, scheduler: str | None, resource: list[str] | None) -> Workers:
    """Make the workers chosen by the command's options.

    Raises InputError where both kinds are given, for a bad resource, for one without a scheduler, and where no scheduler
    answers: before the cases are checked, which takes seconds.
    """
    if scheduler is not None and jobs is not None:
        raise InputError(
            f"--jobs {jobs} --scheduler {scheduler}: a scheduler has its own workers; one of them is expected"
        )
    if resource and scheduler is None:
        raise InputError(
            f"--resource {' --resource '.join(resource)}: is of a scheduler's workers; --scheduler ADDRESS beside it is expected"
        )
    workers = Workers(jobs, scheduler, read_resources(resource or []))
    if scheduler is not None:
        check_scheduler(scheduler, f"--scheduler {scheduler}")
    return workers
