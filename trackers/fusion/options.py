"""Options of `fusion`: how exactly each kind of sensor measures a person, and how long evidence lasts."""

from __future__ import annotations

from pydantic import Field, PositiveInt

from trackers.configuration import Strict, described
from trackers.tracking.track_manager import TrackManagementOptions


class KindOptions(Strict):
    """Options of one kind of sensor."""

    sigma_m: float = Field(
        gt=0, description="standard deviation that a measurement of a person's place has besides its own variance [m]"
    )
    offset_m: float = Field(
        ge=0,
        description="standard deviation, on each axis, of the part of the error that stays while a person is seen alike; it "
        "counts in the stated radius [m]",
    )
    p_detect: float = Field(
        gt=0.5,
        lt=1,
        description="detection probability of a standing person that nothing hides, above that of missing one",
    )
    clutter_m2: float = Field(gt=0, description="density of measurements that are no known person's [1/m²]")
    lasts_s: float = Field(
        gt=0, description="time in which all measurements of a person by one sensor together tell what one tells [s]"
    )


def _kind(sigma_m: float, offset_m: float, p_detect: float, clutter_m2: float, lasts_s: float, what: str):
    options = KindOptions(sigma_m=sigma_m, offset_m=offset_m, p_detect=p_detect, clutter_m2=clutter_m2, lasts_s=lasts_s)
    return Field(default=options, description=what)


class HeadEvidenceOptions(Strict):
    """Options of heads, measured by silhouettes and distances."""

    samples: PositiveInt = Field(default=96, ge=8, le=4096, description="points at which a head's density is weighed")
    stays_s: float = Field(
        default=0.6, gt=0, description="time constant in which a head forgets where it was from the body [s]"
    )
    over_body_m: float = Field(
        default=0.018,
        gt=0,
        description="standard deviation of an upright person's head over the pelvis, on each axis [m]",
    )


class ColourIdentityOptions(Strict):
    """Options of identities: what is remembered of people, and who comes out of hiding."""

    grows_s: float = Field(
        default=0.45, gt=0, description="time constant in which a stature grows to a higher head [s]"
    )
    learns_s: float = Field(default=8.0, gt=0, description="time constant in which clothes and weights are learned [s]")
    recall_s: float = Field(
        default=300.0,
        ge=0,
        description="a person who has left is re-identified by clothes and weight for so long [s]; 0: never",
    )
    gate: float = Field(
        default=4.0,
        ge=0,
        description="Mahalanobis distance of a new track from a hidden one up to which it is that one's person, if their clothes "
        "and weights tell nothing; 0: never",
    )


class FusionTrackManagementOptions(TrackManagementOptions):
    """Those of every tracker, and existence."""

    confirm_hits: PositiveInt = Field(default=2, description=described(TrackManagementOptions, "confirm_hits"))
    coast_s: float = Field(
        default=2.0,
        ge=0,
        description="a confirmed track not measured for longer is deleted [s], unless its person more likely exists than not",
    )
    tentative_coast_s: float = Field(
        default=0.4, ge=0, description=described(TrackManagementOptions, "tentative_coast_s")
    )
    start_apart_m: float = Field(default=0.6, ge=0, description=described(TrackManagementOptions, "start_apart_m"))
    survival_s: float = Field(default=30.0, gt=0, description="how long people whom nothing shows stay on average [s]")
    lies_down_s: float = Field(
        default=60.0,
        gt=0,
        description="how long people are upright on average before they are lower than trunks are looked for [s]",
    )
    within_m: float = Field(
        default=0.5,
        gt=0,
        description="a coasting track is reported while its person exists and stands this near to the reported place more "
        "probably than not [m]",
    )


class FusionOptions(Strict):
    """Options of `fusion`."""

    step_s: float = Field(
        default=0.1, ge=0.001, description="time step that motion and the detection probability are for [s]"
    )
    max_wait_s: float = Field(
        default=0.15,
        ge=0,
        description="how long an observation waits for older ones of other sensors [s]; longer for one that keeps arriving later",
    )
    trunk: KindOptions = _kind(0.01, 0.015, 0.95, 1e-3, 0.1, "trunks at waist height")
    legs: KindOptions = _kind(0.07, 0.025, 0.95, 1e-2, 0.1, "legs at knee height")
    camera: KindOptions = _kind(0.035, 0.05, 0.8, 3e-2, 0.3, "people in the picture of a camera")
    stereo: KindOptions = _kind(0.08, 0.06, 0.7, 1e-2, 0.3, "people in the depths of a stereo camera")
    floor: KindOptions = _kind(0.09, 0.06, 0.8, 1e-2, 0.3, "loads on a pressure floor")
    head: HeadEvidenceOptions = Field(default=HeadEvidenceOptions(), description="heads, where a camera shows them")
    identity: ColourIdentityOptions = Field(
        default=ColourIdentityOptions(), description="identities of people who meet"
    )
    track_management: FusionTrackManagementOptions = Field(
        default=FusionTrackManagementOptions(),
        description="when tracks are initiated, confirmed, reported and deleted",
    )
