"""Plausibility of a table of people: walking speeds, and coordinates that look like heights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.tables.headerless import HEIGHT_SPREAD_M
from twin.tables.person_rows import PersonRows

WALKING_M_S = (0.5, 2.5)
"""Median walking speeds of a recording of pedestrians lie between these [m/s]."""
IMPOSSIBLE_M_S = 12.0
"""Nobody runs faster [m/s]."""
_LEAST_WAY_M = 1.0
_MOVING_SHARE = 0.2
"""Of a person's fastest: what is slower is standing, at any unit and rate."""
_SPAN_S = 0.5
"""Speeds are taken over so long at least: noise of places does not count as walking [s]."""


def check_plausibility(found: PersonRows) -> tuple[str, ...]:
    """Return warnings about a table of people; raise InputError where its layout cannot be as guessed."""
    source = found.rows.source
    x, y = (found.rows.numbers(name, may_be_empty=False) for name in "xy")
    z = found.rows.numbers("z", may_be_empty=True) if "z" in found.rows.cells else np.zeros(0)
    notes = [_height(source, x, y, z[np.isfinite(z)], len(set(found.labels)))]
    speed = walking_speed(found, x, y)
    slowest, fastest = WALKING_M_S
    if speed is not None and not slowest <= speed <= fastest:
        text = f"{source}: people walk at {speed:.3g} m/s in the median, where {slowest:g} to {fastest:g} m/s are usual"
        text += f"; {_remedy(speed, found)}"
        if speed > IMPOSSIBLE_M_S:
            raise InputError(f"{text} are expected")
        notes.append(f"{text} may be wrong")
    return tuple(note for note in notes if note)


def walking_speed(found: PersonRows, x: NDArray[np.float64], y: NDArray[np.float64]) -> float | None:
    """Compute the median over people who get somewhere of their median speed while they move [m/s]; None without any."""
    number = found.ids()
    order = np.lexsort((found.stamps_ns, number))
    medians = []
    for rows in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        t = found.stamps_ns[rows] / NS_PER_S
        if rows.size < 2:
            continue
        apart = max(1, min(rows.size - 1, round(_SPAN_S / float(np.median(np.diff(t))))))
        speeds = np.hypot(x[rows][apart:] - x[rows][:-apart], y[rows][apart:] - y[rows][:-apart]) / (
            t[apart:] - t[:-apart]
        )
        moving = speeds[speeds > _MOVING_SHARE * np.quantile(speeds, 0.95)]
        if moving.size and max(np.ptp(x[rows]), np.ptp(y[rows])) >= _LEAST_WAY_M:
            medians.append(float(np.median(moving)))
    return float(np.median(medians)) if medians else None


def _remedy(speed: float, found: PersonRows) -> str:
    """Name the unit or rate that would make the speed usual."""
    slowest, fastest = WALKING_M_S
    for unit, size in (("cm", 100.0), ("mm", 1000.0)):
        if slowest <= speed / size <= fastest:
            return f"lengths in {unit} would fit: a header that says so, as x/{unit}, or another unit of time"
    if "frame" in found.rows.cells:
        rate_hz = found.rows.units["t"] * 1.3 / speed
        return f"a frame rate of about {rate_hz:.2g} Hz would fit: the rate {found.rows.units['t']:g} Hz, or the unit of x and y,"
    return "the unit of t, or of x and y,"


def _height(source: str, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], n_person: int) -> str:
    """Warn where x or y varies as heights do; raise InputError where the column z varies as coordinates do instead."""
    if x.size < 2:
        return ""
    wide = {name: float(np.ptp(np.quantile(each, [0.05, 0.95]))) for name, each in (("x", x), ("y", y))}
    flat, other = ("x", "y") if wide["x"] < wide["y"] else ("y", "x")
    if wide[flat] >= HEIGHT_SPREAD_M or wide[other] < 3 * HEIGHT_SPREAD_M or n_person < 2:
        return ""
    text = f"{source}: {flat} looks like a height: it varies by {wide[flat]:.2g} m where {other} varies by {wide[other]:.3g} m"
    if z.size > 1 and (across := float(np.ptp(np.quantile(z, [0.05, 0.95])))) > 3 * HEIGHT_SPREAD_M:
        raise InputError(
            f"{text} and z by {across:.3g} m; a header that calls the two coordinates of the floor x and y is expected"
        )
    return f"{text}; if it is one, a header that calls the two coordinates of the floor x and y is needed"
