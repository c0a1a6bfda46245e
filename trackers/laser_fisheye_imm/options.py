"""Options of `laser-fisheye-imm`: variable parts of the paper's system and of our additions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, Field, PositiveInt

from trackers.configuration import Strict, described, leaves_of
from trackers.filters.motion import AGILE, IMM_MODELS, MODE_STAYS, SINGLE_TURN, VelocityMotion
from trackers.frames.moving_scanners import ReportIn
from trackers.laser.clusters import STRIDE_M
from trackers.laser.layer import KneeOptions, LayerOptions, ScannerOptions, WaistOptions
from trackers.laser_fisheye_imm.laser_tracks import PostureOptions
from trackers.likelihood.legs import BOTH_LEGS_M, LegOptions, TrunkOptions
from trackers.rig import Role
from trackers.tracking.track_manager import ReidentificationOptions, TrackManagementOptions
from trackers.vision.histogram import HistogramOptions
from trackers.vision.person_windows import TorsoOptions

START_SPEED_M_S = 1.5
"""Standard deviation of a new track's speed [m/s]; not in the paper."""
EVEN_AT = 0.37
"""E at which a colour is as likely the same person's as another's, used for unknown ones; measured in the twin. 0 for the
paper's cost.
"""
WRONG_LOOK = 0.005
"""Share of torso views that show an occluder, which bounds the cost of a wrong colour; 0 for the paper's cost."""
EXPLAINED_BELOW = 2.0
"""Mahalanobis distance up to which a visible track explains a measurement, which is then not re-identified."""
TORSO_HISTOGRAM = HistogramOptions(grey_bins=0, smoothing_deg=0.0)
"""Hue only, as in the paper."""


class ImmTrackManagementOptions(TrackManagementOptions, ReidentificationOptions):
    """Common track management options, and rules for learned backgrounds, existence, and reporting."""

    confirm_s: float = Field(
        default=0.15,
        ge=0,
        description=described(TrackManagementOptions, "confirm_s")
        + "; at least 0.3 s where the background is learned (ours; the paper: 0.5 s)",
    )
    confirm_samples: PositiveInt | None = Field(
        default=4,
        description="a track whose first measurement has so many samples is confirmed at once, since noise and edges give fewer; "
        "not where beams have never returned from behind it; null: none is (ours)",
    )
    confirm_learned_s: ClassVar[float] = 0.3
    """Least time for which a tentative track is measured before it is confirmed where the background is learned [s]."""
    confirm_open_s: ClassVar[float] = 0.5
    """The same where beams have never returned from behind it [s] (the paper's)."""
    confirm_moved_m: float = Field(
        default=0.15,
        ge=0,
        description="where the background is learned and beams have never returned from behind it, a tentative track is "
        "confirmed only this far from where it started, since a dark surface there returns now and then [m]; 0: anywhere (ours)",
    )
    coast_s: float = Field(
        default=1.5,
        ge=0,
        description="a confirmed track not measured for longer is deleted [s], but for one that still exists",
    )
    tentative_coast_s: float = Field(
        default=0.0,
        ge=0,
        description=described(TrackManagementOptions, "tentative_coast_s")
        + "; with `survival_s`, one that no scan contradicts waits for the scanners that have not scanned since (ours)",
    )
    survival_s: float | None = Field(
        default=30.0,
        gt=0,
        description="how long people whom nothing shows stay on average, from which, and from how probably each scan would have "
        "shown them, follows whether a track still exists [s]; null: that is not asked, and a track is reported while it "
        "coasts (ours)",
    )
    exists_above: float = Field(
        default=0.5,
        ge=0,
        lt=1,
        description="probability above which a coasting track is reported, and, of existence alone, goes on after `coast_s` in "
        "a rig with an area (ours)",
    )
    within_m: float | None = Field(
        default=0.5,
        gt=0,
        description="a coasting track is reported while its person exists and stands within this radius of the reported place "
        "more probably than `exists_above` [m]; null: while the person exists, wherever that may be (ours)",
    )
    apart_m: float = Field(
        default=0.3,
        ge=0,
        description="distance within which there is never a second person: an unseen one is not where another is seen, a third "
        "leg so near a trunk's is a bag of theirs, and a measurement so near a prediction is never gated off [m]; 0: there may "
        "be (ours)",
    )
    start_apart_m: float = Field(
        default=0.6,
        ge=0,
        description="no track is initiated nearer than this to a track or a measurement of one [m]; 0: anywhere (ours)",
    )


class LayerScannerOptions(ScannerOptions):
    """Scanner options of every layer of this system."""

    min_samples: PositiveInt = Field(description="least samples of a cluster that initiates a track")
    min_width_m: float = Field(
        ge=0,
        description="least width of a cluster, as the number of beams that a thing so wide returns at its range [m]",
    )
    hidden_variance_m2: float = Field(
        ge=0, description="measurement variance added for a partly occluded cluster [m²] (ours)"
    )

    def layer(self, defaults: LayerOptions, **own: Any) -> LayerOptions:
        """Return the parameters of a layer: these, and its `own`, over the `defaults` of its height."""
        base = self.over(defaults)
        cluster = base.cluster.model_copy(update={"min_samples": self.min_samples, "min_width_m": self.min_width_m})
        return base.model_copy(update={"cluster": cluster, "hidden_variance_m2": self.hidden_variance_m2, **own})


class WaistScannerOptions(LayerScannerOptions):
    """Scanners at waist height: one trunk per person, arms beside it."""

    min_samples: PositiveInt = Field(default=3, description=described(LayerScannerOptions, "min_samples"))
    min_width_m: float = Field(default=0.06, ge=0, description=described(LayerScannerOptions, "min_width_m"))
    half_depth_m: float = Field(default=0.095, ge=0, description=described(ScannerOptions, "half_depth_m"))
    side_half_depth_m: float | None = Field(
        default=0.152,
        ge=0,
        description="how far the axis lies behind the middle of a body seen from its side, which its width and the way it walks "
        "tell [m]; null: as from the front (ours)",
    )
    body_width_m: float | None = Field(
        default=0.3,
        gt=0,
        description="width to which a narrower, partly occluded cluster is completed [m]; null: it is not (ours)",
    )
    hidden_variance_m2: float = Field(
        default=0.003, ge=0, description=described(LayerScannerOptions, "hidden_variance_m2")
    )
    outlines: bool = Field(default=True, description=described(LayerOptions, "outlines"))
    arm_width_m: float | None = Field(
        default=0.16,
        gt=0,
        description="width below which a cluster beside a wider one is its arm [m]; null: arms are people (ours)",
    )

    def parameters(self, weak_samples: int | None) -> LayerOptions:
        """Return the layer's parameters."""
        own = {
            "weak_samples": weak_samples,
            "side_half_depth_m": self.side_half_depth_m,
            "body_width_m": self.body_width_m,
            "satellite_width_m": self.arm_width_m,
            "outlines": self.outlines,
        }
        return self.layer(WaistOptions(), **own)


class KneeScannerOptions(LayerScannerOptions):
    """Scanners at knee height: two legs per person."""

    min_samples: PositiveInt = Field(default=2, description=described(LayerScannerOptions, "min_samples"))
    min_width_m: float = Field(default=0.03, ge=0, description=described(LayerScannerOptions, "min_width_m"))
    half_depth_m: float = Field(default=0.05, ge=0, description=described(ScannerOptions, "half_depth_m"))
    hidden_variance_m2: float = Field(
        default=0.02, ge=0, description=described(LayerScannerOptions, "hidden_variance_m2")
    )

    def parameters(self, weak_samples: int | None) -> LayerOptions:
        """Return the layer's parameters."""
        return self.layer(KneeOptions(), weak_samples=weak_samples)


class AppearanceOptions(Strict):
    """Options of learning and weighting shirts' colours."""

    weight: float = Field(
        default=60.0, ge=0, description="weight w of the appearance E, in the paper's distance d = N + w E (inferred)"
    )
    same_below: float = Field(
        default=0.3, ge=0, description="E up to which two shirts are the same person's in re-identification (ours)"
    )
    memory: float = Field(
        default=TORSO_HISTOGRAM.memory, ge=0, lt=1, description="share of the old colours kept at an update (α, eq. 7)"
    )
    learn_width_m: float = Field(
        default=0.15,
        ge=0,
        description="least width of a cluster whose shirt is learned [m]; 0: every one is (ours)",
    )
    max_overlap: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="share of a torso that another may cover in the picture when its shirt is learned; 1: every one is (ours)",
    )


_SHARED = (
    *(("jump_m", "cluster.jump_m"), ("min_samples", "cluster.min_samples"), ("margin_m", "background.margin_m")),
    *(("min_width_m", "cluster.min_width_m"), ("memory_s", "background.memory_s"), ("p_detect", "free_space.detected")),
)
_MOVED = (*(former for _, former in _SHARED), "satellite_width_m", "weak_samples")
_SCANNERS: Mapping[str, LayerOptions] = {"waist": WaistOptions(), "knee": KneeOptions()}


def _fixed(group: str, values: BaseModel, but: Collection[str]) -> dict[str, Any]:
    """Return the constant values of a group's former options, by path, except present options."""
    return {f"{group}.{path}": value for path, value in leaves_of(values) if path not in but}


class LaserFisheyeImmOptions(Strict):
    """Options of the paper's system and of our additions; `trackers.laser_fisheye_imm.rules` switches ours off."""

    former_names: ClassVar[Mapping[str, str]] = {
        "period_s": "step_s",
        "management.confirm_after_s": "track_management.confirm_s",
        "management.confirm_learned_after_s": "track_management.confirm_learned_s",
        "management.body_radius_m": "track_management.start_apart_m",
        "reach_m_s": "track_management.reid_speed_m_s",
        "management": "track_management",
        "measurement_variance_m2": "trunk.variance_m2",
        "new_density_m2": "clutter_density_m2",
        "colour_weight": "appearance.weight",
        "recognised_below": "appearance.same_below",
        "histogram.memory": "appearance.memory",
        "torso.learn_width_m": "appearance.learn_width_m",
        "torso.max_overlap": "appearance.max_overlap",
        "waist.radius_m": "trunk.gate_m",
        "waist.satellite_width_m": "waist.arm_width_m",
        "knee.radius_m": "legs.gate_m",
        "knee.radius_alone_m": "legs.gate_alone_m",
        "knee.single_leg_s": "legs.single_leg_s",
        "knee.pair_m": "legs.pair_m",
        "knee.weak_samples": "weak_samples",
        "knee.single_leg_variance_m2": "legs.single_leg_variance_m2",
        **{f"{role}.{former}": f"{role}.{name}" for role in _SCANNERS for name, former in _SHARED},
    }
    fixed_values: ClassVar[Mapping[str, Any]] = {
        **_fixed("waist", _SCANNERS["waist"], (*_MOVED, *WaistScannerOptions.model_fields)),
        **_fixed("knee", _SCANNERS["knee"], (*_MOVED, *KneeScannerOptions.model_fields)),
        "even_at": EVEN_AT,
        "wrong_look": WRONG_LOOK,
        "expected_below": EXPLAINED_BELOW,
        "start_by_single_legs": False,
        "lone_leg_density_m2": 1e-3,
        "degrees_of_freedom": None,
        "max_deviations": None,
        "mode_stays": MODE_STAYS,
        "start_speed_m_s": START_SPEED_M_S,
        **_fixed("torso", TorsoOptions(), ("learn_width_m", "max_overlap")),
        **_fixed("histogram", TORSO_HISTOGRAM, ("memory",)),
        "knee.claim_m": 0.5,
        "knee.stride_m": STRIDE_M,
        "knee.both_legs_m": BOTH_LEGS_M,
        "knee.shared": True,
        "knee.half_seen_m2": 0.0,
        "knee.legs_variance_m2": 0.003,
        "trunk.offset_m": 0.018,
        "legs.offset_m": 0.01,
        "motions": tuple((each.kept, each.acceleration_variance) for each in VelocityMotion().models),
        "kalman_motion": (AGILE.kept, AGILE.acceleration_variance),
        "imm_variances": tuple((each.acceleration_variance, each.turn_acceleration_variance) for each in IMM_MODELS),
        "kalman_variances": (SINGLE_TURN.acceleration_variance, SINGLE_TURN.turn_acceleration_variance),
        "knee.opposite": 0.3,
    }

    filter: Literal["imm", "kalman"] = Field(
        default="imm",
        description="interacting multiple models, or the paper's baseline: one model for all that people do, a Kalman filter",
    )
    motion: Literal["velocities", "headings"] = Field(
        default="velocities",
        description="models over velocities: people walk on, change their way, or stand (ours, since a heading cannot tell to "
        "which side a standing person steps); or the paper's, over heading and speed",
    )
    layers: tuple[Role, ...] = Field(
        default=("waist", "knee"), min_length=1, description="roles of the scanners to use, where the rig has them"
    )
    camera: bool = Field(default=True, description="whether to use the camera, where the rig has one")
    clutter_density_m2: float | None = Field(
        default=1e-3,
        gt=0,
        description="density of measurements of new people and of clutter [1/m²]: a pair costs −2 ln of how much likelier it is "
        "than those, and is taken where that is likelier than that the track was not shown (ours); null: a pair costs N + w E, "
        "and as many are taken as can be, as in the paper",
    )
    step_s: ClassVar[float] = 0.1
    """Time step of process and measurement noise, of changes of mode and of the detection probability [s].

    A longer gap is predicted in such steps. Frames that follow sooner have a share of one step's weight: gait and clothes last.
    """
    max_wait_s: float = Field(
        default=0.15,
        ge=0,
        description="how long a frame waits for a sensor that has not reported [s]; longer for one that keeps reporting later",
    )
    smoothed_s: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="how late frames may leave, so that what is measured meanwhile counts: people are reported from their first "
        "measurement on and between measurements [s]; 0: at once (ours)",
    )
    report_in: ReportIn = "rig"
    weak_samples: PositiveInt | None = Field(
        default=1,
        description="least samples of a cluster of a scanner that goes on with a track, but alone initiates none, where nothing "
        "nearer is beside it; null: the same as of any other (ours)",
    )
    waist: WaistScannerOptions = Field(default=WaistScannerOptions(), description="scanners at waist height")
    knee: KneeScannerOptions = Field(default=KneeScannerOptions(), description="scanners at knee height")
    trunk: TrunkOptions = Field(default=TrunkOptions(), description="the likelihood of trunks")
    legs: LegOptions = Field(default=LegOptions(), description="the likelihood of legs")
    appearance: AppearanceOptions = Field(default=AppearanceOptions(), description="shirts in the camera's picture")
    posture: PostureOptions = Field(
        default=PostureOptions(), description="sitting people, detected by their legs, and lying ones"
    )
    track_management: ImmTrackManagementOptions = Field(
        default=ImmTrackManagementOptions(), description="when tracks are initiated, confirmed, reported and deleted"
    )

    def idle(self) -> Iterator[str]:
        """Yield the groups of options that differ from their defaults without effect, with the option that causes it."""
        needs: dict[str, Role] = {"waist": "waist", "knee": "knee", "legs": "knee"}
        for group, role in needs.items():
            if role not in self.layers and getattr(self, group) != type(self).model_fields[group].default:
                yield f"{group}: has no effect where layers are {', '.join(self.layers)}"
        if self.waist.outlines:
            replaced = ("side_half_depth_m", "body_width_m", "hidden_variance_m2")
            for name in replaced:
                if getattr(self.waist, name) != WaistScannerOptions.model_fields[name].default:
                    yield f"waist.{name}: has no effect where waist.outlines is true"
        management, usual = self.track_management, type(self).model_fields["track_management"].default
        if management.survival_s is None and management.exists_above != usual.exists_above:
            yield "track_management.exists_above: has no effect where survival_s is null"
        if self.appearance != AppearanceOptions() and not (self.camera and "waist" in self.layers):
            yield "appearance: has no effect without a camera and a waist scanner"
