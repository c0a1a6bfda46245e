"""Which of the pictures of `twin view` is asked for, and whether its options go together."""

from __future__ import annotations

from pathlib import Path

from trackers.errors import InputError


def check_choice(
    *,
    at: float,
    people: bool,
    video: Path | None,
    start_s: float,
    end_s: float | None,
    follow: str | None,
    out: Path | None,
) -> None:
    """Raise InputError for options of `twin view` that say nothing about the picture that is asked for."""
    if people and video is not None:
        raise InputError("--people: is a picture of its own beside --video; one of the two is expected")
    if people and at:
        raise InputError(
            f"--at {at:g}: says nothing of --people, which shows the whole run; one of the two is expected"
        )
    if video is not None and (at or out is not None):
        option = f"--at {at:g}" if at else f"--out {out}"
        raise InputError(f"{option}: says nothing of a video; --video FILE.mp4 with --from and --to is expected")
    if video is None:
        given = [("--from", start_s or None), ("--to", end_s), ("--follow", follow)]
        for option, value in given:
            if value is not None:
                raise InputError(f"{option} {value}: is about a video; --video FILE.mp4 beside it is expected")
