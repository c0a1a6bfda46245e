"""Connections to a Dask scheduler by address. Dask is imported at a call, not before."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from trackers.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

_ANSWER_S = 8
_CONNECT_S = 10
_SCHEMES = ("tcp", "tls", "ws", "wss")
_EXPECTED = "the address of a running Dask scheduler, like tcp://host:8786, is expected"


def connected(address: str, said: str, direct: bool = False) -> Client:
    """Connect to the Dask scheduler at this address; direct: the client talks to the workers itself.

    said: source of the address, for the error. Raises InputError, within seconds, for an invalid address or one without a
    scheduler.
    """
    from distributed import Client

    check_scheduler(address, said)
    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False, direct_to_workers=direct or None)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{said}: nobody answers there ({error or type(error).__name__}); {_EXPECTED}") from error


def check_scheduler(address: str, said: str) -> None:
    """Raise InputError for an invalid address or one where nothing answers, without Dask."""
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        host, port = parts.hostname, parts.port
    except ValueError as error:  # an invalid port, or an unclosed bracket
        raise InputError(f"{said}: is no address ({error}); {_EXPECTED}") from error
    if parts.scheme == "inproc":  # this process
        return
    if parts.scheme not in _SCHEMES or not host or port is None:
        raise InputError(f"{said}: is no address; {_EXPECTED}")
    try:
        with socket.create_connection((host, port), timeout=_ANSWER_S) as asked:
            if parts.scheme == "tcp" and not asked.recv(
                1
            ):  # a Dask server speaks first; the client waits forever for one that does not
                raise ConnectionError("what listens there says nothing")
    except (OSError, UnicodeError) as error:
        raise InputError(f"{said}: nobody answers there ({error}); {_EXPECTED}") from error
