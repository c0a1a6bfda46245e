"""Bugs that somebody could really write, each one replacement of a text that stands once in its file.

Not such as raise at once, but signs, units, constants twice as large, frames off by one, channels and axes exchanged, transposed
rotations, rules left out, greedy for optimal. They are what the gate is tested by: see `benchmarks.gate_bugs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Bug:
    """What somebody got wrong, in which file below the root, and the texts without and with it."""

    name: str
    file: str
    old: str
    new: str

    def write(self, root: Path) -> None:
        """Make this mistake in the tree at `root`. Raises ValueError where the text is not there just once."""
        path = root / self.file
        text = path.read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"{self.file}: holds {self.old!r} {text.count(self.old)} times; once is expected")
        path.write_text(text.replace(self.old, self.new), encoding="utf-8")


_GREEDY = """order = np.argsort(np.where(allowed, distance, forbidden), axis=None)
    pairs: dict[int, int] = {}
    for row, column in zip(*np.unravel_index(order, distance.shape), strict=True):
        if row not in pairs and column not in pairs.values():
            pairs[row] = column
    rows = np.array(sorted(pairs))
    columns = np.array([pairs[row] for row in sorted(pairs)])"""

_BY_FILE = {
    # filters
    "trackers/filters/motion.py": [
        ("sign of a Jacobian", "by_state[X, HEADING] = -distance", "by_state[X, HEADING] = distance"),
    ],
    "trackers/filters/heading_motion.py": [
        ("process noise taken once a step, however short", "(self.models) / share)", "(self.models))"),
    ],
    "trackers/filters/velocity_motion.py": [
        ("standing taken for walking", "STANDS = VelocityModel(0.0, 1.0)", "STANDS = VelocityModel(1.0, 1.0)"),
        ("place and speed spread apart", "spread[place, speed] += variance", "spread[place, speed] -= variance"),
    ],
    "trackers/filters/imm.py": [
        (
            "transition matrix transposed",
            "transition.T @ state.probability",
            "transition @ state.probability",
        ),
        (
            "modes mixed without the spread of their means",
            '        covariance += np.einsum("aftn,bftn->abtn", spread * shares, spread)\n',
            "",
        ),
        ("likelihood without its determinant", "-0.5 * (square + np.log(determinant))", "-0.5 * square"),
    ],
    "trackers/filters/gating.py": [
        (
            "greedy for optimal assignment",
            "rows, columns = linear_sum_assignment(np.where(allowed, distance, forbidden))",
            _GREEDY,
        ),
        ("radius not squared", "<= radius_m**2, axis=1)", "<= radius_m, axis=1)"),
        ("cross term halved", "2 * s_xy * y", "s_xy * y"),
        ("tails of the square root", "(degrees_of_freedom + 2)", "(degrees_of_freedom + 2) / 2"),
    ],
    "trackers/filters/absence.py": [
        ("mean square left in the variance", "xx - mean_x**2 - 1", "xx - 1"),
        ("existence by who would be seen", "unseen = there * missed", "unseen = there * (1 - missed)"),
        ("evidence upside down", "theirs = existence * likelihood_ratio", "theirs = existence / likelihood_ratio"),
    ],
    "trackers/filters/circular.py": [("arctangent's arguments exchanged", "arctan2(y, x)", "arctan2(x, y)")],
    "trackers/filters/particle.py": [
        ("evidence without the total", "np.where(lost, -np.inf, top + log_total)", "np.where(lost, -np.inf, top)"),
        ("resampled while nothing has degenerated", "(share <= self.threshold)", "(share >= self.threshold)"),
    ],
    "trackers/filters/resampling.py": [
        ("systematic without its offset", "p * cumulative - offset", "p * cumulative - 0.5")
    ],
    # tracking
    "trackers/tracking/appearance.py": [
        (
            "first look blended with nothing",
            "np.where(self.known[track, None], blended, histogram)",
            "blended",
        ),
    ],
    "trackers/tracking/association.py": [
        ("whom nothing fits is paired first", "stage.unpaired[:, None] - cost", "stage.unpaired[:, None] + cost"),
        ("measurement paired twice", "allowed[rows] = allowed[:, columns] = False", "allowed[rows] = False"),
    ],
    "trackers/tracking/lifecycle.py": [
        ("confirmed a frame late", "ns - roster.born_ns + nanoseconds(period_s)", "ns - roster.born_ns"),
        ("clear of anybody, not of everybody", ".min(axis=1) > clearance_m", ".max(axis=1) > clearance_m"),
    ],
    "trackers/tracking/moments.py": [
        ("joins within a period, not half of one", "NS_PER_S), *seen_ns) // 2", "NS_PER_S), *seen_ns)"),
    ],
    "trackers/area.py": [("margin not squared", "(gap_square <= self._margin_m**2)", "(gap_square <= self._margin_m)")],
    "trackers/order.py": [("holds nothing back", "self._newest_ns - self._max_wait_ns", "self._newest_ns")],
    # lasers
    "trackers/laser/background.py": [
        ("memory fades forwards", "np.exp(elapsed / self._options", "np.exp(-elapsed / self._options"),
        ("margin behind the wall", "room - np.maximum(", "room + np.maximum("),
    ],
    "trackers/laser/clusters.py": [
        ("pushed towards the scanner", "(1 + depth_m / range_m)", "(1 - depth_m / range_m)"),
        ("farther taken for nearer", "nearer = range_m - jump_m", "nearer = range_m + jump_m"),
    ],
    "trackers/laser/free_space.py": [
        ("rotation not transposed", "rotation[:2, :2].T.copy()", "rotation[:2, :2].copy()"),
        ("a beam more is asked for", "(self._least - 1)", "self._least"),
        ("seen before, not behind", "distance + options.behind_m", "distance - options.behind_m"),
    ],
    "trackers/laser/group.py": [
        ("what one beam shows starts a track", "detections.n_sample >= self._least", "detections.n_sample >= 1"),
        (
            "weighted by variance, not its inverse",
            "1 / (R + first.variance_m2[mine]), 1 / (R + second.variance_m2[theirs])",
            "R + first.variance_m2[mine], R + second.variance_m2[theirs]",
        ),
    ],
    "trackers/laser/grouping.py": [
        ("narrowest first", "(-width_m).argsort", "width_m.argsort"),
        ("second leg beside the first", "place[who] += against", "place[who] -= against"),
        ("hidden people first", "- away**2 - first_leg", "- away**2 + first_leg"),
        ("a trunk cut in two is two", "near |= apart < apart_m", "near &= apart < apart_m"),
    ],
    "trackers/laser/layer.py": [
        (
            "completed on the wrong side",
            "clusters.hidden_after.astype(float) - clusters.hidden_before",
            "clusters.hidden_before.astype(float) - clusters.hidden_after",
        ),
        ("arms completed to trunks", "pushed_back(clusters.middle, depth_m)", "pushed_back(middle, depth_m)"),
        ("width twice as large", "across = np.pi / 8 * width_m", "across = np.pi / 4 * width_m"),
    ],
    # laser_fisheye_imm
    "trackers/laser_fisheye_imm/association.py": [
        ("a flicker takes legs", "np.bool_) if self.knows_room else", "np.bool_) if True else"),
        ("the gone are recognised", "hidden & people.exist(options.management.exists_above)", "hidden"),
        (
            "recognised by another shirt",
            "(colour <= self.options.recognised_below)",
            "(colour >= self.options.recognised_below)",
        ),
        ("appearance left out", "self.options.colour_weight * np.nan_to_num", "0 * np.nan_to_num"),
        ("a look is wrong as often as not", "wrong = self.options.wrong_look", "wrong = 0.5"),
        ("a look counts twice", "- 0.5 * cost)", "- cost)"),
    ],
    "trackers/laser_fisheye_imm/legs.py": [
        ("knees looked for under the trunk", "+= people.posture.knees[shown]", "+= 0 * people.posture.knees[shown]"),
        ("a bag is whose it is nearest to", "barred[n_trunk:] = at_trunks", "barred[n_trunk:] = False"),
        ("every trunk takes its own legs first", "if knee.shared else", "if not knee.shared else"),
        ("one leg is the middle of two", "n_leg[:n_trunk, None] == 2", "n_leg[:n_trunk, None] >= 1"),
    ],
    "trackers/laser_fisheye_imm/pairing.py": [
        ("a density counts half", "unlikely + 2 * np.log(density_m2)", "unlikely + np.log(density_m2)"),
        ("a trunk taken for a lone leg", "np.where(alone, ", "np.where(~np.asarray(alone), "),
        (
            "the hidden taken for seen",
            "e * np.maximum(unseen, _LEAST_UNSEEN)",
            "e * np.maximum(1 - unseen, _LEAST_UNSEEN)",
        ),
        ("the gone paired as readily", "_LEAST_UNSEEN)) / e)", "_LEAST_UNSEEN)))"),
        (
            "every measurement is proof",
            "existence_measured(np.maximum(existence, _LEAST_EXISTENCE), np.exp(-0.5 * cost))",
            "np.ones_like(existence)",
        ),
    ],
    "trackers/laser_fisheye_imm/detection.py": [
        ("likely outside the area", ".reshape(chance.shape)] = 0", ".reshape(chance.shape)] = 1"),
    ],
    "trackers/laser_fisheye_imm/tracker.py": [
        ("fast scans taken for independent", "matches.variance / shares", "matches.variance"),
        ("looks upon a standing leg taken for independent", "knee.single_leg_s", "period_s"),
        ("misses of fast scans taken for independent", "missed(moment, points) ** share", "missed(moment, points)"),
        ("the gone hold newcomers back", "people.positions[exist]", "people.positions"),
        ("clothes learned from another trunk", "seen.histograms[matches.trunk[looked]],", "seen.histograms[looked],"),
    ],
    "trackers/laser_fisheye_imm/life.py": [
        ("bodies three times as far apart", "taken, rules.apart_m)", "taken, 3 * rules.apart_m)"),
        ("negative evidence left out", "people.state.replaced(unseen, state)", "people.state"),
        ("a long gap ends nobody", "looked = ns - self._looked_ns <= nanoseconds(rules.coast_s)", "looked = True"),
    ],
    "trackers/tracking/repeats.py": [
        ("a hung sensor is believed", "return n_changed == 0 and", "return False and"),
        ("noise is never forgotten", "2 * n_changed >= n", "2 * n_changed >= n or self._noisy.get(sensor, False)"),
    ],
    # laser_vision_learning and learning
    "trackers/laser_vision_learning/walking.py": [
        ("two strides for one", "elapsed_s / (2 * options.step)", "elapsed_s / options.step"),
        (
            "both legs on one side",
            "np.subtract(state[X], off_x, out=legs[1, 0])",
            "np.add(state[X], off_x, out=legs[1, 0])",
        ),
    ],
    "trackers/laser_vision_learning/points.py": [
        ("gate not squared", "unknown = np.exp(-(options.gate_m**2)", "unknown = np.exp(-options.gate_m"),
    ],
    "trackers/laser_vision_learning/identities.py": [
        ("least alike instead of most", "linear_sum_assignment(said, maximize=True)", "linear_sum_assignment(said)"),
    ],
    "trackers/laser_vision_learning/score_maps.py": [
        ("smoothed twice as much", "side_px / np.sqrt(2)", "side_px * np.sqrt(2)"),
    ],
    "trackers/laser_vision_learning/situations.py": [
        ("seconds for nanoseconds", "<= nanoseconds(options.lasting_s)", "<= options.lasting_s"),
    ],
    "trackers/laser_vision_learning/looks.py": [
        (
            "those first that have waited least",
            "np.lexsort((rng.random(waiting.size), looks.learned_ns[waiting]))",
            "np.lexsort((rng.random(waiting.size), -looks.learned_ns[waiting]))",
        ),
    ],
    "trackers/laser_vision_learning/recognition.py": [
        ("moved back to the picture", "people.places + late_s", "people.places - late_s"),
    ],
    "trackers/learning/boosting.py": [("worst tree kept", "best = each.argmin(axis=1)", "best = each.argmax(axis=1)")],
    "trackers/learning/cart.py": [("threshold on a sample", "low + 0.5 * (high - low)", "low + (high - low)")],
    # vision and cameras
    "trackers/vision/histogram.py": [
        ("appearance memory of .95", "default=0.4, ge=0, lt=1", "default=0.95, ge=0, lt=1"),
        ("hue does not wrap", 'self._hue_kernel, "wrap"', 'self._hue_kernel, "constant"'),
    ],
    "trackers/vision/colour_bins.py": [
        ("blue for red", "np.float32(FULL), cv2.COLOR_RGB2HSV", "np.float32(FULL), cv2.COLOR_BGR2HSV"),
    ],
    "trackers/vision/foreground.py": [
        ("hue does not wrap", "np.minimum(hue_off, HALF_TURNS - hue_off)", "np.minimum(hue_off, HALF_TURNS)"),
        ("degrees for OpenCV's half degrees", "options.hue_change_deg / 2", "options.hue_change_deg"),
    ],
    "trackers/vision/patches.py": [
        ("hidden by who stands behind", "theirs < distance[:, None] - _SAME_M", "theirs > distance[:, None] + _SAME_M"),
    ],
    "trackers/vision/floor_places.py": [
        (
            "rows and columns exchanged",
            "[row / self._pitch_m, column / self._pitch_m]",
            "[column / self._pitch_m, row / self._pitch_m]",
        ),
    ],
    "trackers/vision/torso.py": [
        (
            "sine for cosine",
            "[reach * np.cos(angles), reach * np.sin(angles)]",
            "[reach * np.sin(angles), reach * np.cos(angles)]",
        ),
    ],
    "trackers/cameras/fisheye.py": [
        (
            "half the field of view for the whole",
            "(theta <= self.field_of_view_rad / 2)",
            "(theta <= self.field_of_view_rad)",
        ),
    ],
    "trackers/cameras/pinhole.py": [
        (
            "tangential terms exchanged",
            "2 * p1 * cross + p2 * (square + 2 * x * x)",
            "2 * p2 * cross + p1 * (square + 2 * x * x)",
        ),
    ],
    "trackers/cameras/placed.py": [
        (
            "rotation transposed",
            "self.intrinsics.rays(pixels) @ self.rotation.T",
            "self.intrinsics.rays(pixels) @ self.rotation",
        ),
    ],
    "trackers/cameras/ellipse.py": [("turned the wrong way", "(ahead - aside) * cosine", "(aside - ahead) * cosine")],
    # floor and camera_floor_particle
    "trackers/floor/clusters.py": [
        ("elements of no cluster count", "load_n=total_n[kept],", "load_n=total_n[kept] + total_n[0],"),
    ],
    "trackers/camera_floor_particle/body.py": [
        (
            "memory of the velocity inverted",
            "motion.memory * velocity + (1 - motion.memory)",
            "(1 - motion.memory) * velocity + motion.memory",
        ),
    ],
    "trackers/camera_floor_particle/exclusion.py": [
        ("unlikeliest stays", "np.argsort(-evidence", "np.argsort(evidence")
    ],
    "trackers/camera_floor_particle/head.py": [
        ("degrees for radians", "np.deg2rad(options.turn_deg)", "options.turn_deg"),
        ("pan turned the other way", "views.bearings(state) - state[3]", "views.bearings(state) + state[3]"),
    ],
    "trackers/camera_floor_particle/loads.py": [("rows and columns exchanged", "local.T[::-1]", "local.T")],
    # rgbd_head, environment
    "trackers/rgbd_head/sight.py": [
        ("moved back to the picture", "[:3] += np.float32(later)", "[:3] -= np.float32(later)"),
    ],
    "trackers/rgbd_head/picture.py": [
        ("depth for range", "_mm_per_depth = 1000 * per_depth", "_mm_per_depth = np.full_like(per_depth, 1000)")
    ],
    "trackers/rgbd_head/colours.py": [("blue for red", "cv2.COLOR_RGB2YCrCb", "cv2.COLOR_BGR2YCrCb")],
    "trackers/rgbd_head/outline.py": [
        ("seen from behind", "np.arctan2(-off[1], -off[0])", "np.arctan2(off[1], off[0])"),
    ],
    "trackers/environment/model.py": [
        ("distance halfway off", "(np.arange(self.grid.shape[axis]) + 0.5)", "np.arange(self.grid.shape[axis])"),
    ],
    "trackers/environment/build.py": [
        ("one stray point occupies", "occupied &= (hits > 1) | (passes == 0)", "occupied &= hits > 0"),
        ("top a voxel too high", "grid.shape[2] - 1 - np.argmax(", "grid.shape[2] - np.argmax("),
    ],
    # the baseline
    "trackers/sort.py": [
        ("those in sight slow down", "(np.exp(-dt / options.slowdown_s), 1)", "(1, np.exp(-dt / options.slowdown_s))"),
        ("acceleration not squared", "* options.acceleration_m_s2**2", "* options.acceleration_m_s2"),
    ],
    # sensors
    "twin/sensors/laser.py": [
        ("rotation transposed", "in_sensor @ pose.rotation.T", "in_sensor @ pose.rotation"),
        ("sweep twice as slow", "(sector.start + sector.stop - 1) / 2", "(sector.start + sector.stop - 1)"),
    ],
    "twin/sensors/laser_noise.py": [
        ("degrees for radians", "np.deg2rad(self.divergence_deg)", "self.divergence_deg"),
        ("noise twice as large", '"default": LaserNoise(sigma_m=0.005', '"default": LaserNoise(sigma_m=0.01'),
    ],
    "twin/sensors/camera_noise.py": [
        ("read noise not squared", "np.sqrt(self.read_sigma**2 +", "np.sqrt(self.read_sigma +")
    ],
    "twin/sensors/lens.py": [
        ("half a pixel off", "(self.width - 1) / 2, (self.height - 1) / 2", "self.width / 2, self.height / 2"),
    ],
    "twin/sensors/fisheye.py": [("blue for red", "cv2.COLOR_RGBA2RGB", "cv2.COLOR_RGBA2BGR")],
    "twin/sensors/schedule.py": [
        ("first look a period late", "timing.phase_s + number / timing", "timing.phase_s + (number + 1) / timing"),
        ("jitter both ways", "timing.jitter_s * late)", "timing.jitter_s * (2 * late - 1))"),
    ],
    "twin/sensors/stereo.py": [
        ("depth upside down", "self._measured(depth_m[::-1], rng)", "self._measured(depth_m, rng)"),
        (
            "noise on depth, not disparity",
            "self._focal_baseline / true_m + noise_px",
            "self._focal_baseline / (true_m + noise_px)",
        ),
    ],
    "twin/sensors/message_faults.py": [("drifts from the start", "(stamp_ns - fault.from_ns)", "stamp_ns")],
    "twin/sensors/fault_kinds.py": [
        ("a frame too long", "stamp_ns < round(self.to_s * NS_PER_S)", "stamp_ns <= round(self.to_s * NS_PER_S)"),
    ],
    "twin/sensors/obstruction.py": [("axes exchanged", "fault.at[0] * width", "fault.at[1] * width")],
    "twin/sensors/dead_parts.py": [("last beam left out", "each[0] : each[-1] + 1", "each[0] : each[-1]")],
    "twin/sensors/floor_electronics.py": [("crosstalk twice as large", "(share / 4) * load_n", "(share / 2) * load_n")],
    "twin/sensors/floor_plate.py": [
        ("sign of a torque", "np.stack([-tilt[:, 0], tilt[:, 1]]", "np.stack([tilt[:, 0], tilt[:, 1]]"),
    ],
    # truth
    "twin/truth/ray_runs.py": [("one beam too many", "(stops[met] - 1).tolist()", "stops[met].tolist()")],
    "twin/truth/situations.py": [("no beam may look past", "> MAX_GAP_BEAMS + 1)", "> MAX_GAP_BEAMS)")],
    "twin/truth/rig_merging.py": [("rotation transposed", "rotation[:2, :2] @ ahead", "rotation[:2, :2].T @ ahead")],
    "twin/truth/visibility.py": [
        (
            "plane band twice as high",
            "np.abs(local[..., 2]) <= _PLANE_BAND_M",
            "np.abs(local[..., 2]) <= 2 * _PLANE_BAND_M",
        ),
    ],
    "twin/truth/boxes.py": [
        (
            "width and height exchanged",
            "columns.start, rows.start, width, height",
            "columns.start, rows.start, height, width",
        )
    ],
    # recording
    "twin/recording/messages.py": [
        ("blue for red", "bgr = cv2.cvtColor(image.rgb, cv2.COLOR_RGB2BGR)", "bgr = image.rgb"),
        ("sweep a beam too long", "time_increment_s * max(ranges_m.size - 1, 0)", "time_increment_s * ranges_m.size"),
    ],
    "twin/recording/depth_picture.py": [
        (
            "millimetres cut off",
            "np.rint(np.where(np.isfinite(depth_m), depth_m, 0) * 1000.0)",
            "np.floor(np.where(np.isfinite(depth_m), depth_m, 0) * 1000.0)",
        ),
    ],
    "twin/recording/reader.py": [
        ("start added, not taken off", "_offset_ns(sensor) - self.start_ns", "_offset_ns(sensor) + self.start_ns"),
    ],
    # evaluation
    "twin/evaluate/clear.py": [
        ("switches cost nothing", "self.false_positives + self.id_switches) /", "self.false_positives) /"),
    ],
    "twin/evaluate/hota.py": [("alignment over both", "overlap / (either - overlap)", "overlap / either")],
    "twin/evaluate/frames.py": [("angles not wrapped", "wrap_angle(change[:, 5])", "change[:, 5]")],
    "twin/evaluate/continuity.py": [
        ("coasting counts", "            if not is_confirmed:\n                continue\n", "")
    ],
    "twin/evaluate/occlusion.py": [("hidden from any sensor", "hidden &= truth", "hidden |= truth")],
}

BUGS = tuple(Bug(name, file, old, new) for file, rows in _BY_FILE.items() for name, old, new in rows)
