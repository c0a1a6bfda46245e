"""Map of a run: true paths, paths of tracks, errors and events over the room or over the scans' returns."""

from __future__ import annotations

import base64
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S, LaserScan, Odometry
from trackers.rig import Rig
from twin.evaluate.causes import FALSE_POSITIVES, MISSES, Errors
from twin.evaluate.summary import Evaluation
from twin.recording.tables import TrackTable, TruthTable
from twin.report.assumed_poses import assumed_poses_svg
from twin.report.birdseye import (
    FloorView,
    Polygon,
    ScannerOnFloor,
    Site,
    floor_extent,
    room_svg,
    sensor_names_svg,
    svg_path,
)
from twin.report.metrics_table import METRICS
from twin.report.palette import IdentityColours, SvgLabels
from twin.report.time_axis import median_period_ns, split_at_gaps
from twin.report.timeline import describe_event

_WIDTH_PX = 1000
_STANDING = 0.05  # share of the greatest count above which a cell is static
_LONG_NS = 90 * NS_PER_S  # duration beyond which overlapping paths are drawn lighter


@dataclass(frozen=True, eq=False)
class Drive:
    """Way of a moving base by its odometry: name, sensors on it, stamps (n,) [ns] and places (n, 2) [m, room frame]."""

    base: str
    sensors: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    xy: NDArray[np.float64]

    @classmethod
    def of(cls, rig: Rig, moved: Mapping[str, tuple[NDArray[np.int64], NDArray[np.float64]]]) -> list[Drive]:
        """Return the way of each base of a rig, from its stamps and places (n, 3) in its odometry frame."""
        mounted, drives = rig.mounted(), []
        for base, (stamps_ns, places) in moved.items():
            room_from_frame = rig.pose_at(base)
            xy = (places @ room_from_frame.rotation.T + room_from_frame.translation)[:, :2]
            on_it = tuple(name for name, each in mounted.items() if each == base)
            drives.append(cls(base, on_it, stamps_ns, xy))
        return drives

    def at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Interpolate the places at these stamps (n,), (n, 2) [m]."""
        order = np.argsort(self.stamps_ns, kind="stable")
        return np.column_stack([np.interp(stamps_ns, self.stamps_ns[order], each[order]) for each in self.xy.T])


def standing(rig: Rig) -> Rig:
    """Return the sensors that stand: the pose of a moving one in the rig is that on its base."""
    moving = {*rig.mounted(), *rig.odometry()}
    return rig.model_copy(update={"sensors": {name: each for name, each in rig.sensors.items() if name not in moving}})


def path_map(
    site: Site,
    truth: TruthTable | None,
    tracks: TrackTable,
    evaluation: Evaluation | None,
    scans: ScanDensity | None,
    colours: IdentityColours,
    silent: Collection[str] = (),
    drives: Sequence[Drive] = (),
) -> str:
    """Draw as SVG the room (or, without a plan, the scans' returns), true paths thin and grey, tracks in their colours.

    A track is solid while confirmed and dashed while it coasts; its id is at its end. Sensors are drawn at their true poses,
    and dashed at assumed ones; those without reports are hollow. Those that move are drawn by their way, `drives`, alone.
    """
    rig, names = standing(site.true_rig or site.rig), site.person_names
    hits = []
    if scans is not None:
        cells, counts = scans.cells()
        hits.append(cells[counts > _STANDING * counts.max(initial=0)])
    extent = floor_extent(rig, site.outline, *hits, np.column_stack([tracks.x, tracks.y]))
    view = FloorView.fit(np.concatenate([extent, *(each.xy for each in drives)]), _WIDTH_PX)
    parts = [room_svg(view, rig, site.outline, silent, site.glass), assumed_poses_svg(view, site.rig, site.true_rig)]
    if scans is not None:
        parts.append(f'<image href="{scans.png(view)}" width="{view.width_px}" height="{view.height_px}"/>')
    labels = SvgLabels()
    if truth is not None:
        parts.append(_true_paths(view, truth, tracks, names, labels))
    parts.append(_track_paths(view, tracks, colours, labels))
    parts += [_drive_path(view, each, labels, silent) for each in drives]
    parts.append(sensor_names_svg(view, rig, labels, silent))
    if evaluation is not None:
        parts.append(cause_marks(view, evaluation.errors))
        parts.extend(_event_marks(view, tracks, evaluation, names))
    span_ns = np.ptp(tracks.frame_stamps_ns) if tracks.frame_stamps_ns.size else 0
    kind = "map long" if span_ns > _LONG_NS else "map"
    return (
        f'<svg class="{kind}" viewBox="0 0 {view.width_px} {view.height_px}" role="img" '
        f'aria-label="Paths over the room, from above">{"".join(parts)}</svg>'
    )


def _drive_path(view: FloorView, drive: Drive, labels: SvgLabels, silent: Collection[str]) -> str:
    """Draw the way of a base dashed, from an open circle to a dot with the names of what is on it."""
    pixels = view.pixels(drive.xy)
    (x0, y0), (x, y) = pixels[0], pixels[-1]
    text = ", ".join(f"{name}: silent" if name in silent else name for name in (*drive.sensors, drive.base))
    return (
        f'<g><path class="drive" d="{svg_path(pixels)}"/><circle class="start" cx="{x0:.1f}" cy="{y0:.1f}" r="4"/>'
        f'<circle class="sensor" cx="{x:.1f}" cy="{y:.1f}" r="5"/>{labels.write("sensor-name", text, x + 9, y - 5)}'
        f"<title>{escape(drive.base)}: way of {escape(text)}</title></g>"
    )


def _true_paths(
    view: FloorView, truth: TruthTable, tracks: TrackTable, names: Mapping[int, str], labels: SvgLabels
) -> str:
    period = median_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    parts = []
    for person in np.unique(truth.id).tolist():
        rows = np.flatnonzero(truth.id == person)
        pixels = view.pixels(np.column_stack([truth.x[rows], truth.y[rows]]))
        line = "".join(
            svg_path(pixels[piece]) for piece in split_at_gaps(truth.stamps_ns[rows], period) if piece.size > 1
        )
        name = names.get(person, f"person {person}")
        x, y = pixels[0]
        parts.append(
            f'<g><path class="true" d="{line}"/><circle class="start" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
            f"{labels.write('person-name', name, x + 8, y + 4)}<title>{escape(name)}, truth</title></g>"
        )
    return "".join(parts)


def _track_paths(view: FloorView, tracks: TrackTable, colours: IdentityColours, labels: SvgLabels) -> str:
    period = median_period_ns(tracks.frame_stamps_ns)
    lines, texts = [], []
    for track in np.unique(tracks.id).tolist():
        rows = np.flatnonzero(tracks.id == track)
        pixels = view.pixels(np.column_stack([tracks.x[rows], tracks.y[rows]]))
        coasting = (tracks.status[rows] == "coasting").astype(np.int64)
        slot = colours.slot(track)
        for piece in split_at_gaps(tracks.stamps_ns[rows], period):
            for part in split_at_gaps(tracks.stamps_ns[rows][piece], period, coasting[piece]):
                own = piece[part]
                # Begin at the sample before, so that a change of status leaves no gap.
                joined = np.concatenate([own[:1] - 1, own]) if own[0] > piece[0] else own
                if joined.size > 1:
                    state = " coasting" if coasting[own[0]] else ""
                    line = svg_path(pixels[joined])
                    lines.append(f'<path class="s{slot} track{state}" d="{line}"><title>#{track}</title></path>')
        x, y = pixels[-1]
        lines.append(f'<circle class="f{slot}" cx="{pixels[-1, 0]:.1f}" cy="{pixels[-1, 1]:.1f}" r="4.5"/>')
        texts.append(labels.write(f"f{slot} last", f"#{track}", x + 8, y + 4))
    return "".join(lines + texts)


def _event_marks(view: FloorView, tracks: TrackTable, evaluation: Evaluation, names: Mapping[int, str]) -> list[str]:
    """Mark each event with a ring on its track."""
    marks = []
    for event in evaluation.events:
        rows = np.flatnonzero((tracks.id == event.track_id) & (tracks.stamps_ns == event.stamp_ns))
        if rows.size:
            x, y = view.pixels(np.array([tracks.x[rows[0]], tracks.y[rows[0]]]))
            text = escape(f"{event.kind}: {describe_event(event, names)}")
            marks.append(f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="9"><title>{text}</title></circle>')
    return marks


_OFFSET = 1 << 20  # cells are numbered from −2^20 to 2^20 on either axis
_BUFFER = 200_000
_RGB = (118, 134, 158)  # legible on light and dark pages


class ScanDensity:
    """Count of returns in cells of `cell_m`: the room in a robot's bag. Memory grows with the floor hit, not with the
    duration.
    """

    def __init__(self, rig: Rig, cell_m: float = 0.02) -> None:
        self._rig, self._scanners = rig, ScannerOnFloor.of(rig)
        self._cell_m = cell_m
        self._cells = np.zeros(0, dtype=np.int64)
        self._counts = np.zeros(0, dtype=np.int64)
        self._buffer: list[NDArray[np.int64]] = []
        self._buffered = 0

    def move(self, odometry: Odometry) -> None:
        """Move the scanners on a base to where it is."""
        self._scanners |= ScannerOnFloor.of(self._rig, odometry)

    def add(self, scan: LaserScan) -> None:
        """Count the returns of a scan of one of the rig's scanners."""
        index = np.floor(self._scanners[scan.sensor].points(scan) / self._cell_m).astype(np.int64)
        index = index[(np.abs(index) < _OFFSET).all(axis=1)] + _OFFSET
        self._buffer.append(index[:, 0] * 2 * _OFFSET + index[:, 1])
        self._buffered += len(index)
        if self._buffered > _BUFFER:
            self._merge()

    def cells(self) -> tuple[Polygon, NDArray[np.int64]]:
        """Return the centres (n, 2) [m, room frame] of the cells hit, and their counts, (n,)."""
        self._merge()
        index = np.stack([self._cells // (2 * _OFFSET), self._cells % (2 * _OFFSET)], axis=-1) - _OFFSET
        return (index.astype(np.float64) + 0.5) * self._cell_m, self._counts

    def png(self, view: FloorView) -> str:
        """Draw the counts as a transparent PNG over a view of the floor (a data URI)."""
        middles, counts = self.cells()
        pixels = view.pixels(middles)
        inside = view.inside(pixels)
        x, y = np.floor(pixels[inside]).astype(np.intp).T
        density = np.zeros((view.height_px, view.width_px), dtype=np.float32)
        np.add.at(density, (y, x), counts[inside])
        # A cell is a few pixels wide; the logarithm keeps walls, hit in every scan, from hiding moving objects.
        strength = np.log1p(cv2.dilate(density, np.ones((3, 3), np.uint8)))
        alpha = 0.9 * strength / max(float(strength.max()), 1e-9)
        bgra = np.empty((*density.shape, 4), dtype=np.uint8)
        bgra[..., :3] = _RGB[::-1]
        bgra[..., 3] = np.round(255 * alpha)
        done, png = cv2.imencode(".png", bgra, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if not done:
            raise RuntimeError("OpenCV could not encode a PNG")
        return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode()

    def _merge(self) -> None:
        if not self._buffer:
            return
        fresh, counts = np.unique(np.concatenate(self._buffer), return_counts=True)
        cells, inverse = np.unique(np.concatenate([self._cells, fresh]), return_inverse=True)
        weights = np.concatenate([self._counts, counts])
        self._cells, self._counts = cells, np.bincount(inverse, weights=weights, minlength=cells.size).astype(np.int64)
        self._buffer, self._buffered = [], 0


def cause_marks(view: FloorView, errors: Errors) -> str:
    """Draw as SVG a dot per missed person and per false positive, one path per cause."""
    parts = []
    for kind, causes in (("missed", MISSES), ("false_positive", FALSE_POSITIVES)):
        for cause in causes:
            mine = errors.cause == cause
            if mine.any():
                dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in view.pixels(errors.xy[mine]).tolist())
                name = METRICS[f"errors.{kind}.{cause}"].name
                parts.append(f'<path class="dots {kind}" d="{dots}"><title>{name}</title></path>')
    return "".join(parts)
