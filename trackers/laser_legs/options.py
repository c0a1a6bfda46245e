"""Options of the tracker of legs."""

from __future__ import annotations

from pydantic import Field

from trackers.configuration import Strict
from trackers.frames.rig_frames import ReportFrame
from trackers.frames.scan_matching import MatchingOptions
from trackers.tracking.track_manager import TrackManagementOptions


class LaserLegsOptions(Strict):
    """Options of the classifier's use, the association, the frame, and those of every tracker."""

    least_evidence: float = Field(
        default=-2.0,
        description="evidence below which a cluster is no leg of anybody [nat]; the logarithm of a likelihood ratio",
    )
    start_evidence: float = Field(
        default=0.0, description="evidence from which on a cluster may initiate a track [nat]"
    )
    reach_m: float = Field(default=0.55, gt=0, description="how far a leg may be from where its person is expected [m]")
    half_depth_m: float = Field(default=0.04, ge=0, description="how far a leg's axis lies behind its samples [m]")
    measurement_m: float = Field(default=0.1, gt=0, description="standard deviation of a measured position [m]")
    existence: float = Field(default=0.5, gt=0, lt=1, description="existence from which on a track is confirmed")
    least_existence: float = Field(
        default=0.3, gt=0, lt=1, description="existence below which a confirmed track is not reported"
    )
    report_apart_m: float = Field(
        default=0.35,
        ge=0,
        description="a track nearer than this to a likelier one is not reported: two people do not stand in one place [m]",
    )
    report_in: ReportFrame = Field(
        default="rig",
        description="frame of the reports. rig: the one that the rig is given in, odometry's for a scanner mounted on a base, "
        "the scanner's own where the rig says that it stands; matched: the fixed frame that scan matching finds; sensor: the "
        "scanner's own at each frame, which moves with it, of the main one where there are several",
    )
    matching: MatchingOptions = Field(default=MatchingOptions(), description="how scans are matched with the last ones")
    track_management: TrackManagementOptions = Field(
        default=TrackManagementOptions(confirm_hits=1, coast_s=1.5, tentative_coast_s=1.5, start_apart_m=0.5),
        description="when tracks are initiated, confirmed, reported and deleted",
    )
