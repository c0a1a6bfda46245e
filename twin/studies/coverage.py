"""Coverage of every candidate pose of a study, as packed bits, and of any placement."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.errors import InputError
from twin.scenario import Scenario
from twin.scenario.sensor_descriptions import FloorDescription
from twin.studies.apply_placement import apply_placement
from twin.studies.candidate_set import BASELINE, CandidateSet, Placement
from twin.studies.spec import Coverage, Study
from twin.studies.visibility import SampledWorld, SensorVisibility, floor_cells, packed
from twin.suites.cache import RecordingCache
from twin.suites.worker import cached_motion

Bits = NDArray[np.uint64]  # (sensors, words)


class CoverageTargets:
    """The targets of coverage: people at time samples of the coverage's own seeds, or the cells of the floor."""

    def __init__(self, coverage: Coverage, scenario: Scenario, cache: RecordingCache) -> None:
        self.coverage = coverage
        share = (np.arange(coverage.samples) + 0.5) / max(coverage.samples, 1)
        times = (share * scenario.duration_s).tolist()
        self.sampled_worlds = []
        for seed in coverage.seeds if times else coverage.seeds[:1]:
            seeded = scenario.model_copy(update={"seed": seed})
            self.sampled_worlds.append(SampledWorld(seeded, cached_motion(cache, seeded), times))
        self.cells_m = floor_cells(self.sampled_worlds[0].area, coverage.cell_m)
        if coverage.of == "people" and not self.n:
            raise InputError(
                f"coverage: no person is in the tracked area of {scenario.name} at any of {coverage.samples} samples; more "
                "samples, or of: floor, is expected"
            )

    @property
    def n(self) -> int:
        """Number of rows: of the floor one per height that cameras look for."""
        if self.coverage.of == "people":
            return sum(sampled.n_person_frame for sampled in self.sampled_worlds)
        return (
            len(self.cells_m) * max(1, self.coverage.samples) * len(self.sampled_worlds) * len(self.coverage.heights_m)
        )

    def visibility_bits(self, scenario: Scenario, names: Iterable[str]) -> Bits:
        """Return what each of a scenario's sensors sees, (sensors, words); pressure floors are left out."""
        found = []
        for name in names:
            if isinstance(scenario.sensors[name], FloorDescription):
                continue
            visibility = SensorVisibility(scenario, name, self.coverage)
            if self.coverage.of == "people":
                visible = np.concatenate([visibility.people(sampled) for sampled in self.sampled_worlds])
            else:
                visible = np.concatenate([self._cells(visibility, sampled) for sampled in self.sampled_worlds])
            found.append(packed(visible))
        return np.array(found) if found else np.zeros((0, -(-self.n // 64)), dtype=np.uint64)

    def _cells(self, visibility: SensorVisibility, sampled: SampledWorld) -> NDArray[np.bool_]:
        """Return the visible cells; a scanner has one height, and sees a cell at every height or none."""
        visible = visibility.floor(sampled, self.cells_m).reshape(max(1, self.coverage.samples), -1, len(self.cells_m))
        heights = len(self.coverage.heights_m)
        return np.broadcast_to(visible, (visible.shape[0], heights, visible.shape[2])).reshape(-1)

    def worst_cell(self, covered: Bits) -> float:
        """Return the share of visible rows (words,) at the worst position: a cell of the floor, or a square metre of paths."""
        bits = np.unpackbits(covered.view(np.uint8), count=self.n).astype(float)
        if self.coverage.of == "floor":
            return float(bits.reshape(-1, len(self.cells_m)).mean(axis=0).min())
        places = np.concatenate([each.heads_m[:, :2] for sampled in self.sampled_worlds for each in sampled.samples])
        _, cell = np.unique(np.floor(places), axis=0, return_inverse=True)
        return float((np.bincount(cell.ravel(), bits) / np.bincount(cell.ravel())).min())


def at_least(bits: Bits, k: int) -> NDArray[np.uint64]:
    """Return the rows (words,) that at least k of the sensors (m, words) see."""
    reached = np.zeros((k, bits.shape[1]), dtype=np.uint64)
    for each in bits:
        for level in range(k - 1, 0, -1):
            reached[level] |= reached[level - 1] & each
        reached[0] |= each
    return reached[k - 1]


def count_bits(words: NDArray[np.uint64]) -> int:
    """Count the bits that are set."""
    return int(np.bitwise_count(words).sum())


class PoseCoverage:
    """Visibility bits of candidate poses, computed on first use, and of the fixed sensors."""

    def __init__(self, study: Study, candidate_set: CandidateSet, cache: RecordingCache) -> None:
        self._study = study
        self._layout = candidate_set
        self.targets = CoverageTargets(study.coverage, candidate_set.scenario, cache)
        moved = apply_placement(study, candidate_set.scenario, [candidate_set.poses[0]])
        self._baseline = list(candidate_set.scenario.sensors)
        self._static = [
            name for name in moved.sensors if moved.sensors[name] == candidate_set.scenario.sensors.get(name)
        ]
        self._bits: dict[int, Bits] = {}

    @cached_property
    def fixed(self) -> Bits:
        """The visibility bits of the sensors that no pose moves."""
        return self.targets.visibility_bits(self._layout.scenario, self._static)

    def bits(self, pose: int) -> Bits:
        """Return what the sensors of one candidate pose see, (sensors, words)."""
        if pose not in self._bits:
            without_faults = self._layout.scenario.model_copy(update={"faults": {}})
            alone = apply_placement(self._study, without_faults, [self._layout.poses[pose]])
            names = [name for name in alone.sensors if name not in self._static]
            self._bits[pose] = self.targets.visibility_bits(alone, names)
        return self._bits[pose]

    def blind_devices(self) -> dict[str, int]:
        """Return the devices none of whose poses shows anything, each with the number of its poses; none that was not worked."""
        poses: dict[str, list[int]] = {}
        for pose, each in enumerate(self._layout.poses):
            poses.setdefault(each.device, []).append(pose)
        seen = {pose for pose, bits in self._bits.items() if bits.any()}
        return {
            device: len(own) for device, own in poses.items() if self._bits.keys() >= set(own) and seen.isdisjoint(own)
        }

    def covered(self, placement: Placement) -> NDArray[np.uint64]:
        """Return the rows (words,) that enough sensors of a placement see, including fixed ones."""
        if placement == BASELINE:
            return at_least(
                self.targets.visibility_bits(self._layout.scenario, self._baseline), self._study.coverage.at_least
            )
        every = np.concatenate([self.fixed, *(self.bits(each) for each in placement)])
        return at_least(every, self._study.coverage.at_least)

    def share(self, placement: Placement) -> float:
        """Return the share of rows that enough sensors see."""
        return count_bits(self.covered(placement)) / self.targets.n

    def worst(self, placement: Placement) -> float:
        """Return the share of visible rows at the worst position."""
        return self.targets.worst_cell(self.covered(placement))

    def counts(self, poses: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return per distinct row the sensors of each pose that see it (n, r), the fixed ones (r,), and its frequency (r,).

        Counts are limited to `at_least`.
        """
        most = self._study.coverage.at_least
        number = np.stack([_summed(self.bits(each), self.targets.n, most) for each in (*poses,)])
        stay = _summed(self.fixed, self.targets.n, most)
        columns = np.ascontiguousarray(np.concatenate([number, stay[None]]).T)
        _, first, weight = np.unique(
            columns.view(np.dtype((np.void, columns.shape[1]))).ravel(), return_index=True, return_counts=True
        )
        distinct = columns[first].T
        return distinct[:-1].astype(float), distinct[-1].astype(float), weight.astype(float)


def _summed(bits: Bits, n: int, most: int) -> NDArray[np.uint8]:
    """Count the sensors (m, words) that see each row, at most `most`, (n,)."""
    if not len(bits):
        return np.zeros(n, dtype=np.uint8)
    each = np.unpackbits(np.ascontiguousarray(bits).view(np.uint8), axis=1, count=n)
    return np.minimum(each.sum(axis=0), most).astype(np.uint8)
