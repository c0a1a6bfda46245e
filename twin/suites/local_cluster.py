"""Dask's processes of this machine without their web servers, which other users of the machine could read."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import resource_tracker
from typing import Any, cast

from distributed import LocalCluster, Nanny, Scheduler, SpecCluster, Worker

_of_thread = threading.local()


def _is_of_others(record: logging.LogRecord) -> bool:
    """Return False for records of Dask in the thread of a run's own servers; each is filtered where it is logged."""
    return not (getattr(_of_thread, "is_ours", False) and record.name.split(".")[0] == "distributed")


def _silence_thread() -> None:
    """Write no records of Dask that this thread logs, up to its end."""
    _of_thread.is_ours = True
    logging.getLogger("distributed")
    for name, logger in [(None, logging.getLogger()), *logging.root.manager.loggerDict.items()]:
        if isinstance(logger, logging.Logger) and (name is None or name.split(".")[0] == "distributed"):
            for handler in logger.handlers:
                handler.addFilter(_is_of_others)


class _Private:
    """Server of Dask that is seen and heard by nobody but its run."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Silence Dask in this thread, that of the server's loop, up to its end.

        `silence_logs` ends while the server closes, and connections that end later are still written.
        """
        _silence_thread()
        super().__init__(*arguments, **options)

    def start_http_server(self, *arguments: Any, **options: Any) -> None:
        """Start none: it would show tasks, logs and call stacks to everybody on this machine."""


class _Scheduler(_Private, Scheduler):
    """Scheduler that answers only who has the certificate of the run."""


class _Worker(_Private, Worker):
    """Worker that answers only who has the certificate of the run."""


class _Nanny(Nanny):
    """Process that keeps one such worker alive."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options, worker_class=_Worker)

    async def instantiate(self) -> Any:
        """Start the worker's process with SIGINT blocked: a terminal sends Ctrl-C to it too, while it can tell tracebacks alone.

        Signals that the thread of this loop blocks are blocked in processes that it starts, once Python's resource tracker
        runs, whose start unblocks them.
        """
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        return await super().instantiate()


class _OfOurScheduler(SpecCluster):
    def __init__(self, *, scheduler: Mapping[str, Any], **options: Any) -> None:
        super().__init__(scheduler={**scheduler, "cls": _Scheduler}, **options)


def _is_news(record: logging.LogRecord) -> bool:
    """Return False for the failed start of a worker that was ended meanwhile, which nobody waits for any more."""
    return record.exc_info is None or not str(record.exc_info[1]).endswith(" failed to start.")


class PrivateCluster(LocalCluster, _OfOurScheduler):
    """Scheduler and workers of this machine that listen for holders of the run's certificate alone."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, worker_class=_Nanny, dashboard_address=cast("str", None))

    def close(self, timeout: float | None = None) -> Any:
        """Close, also while workers start: Dask asserts that none does, and they end with this process."""
        logging.getLogger("asyncio").addFilter(_is_news)
        with suppress(AssertionError):
            return super().close(timeout)
