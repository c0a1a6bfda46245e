"""People on a pressure floor: what they cost, where their weight is felt, and how well recorded paths are kept."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figure import Figure
from benchmarks.penetration import PenetrationCheck
from trackers.configuration import validate
from twin.people.script.recorded import BODIES_NEED_M
from twin.scenario import Scenario
from twin.scenario.action import RecordedPath
from twin.scenario.pedestrians import Pedestrians, people_from
from twin.world.body_pool import body_pools
from twin.world.simulation import Simulation
from twin.world.world import World

_DATA = Path(__file__).parents[3] / "shared" / "data" / "trajectories"
_WARM_UP_S, _MEASURED_S = 2.0, 20.0
_WALKS_M_S = 0.5


def _scenario(people: dict[str, Any], sensors: dict[str, Any], *, room: str = "plaza", **more: Any) -> Scenario:
    content = {"name": "bench", "room": room, "people": people, "sensors": sensors, "background": "none"} | more
    return validate(Scenario, content, "benchmark")


def _floor(pitch_m: float, **more: Any) -> dict[str, Any]:
    mount = {"xyz": [-9 * pitch_m, -7 * pitch_m, 0]}
    return {
        "floor": {"kind": "floor", "rate_hz": 10, "rows": 14, "columns": 18, "pitch_m": pitch_m, "mount": mount} | more
    }


def floor_real_time() -> Iterator[Figure]:
    """A floor of 252 elements with everybody on it, truth included, without images: seconds simulated a CPU second."""
    spent = {}
    for count, pitch_m, target in ((5, 0.2, ">= 30"), (20, 0.4, ">= 8")):
        half = np.array([9 * pitch_m, 7 * pitch_m])
        area = [[-half[0], -half[1]], [half[0], -half[1]], [half[0], half[1]], [-half[0], half[1]]]
        people = {f"p{number:02d}": {} for number in range(count)}
        scenario = _scenario(people, _floor(pitch_m), area=area, duration_s=_WARM_UP_S + _MEASURED_S)
        with Simulation(scenario, on_truth=lambda frame: None) as simulation:
            start = 0.0
            for observation in simulation:
                if observation.t < _WARM_UP_S:
                    start = time.process_time()
            spent[count] = time.process_time() - start
        yield Figure(f"floor of 252 elements, {count} people", _MEASURED_S / spent[count], "× real time", target)
    yield Figure("cost a person: 20 people over 5", spent[20] / spent[5] * 5 / 20, "×", "<= 1")


def floor_truth() -> Iterator[Figure]:
    """Compute where the weight of people who stand still acts, over the whole grid, and how much of it."""
    rng = np.random.default_rng(1000)
    worst_m, worst_share = 0.0, 0.0
    cells_m: list[float] = []
    for _ in range(12):
        x, y = np.meshgrid(np.linspace(-1.4, 1.4, 3), np.linspace(-1.0, 1.0, 3))
        places = np.stack([x.ravel(), y.ravel()], axis=-1) + rng.uniform(-0.09, 0.09, (9, 2))
        people = {
            f"p{number}": {
                "start": place.tolist(),
                "heading_deg": float(rng.uniform(-180, 180)),
                "script": {"kind": "stand"},
            }
            for number, place in enumerate(places)
        }
        scenario = _scenario(people, _floor(0.2, noise="off"), duration_s=1.2)
        with Simulation(scenario) as simulation:
            deliveries = list(simulation.deliveries())
            truth = deliveries[-1].reading.truth
            feet = simulation.world.snapshot(deliveries[-1].encoded.observation.t).feet
            assert feet is not None
            centres = simulation.rig.floors()["floor"].centres.reshape(-1, 2)
            for person in range(len(people)):
                mine = truth["person"] == person
                newton, cell = truth["newton"][mine], truth["cell"][mine]
                by_cells = (newton[:, None] * centres[cell]).sum(axis=0) / newton.sum()
                load, carried = feet.load_n[person], truth["foot_n"][person]
                true = (load[:, None] * feet.pressure_point[person]).sum(axis=0) / load.sum()
                felt = (carried[:, None] * truth["centre_m"][person]).sum(axis=0) / carried.sum()
                worst_m = max(worst_m, float(np.linalg.norm(felt - true)))
                cells_m.append(float(np.linalg.norm(by_cells - true)))
                worst_share = max(worst_share, abs(float(newton.sum() / load.sum()) - 1))
    yield Figure("centre of pressure of people standing, by the contacts, worst of 108", 1e3 * worst_m, "mm", "<= 20")
    yield Figure("the same by the middles of 200 mm elements, mean", 1e3 * float(np.mean(cells_m)), "mm", "")
    yield Figure("the same by the middles of 200 mm elements, worst", 1e3 * max(cells_m), "mm", "")
    yield Figure("weight of people standing, worst of 108", 1e2 * worst_share, "%", "<= 0.5")


def crowd_building() -> Iterator[Figure]:
    """Measure the cost of a world of the first 61, and of 480, ETH and UCY pedestrians before the first step."""
    if not _DATA.is_dir():
        return
    paths, first_s = [], 0.0
    for file, rate_hz in (("eth.txt", 15.0), ("zara01.txt", 25.0)):  # one after the other
        people = people_from(Pedestrians(file=str(_DATA / file), frame_rate_hz=rate_hz), 1e5, "benchmark")
        points = [person["script"][0]["points"] for person in people.values()]
        paths += [[[first_s + t, x, y] for t, x, y in path] for path in points]
        first_s = max(path[-1][0] for path in paths)
    paths.sort()
    each_s = {}
    for count in (61, 480):
        people = {
            f"p{number:03d}": {"script": {"kind": "path", "points": path}} for number, path in enumerate(paths[:count])
        }
        low = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.4]}}}
        scenario = _scenario(people, low, duration_s=max(path[-1][0] for path in paths[:count]))
        start = time.process_time()
        World(scenario)
        spent_s = time.process_time() - start
        each_s[count] = spent_s / count
        yield Figure(f"world of {count} pedestrians, CPU time", spent_s, "s", "<= 15" if count == 480 else "")
    yield Figure("the same for one of them: of 480 over of 61", each_s[480] / each_s[61], "×", "<= 1")
    bodies = max(len(pool.names) for pool in body_pools(scenario.people))
    times = np.arange(0.0, scenario.duration_s, 0.5)
    spans = np.array([(path[0][0], path[-1][0]) for path in paths[:480]])
    at_once = ((spans[:, 0] <= times[:, None]) & (times[:, None] <= spans[:, 1])).sum(axis=1).max()
    yield Figure("most people at once, of 480 who come", float(at_once), "", "")
    yield Figure("most bodies at once", float(bodies), "", f"<= {max(32, 3 * at_once)}")


def recorded_paths() -> Iterator[Figure]:
    """Everybody of the ETH and UCY recordings, as bodies: speeds, places, and who walks through whom."""
    if not _DATA.is_dir():
        return
    for file, rate_hz in (("eth.txt", 15.0), ("zara01.txt", 25.0)):
        pedestrians = Pedestrians(file=str(_DATA / file), frame_rate_hz=rate_hz)
        seconds = 1e5
        people, _ = people_from(pedestrians, seconds, "benchmark")
        last = max(person["script"][0]["points"][-1][0] for person in people.values())
        scanner = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.4]}}}
        scenario = _scenario(people, scanner, duration_s=last)
        yield from _kept(scenario, file)


def _kept(scenario: Scenario, file: str) -> Iterator[Figure]:
    world = World(scenario)
    names = world.population.names
    rows = {number: np.array(_points(scenario, name)) for number, name in enumerate(names)}
    stamps = sorted({(round(float(t), 6), number) for number, path in rows.items() for t in path[:, 0] if t >= 0})
    seen: dict[int, list[tuple[float, float, float]]] = {number: [] for number in rows}
    check: PenetrationCheck | None = None
    ids = {number: name for name, number in world.scene.ids.items()}
    extra = pairs = 0
    last_t = -1.0
    for t, number in stamps:
        if t > last_t:
            snapshot = world.snapshot(t)
            truth = world.population.truth(t)
            last_t = t
            if check is None or check.model is not snapshot.model:
                check = PenetrationCheck(snapshot.model, snapshot.person_of_geom)
            for found in check.at(snapshot):
                pairs += 1
                if found.other == 0:
                    extra += 1
                    continue
                first, second = (names.index(ids[each]) for each in (found.person, found.other))
                extra += _apart(rows[first], rows[second], t) > BODIES_NEED_M
        if truth.present[number]:
            seen[number].append((t, float(truth.x[number]), float(truth.y[number])))
    ratios, errors, fast = [], [], []
    for number, path in rows.items():
        ours = np.array(seen[number])
        theirs = path[np.searchsorted(path[:, 0], ours[:, 0] - 1e-5)]
        errors.append(np.linalg.norm(ours[:, 1:] - theirs[:, 1:], axis=1))
        length = np.linalg.norm(np.diff(theirs[:, 1:], axis=0), axis=1).sum()
        if length > 1.0:
            fast.append(length > _WALKS_M_S * (theirs[-1, 0] - theirs[0, 0]))
            ratios.append(np.linalg.norm(np.diff(ours[:, 1:], axis=0), axis=1).sum() / length)
    yield Figure(
        f"{file}: pedestrians who walk", float(sum(len(each) > 1 for each in seen.values())), "", f">= {len(rows)}"
    )
    off = 100 * np.abs(np.array(ratios) - 1)
    walks = np.array(fast)
    yield Figure(
        f"{file}: mean speed off the file's, worst of {walks.sum()} who walk", float(off[walks].max()), "%", "<= 3"
    )
    # who stands shifts the weight from foot to foot, which the file does not have
    yield Figure(
        f"{file}: the same, worst of {(~walks).sum()} who mostly stand", float(off[~walks].max(initial=0)), "%", ""
    )
    yield Figure(f"{file}: mean speed over the file's, all", abs(float(np.mean(ratios)) - 1) * 100, "%", "<= 3")
    yield Figure(
        f"{file}: path error, 95th percentile", float(np.quantile(np.concatenate(errors), 0.95)) * 100, "cm", ""
    )
    yield Figure(f"{file}: path error, worst", float(max(each.max() for each in errors)) * 100, "cm", "<= 5")
    yield Figure(
        f"{file}: penetrations where the file has people closer than {BODIES_NEED_M} m", float(pairs - extra), "", ""
    )
    yield Figure(f"{file}: penetrations that the file does not hold", float(extra), "", "<= 0")


def _points(scenario: Scenario, name: str) -> tuple[tuple[float, float, float], ...]:
    path = scenario.people[name].script[0]
    assert isinstance(path, RecordedPath)
    return path.points


def _apart(first: np.ndarray, second: np.ndarray, t: float) -> float:
    """Distance of two recorded paths at a time [m]."""
    one, other = (np.array([np.interp(t, path[:, 0], path[:, axis]) for axis in (1, 2)]) for path in (first, second))
    return float(np.linalg.norm(one - other))
