"""Mistakes that somebody could really write, each a change of one definition (`benchmarks.mutation`).

Not such as raise at once, but signs, units, constants twice as large, frames off by one, channels and axes exchanged, transposed
rotations, rules left out, nearest for optimal. They are what the gate is tested by: see `benchmarks.gate_bugs`.
"""

from __future__ import annotations

from benchmarks.mutation import Bug

_BY_FILE = {
    "trackers/filters/motion.py": [
        ("sign of a Jacobian", "linearise", "-_A", "_A"),
        (
            "process noise taken once a step, however short",
            "HeadingMotion.moved",
            "disturbance_variances(_A) / _B",
            "disturbance_variances(_A)",
        ),
        ("standing taken for walking", "", "VelocityModel(0.0, 1.0)", "VelocityModel(1.0, 1.0)"),
        (
            "place and speed spread apart",
            "VelocityMotion.moved",
            "spread[place, speed] += noise[1]",
            "spread[place, speed] -= noise[1]",
        ),
    ],
    "trackers/filters/imm.py": [
        ("transition matrix transposed", "Imm._mix", "_A.T", "_A"),
        ("likelihood without its determinant", "Imm.update", "_A + np.log(_B)", "_A"),
        (
            "modes mixed without the spread of their means",
            "Imm._mix",
            "_A += np.einsum('aftn,bftn->abtn', _B * _C, _B)",
            "",
        ),
    ],
    "trackers/filters/gating.py": [
        ("radius not squared", "validation_region", "_A ** 2", "_A"),
        ("cross term halved", "mahalanobis_distances", "2 * s_xy", "s_xy"),
        ("density of the square root", "mahalanobis_distances", "np.log(_A)", "0.5 * np.log(_A)"),
        (
            "nearest for optimal assignment",
            "global_nearest_neighbour",
            "linear_sum_assignment(np.where(_A, _B, _C))",
            "(np.arange(len(_A)), np.where(_A, _B, _C).argmin(axis=1))",
        ),
    ],
    "trackers/filters/negative_information.py": [
        ("mean square left in the variance", "update_missed", "uu - mean_u ** 2", "uu"),
        ("existence by who would be seen", "existence_after_miss", "there * missed", "there * (1 - missed)"),
        ("evidence upside down", "existence_after_detection", "_A * _B", "_A / _B"),
    ],
    "trackers/filters/circular.py": [
        ("arctangent's arguments exchanged", "circular_mean", "np.arctan2(_A, _B)", "np.arctan2(_B, _A)"),
    ],
    "trackers/filters/particle.py": [
        ("evidence without the total", "LogWeights.updated", "top + log_total", "top"),
        ("resampled while nothing has degenerated", "ParticleFilter.resampled", "_A <= _B", "_A >= _B"),
    ],
    "trackers/filters/resampling.py": [
        ("systematic without its offset", "_systematic", "_A * _B - _C", "_A * _B - 0.5"),
    ],
    "trackers/tracking/roster.py": [
        ("whom nothing fits is paired first", "associate", "_A[:, None] - _B", "_A[:, None] + _B"),
        ("measurement paired twice", "associate", "_A[_B] = _A[:, _C] = False", "_A[_B] = False"),
    ],
    "trackers/tracking/track_manager.py": [
        ("confirmed a frame late", "TrackManager.to_confirm", "_A - _B + frame_ns", "_A - _B"),
        ("clear of anybody, not of everybody", "clear_of", "distances(_A, _B).min", "distances(_A, _B).max"),
    ],
    "trackers/tracking/synced_frames.py": [
        (
            "joins within a period, not half of one",
            "FrameSynchronizer._learn_period",
            "min(round(_A * _B), *_C) // 2",
            "min(round(_A * _B), *_C)",
        ),
    ],
    "trackers/area.py": [
        ("margin not squared", "Area._exactly", "self._margin_m ** 2", "self._margin_m"),
    ],
    "trackers/arrival_order.py": [
        ("holds nothing back", "StampOrder.add", "_A - _B - _C", "_A"),
    ],
    "trackers/laser/background.py": [
        ("memory fades forwards", "LearnedBackground._learn", "_A / _B", "-_A / _B"),
        (
            "margin behind the wall",
            "KnownBackground.__init__",
            "nearest - margin_m",
            "nearest + margin_m",
        ),
    ],
    "trackers/laser/clusters.py": [
        ("pushed towards the scanner", "pushed_back", "1 + _A / _B", "1 - _A / _B"),
        ("farther taken for nearer", "_hidden", "_A - _B", "_A + _B"),
        ("narrowest first", "trunks", "-_A", "_A"),
        (
            "second leg beside the first",
            "take_legs",
            "_A[_B] += _C[_B] * (_D[_B] - _E[_F])",
            "_A[_B] -= _C[_B] * (_D[_B] - _E[_F])",
        ),
        (
            "hidden people first",
            "take_legs",
            "reach ** 2 - away ** 2",
            "reach ** 2 + away ** 2",
        ),
        ("a trunk cut in two is two", "trunks", "_A |= _B < _C", "_A &= _B < _C"),
    ],
    "trackers/laser/bearings.py": [
        ("rotation not transposed", "DetectionModel.__init__", "_A[:2, :2].T", "_A[:2, :2]"),
        ("a beam more is asked for", "DetectionModel.seen", "self._least - 1", "self._least"),
        (
            "seen before, not behind",
            "DetectionModel.seen",
            "distance + options.behind_m",
            "distance - options.behind_m",
        ),
    ],
    "trackers/laser/group.py": [
        ("what one beam shows starts a track", "ScannerGroup.sufficient", "self._least", "1"),
        (
            "weighted by variance, not its inverse",
            "fused",
            "(1 / (_A + _B[_C]), 1 / (_A + _D[_E]))",
            "(_A + _B[_C], _A + _D[_E])",
        ),
    ],
    "trackers/laser/layer.py": [
        ("completed on the wrong side", "LaserLayer._completed", "_A.astype(_B) - _C", "_C.astype(_B) - _A"),
        ("trunks as deep as arms", "trunk_mask", "_A < options.satellite_width_m", "_A >= options.satellite_width_m"),
        ("width twice as large", "LaserLayer._half_depth_m", "np.pi / 8", "np.pi / 4"),
    ],
    "trackers/laser_fisheye_imm/association.py": [
        ("a flicker takes legs", "Association._known", "self.knows_room", "True"),
        ("the deleted are re-identified", "Association._re_identified", "_A & _B.exist(_C)", "_A"),
        (
            "re-identified by another shirt",
            "Association._same_person",
            "colour <= self.options.appearance.same_below",
            "colour >= self.options.appearance.same_below",
        ),
        ("appearance left out", "Association._by_colour", "self.options.appearance.weight", "0"),
        ("a look is wrong as often as not", "_colour_cost", "np.log(WRONG_LOOK)", "np.log(0.5)"),
        ("a look counts twice", "_colour_cost", "0.5 * _A", "_A"),
        (
            "knees looked for under the trunk",
            "Association._walkers",
            "posture.knees[shown]",
            "0 * posture.knees[shown]",
        ),
        ("a density counts half", "Costs.of", "np.log(_A) - _B", "0.5 * np.log(_A) - _B"),
        (
            "the hidden taken for seen",
            "Association._unpaired",
            "np.maximum(self.missed(_A), _LEAST_MISSED)",
            "np.maximum(1 - self.missed(_A), _LEAST_MISSED)",
        ),
        (
            "the deleted paired as readily",
            "_cost_unpaired",
            "(1 - _A + _A * _B) / _A",
            "1 - _A + _A * _B",
        ),
        (
            "every measurement is proof",
            "_existence_paired",
            "existence_after_detection(np.maximum(_A, _B), np.exp(-0.5 * _C))",
            "np.ones_like(_A)",
        ),
    ],
    "trackers/likelihood/legs.py": [
        ("a bag is the nearest person's", "pair_legs", "_A[_B:][_C] = _D", "_A[_B:][_C] = False"),
        ("one leg is the middle of two", "pair_legs", "_A[:_B, None] == 2", "_A[:_B, None] >= 1"),
        ("a single leg taken for a pair", "LegPairs._single_m2", "self.n_leg == 1", "self.n_leg == 2"),
        ("likelihood of a wider Gaussian", "PositionLikelihood.evaluated", "-0.5 * _A", "-0.25 * _A"),
    ],
    "trackers/laser_fisheye_imm/detection.py": [
        (
            "likely outside the area",
            "Detector.missed",
            "_A.contains(_B.reshape(2, -1).T)",
            "~_A.contains(_B.reshape(2, -1).T)",
        ),
    ],
    "trackers/laser_fisheye_imm/tracker.py": [
        (
            "fast scans taken for independent",
            "LaserFisheyeImm._update",
            "matches.variance / shares",
            "matches.variance",
        ),
        (
            "looks upon a standing leg taken for independent",
            "LaserFisheyeImm._update",
            "self.options.legs.single_leg_s",
            "self.options.step_s",
        ),
        (
            "misses of fast scans taken for independent",
            "LaserFisheyeImm._work.missed",
            "_A.missed(_B, _C) ** _D",
            "_A.missed(_B, _C)",
        ),
        (
            "deleted tracks hold initiation back",
            "LaserFisheyeImm._start",
            "people.positions[exist]",
            "people.positions",
        ),
        (
            "clothes learned from another trunk",
            "LaserFisheyeImm._learn_colours",
            "seen.histograms[matches.trunk[looked]]",
            "seen.histograms[looked]",
        ),
    ],
    "trackers/laser_fisheye_imm/track_manager.py": [
        (
            "bodies three times as far apart",
            "ImmTrackManager.update_missed_tracks.not_shown",
            "rules.apart_m",
            "3 * rules.apart_m",
        ),
        (
            "negative evidence left out",
            "ImmTrackManager.update_missed_tracks",
            "people.state.replaced(coasting, state)",
            "people.state",
        ),
        ("a long gap ends nobody", "ImmTrackManager._kept", "_A - _B <= nanoseconds(_C)", "True"),
    ],
    "trackers/tracking/missing_frames.py": [
        ("a hung sensor is used", "StaleFrameDetector.repeats", "_A == 0", "False"),
        (
            "noise is never forgotten",
            "StaleFrameDetector.repeats",
            "n >= _LEAST and 2 * n_changed >= n",
            "n >= _LEAST and 2 * n_changed >= n or self._noisy.get(sensor, False)",
        ),
    ],
    "trackers/laser_vision_learning/walking_model.py": [
        ("two strides for one", "WalkingModel.move", "2 * options.step", "options.step"),
        (
            "both legs on one side",
            "WalkingModel.legs",
            "np.subtract(_A[_B], _C, out=_D[1, 0])",
            "np.add(_A[_B], _C, out=_D[1, 0])",
        ),
    ],
    "trackers/likelihood/laser_points.py": [
        ("gate not squared", "shares", "-_A ** 2", "-_A"),
    ],
    "trackers/laser_vision_learning/identities.py": [
        (
            "least alike instead of most",
            "decided",
            "linear_sum_assignment(log_odds, maximize=True)",
            "linear_sum_assignment(log_odds)",
        ),
    ],
    "trackers/laser_vision_learning/score_maps.py": [
        ("smoothed twice as much", "ScoreMaps.of", "_A * _B / np.sqrt(2)", "_A * _B * np.sqrt(2)"),
    ],
    "trackers/laser_vision_learning/situations.py": [
        ("seconds for nanoseconds", "assessed", "nanoseconds(_A)", "_A"),
    ],
    "trackers/laser_vision_learning/looks.py": [
        (
            "those first that have waited least",
            "Learner.trained",
            "looks.learned_ns[waiting]",
            "-looks.learned_ns[waiting]",
        ),
    ],
    "trackers/laser_vision_learning/reidentification.py": [
        ("moved back to the picture", "Recognition._shown", "_A + _B * _C", "_A - _B * _C"),
    ],
    "trackers/learning/boosting.py": [
        ("worst tree kept", "OnlineBoosting._boosted", "each.argmin", "each.argmax"),
        ("threshold on a sample", "SortedSamples._asked", "0.5 * (_A - _B)", "_A - _B"),
    ],
    "trackers/vision/histogram.py": [
        ("blue for red", "ColourHistogram._counts", "cv2.COLOR_RGB2HSV", "cv2.COLOR_BGR2HSV"),
        ("first look blended with nothing", "Appearance.learned", "np.where(_A[_B, None], _C, _D)", "_C"),
        ("appearance memory of .95", "HistogramOptions", "0.4", "0.95"),
        (
            "hue does not wrap",
            "ColourHistogram.of_pixels",
            "_smoothed(_A, _B, 'wrap')",
            "_smoothed(_A, _B, 'constant')",
        ),
    ],
    "trackers/vision/foreground.py": [
        ("hue does not wrap", "_Background.differences", "_A - _B", "_A"),
        (
            "degrees for OpenCV's half degrees",
            "Differences.changed",
            "_HUE_CHANGE_DEG / 2",
            "_HUE_CHANGE_DEG",
        ),
    ],
    "trackers/vision/patches.py": [
        ("hidden by who stands behind", "PatchSampler.drawn", "_A < _B[:, None] - _C", "_A > _B[:, None] + _C"),
    ],
    "trackers/vision/person_windows.py": [
        ("rows and columns exchanged", "FloorPlaces.read", "[row, column]", "[column, row]"),
        (
            "sine for cosine",
            "TorsoProjector.windows",
            "[_A * np.cos(_B), _A * np.sin(_B)]",
            "[_A * np.sin(_B), _A * np.cos(_B)]",
        ),
    ],
    "trackers/cameras/intrinsics.py": [
        ("half the field of view for the whole", "FisheyeIntrinsics.project", "_A / 2", "_A"),
        (
            "tangential terms exchanged",
            "PinholeIntrinsics._bend",
            "_A * _B + 2 * _C * _D + _E * (_F + 2 * _A * _A)",
            "_A * _B + 2 * _E * _D + _C * (_F + 2 * _A * _A)",
        ),
    ],
    "trackers/cameras/placed.py": [
        ("rotation transposed", "PlacedCamera.rays", "_A.T", "_A"),
        ("turned the wrong way", "Ellipsoids.upright", "_A - _B", "_B - _A"),
    ],
    "trackers/camera_floor_particle/body_filter.py": [
        ("memory of the velocity inverted", "smoothed", "_A * _B + (1 - _A) * _C / _D", "(1 - _A) * _B + _A * _C / _D"),
        ("unlikeliest stays", "excluded", "-_A", "_A"),
    ],
    "trackers/camera_floor_particle/pan.py": [
        ("degrees for radians", "HeadFilter.step", "np.deg2rad(_A)", "_A"),
        (
            "pan turned the other way",
            "HeadFilter._seen_by.log_likelihood",
            "_A.bearings(_B) - _B[3]",
            "_A.bearings(_B) + _B[3]",
        ),
    ],
    "trackers/likelihood/floor.py": [
        ("elements of no cluster count", "floor_clusters", "total_n[kept]", "total_n[kept] + total_n[0]"),
        ("rows and columns exchanged", "FloorLikelihood.log_likelihood", "_A.T[::-1]", "_A.T"),
    ],
    "trackers/rgbd_head/likelihoods.py": [
        (
            "moved back to the picture",
            "Likelihoods.by_camera",
            "_A[_B][:3] += np.float32(_C) * _D",
            "_A[_B][:3] -= np.float32(_C) * _D",
        ),
    ],
    "trackers/vision/stereo_picture.py": [
        ("depth for range", "StereoCamera.__init__", "1000 * _A", "np.full_like(_A, 1000)"),
    ],
    "trackers/vision/head_colours.py": [
        ("blue for red", "_numbers", "cv2.COLOR_RGB2YCrCb", "cv2.COLOR_BGR2YCrCb"),
    ],
    "trackers/vision/head_outlines.py": [
        ("seen from behind", "outlines", "np.arctan2(-_A[1], -_A[0])", "np.arctan2(_A[1], _A[0])"),
    ],
    "trackers/environment/model.py": [
        ("distance halfway off", "Environment._fields", "np.arange(_A[_B]) + 0.5", "np.arange(_A[_B])"),
    ],
    "trackers/environment/build.py": [
        ("one stray point occupies", "build_environment", "(_A > 1) | (_B == 0)", "_A > 0"),
        ("top a voxel too high", "_tops", "_A[2] - 1", "_A[2]"),
    ],
    "trackers/sort.py": [
        ("those in sight slow down", "_motion", "(np.exp(-_A / _B), 1)", "(1, np.exp(-_A / _B))"),
        ("acceleration not squared", "_motion", "acceleration_m_s2 ** 2", "acceleration_m_s2"),
    ],
    "twin/sensors/laser.py": [
        ("rotation transposed", "Laser.__init__", "_A.T", "_A"),
        ("sweep twice as slow", "Laser._split_sweep", "_A * (_B + _C - 1) / 2", "_A * (_B + _C - 1)"),
    ],
    "twin/sensors/laser_noise.py": [
        ("degrees for radians", "LaserNoise._mix", "np.deg2rad(_A)", "_A"),
        (
            "noise twice as large",
            "",
            "LaserNoise(sigma_m=0.005, quantisation_m=0.01, dropout=0.005, mixed_pixel=0.5)",
            "LaserNoise(sigma_m=0.01, quantisation_m=0.01, dropout=0.005, mixed_pixel=0.5)",
        ),
    ],
    "twin/sensors/camera.py": [
        ("half a pixel off", "Lens.intrinsics", "((_A - 1) / 2, (_B - 1) / 2)", "(_A / 2, _B / 2)"),
        ("read noise not squared", "CameraNoise._draw_bank", "_A ** 2", "_A"),
    ],
    "twin/sensors/fisheye.py": [
        ("blue for red", "_Faces.bend", "cv2.COLOR_RGBA2RGB", "cv2.COLOR_RGBA2BGR"),
    ],
    "twin/sensors/schedule.py": [
        ("first look a period late", "Schedule._looks", "_A / _B", "(_A + 1) / _B"),
        ("jitter both ways", "Schedule._looks", "timing.jitter_s * late", "timing.jitter_s * (2 * late - 1)"),
        ("drifts from the start", "MessageFaults.reported_stamp_ns", "_A - _B", "_A"),
    ],
    "twin/sensors/pinhole.py": [
        ("depth upside down", "Stereo.observe", "_A[::-1]", "_A"),
        ("noise on depth, not disparity", "Stereo._measured", "_A / _B + _C", "_A / (_B + _C)"),
    ],
    "twin/sensors/fault_kinds.py": [
        ("a frame too long", "_Fault.holds", "_A < round(_B * _C)", "_A <= round(_B * _C)"),
    ],
    "twin/sensors/fault_effects.py": [
        ("axes exchanged", "LensCover.cover", "_A[0]", "_A[1]"),
        ("last beam left out", "DeadBeamMask._which", "_A[-1] + 1", "_A[-1]"),
    ],
    "twin/sensors/floor_electronics.py": [
        ("crosstalk twice as large", "spread_to_neighbours", "_A / 4", "_A / 2"),
    ],
    "twin/sensors/floor.py": [
        ("sign of a torque", "_FootGroup.press", "-_A[:, 0]", "_A[:, 0]"),
    ],
    "twin/world/truth_details.py": [
        ("one beam too many", "person_runs", "RayRun(_A, _B, _C - 1)", "RayRun(_A, _B, _C)"),
    ],
    "twin/truth/situations.py": [
        ("no beam may look past", "_splits", "_A + 1", "_A"),
        ("rotation transposed", "scan_points", "_A[:2, :2]", "_A[:2, :2].T"),
    ],
    "twin/truth/visibility.py": [
        ("plane band twice as high", "first_hits", "np.abs(_A[..., 2]) <= _B", "np.abs(_A[..., 2]) <= 2 * _B"),
        (
            "width and height exchanged",
            "person_boxes",
            "Box(_A, _B, _C, _D, _E, int(_F[_A]), _A in _G)",
            "Box(_A, _B, _C, _E, _D, int(_F[_A]), _A in _G)",
        ),
    ],
    "twin/recording/ros/ros_messages.py": [
        ("blue for red", "_encode_image", "cv2.cvtColor(_A, cv2.COLOR_RGB2BGR)", "_A"),
        ("sweep a beam too long", "_scan", "max(_A - 1, 0)", "_A"),
    ],
    "twin/recording/ros/depth_images.py": [
        ("millimetres cut off", "encode_png", "np.rint", "np.floor"),
    ],
    "twin/recording/reader.py": [
        ("start added, not taken off", "Recording.__init__", "right.stamps_ns[_A] - _B", "right.stamps_ns[_A] + _B"),
    ],
    "twin/evaluate/clear.py": [
        ("switches cost nothing", "ClearScores.mota", "_A + _B + _C", "_A + _B"),
    ],
    "twin/evaluate/hota.py": [
        ("alignment over both", "hota", "either - overlap", "either"),
    ],
    "twin/evaluate/judged_frames.py": [
        ("angles not wrapped", "_people_at", "wrap_angle(change)", "change"),
    ],
    "twin/evaluate/continuity.py": [
        ("coasting counts", "continuity", "if not _A:\n    continue", ""),
    ],
    "twin/evaluate/causes.py": [
        ("hidden from any sensor", "long_occlusions", "_A &= _B[_C] == 0", "_A |= _B[_C] == 0"),
    ],
}
"""By module: what is wrong, the definition (or "": the module), pattern, what takes its place."""

BUGS = tuple(
    Bug(name, f"{file}:{definition}", old, new)
    for file, bugs in _BY_FILE.items()
    for name, definition, old, new in bugs
)
