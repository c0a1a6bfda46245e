"""Scanners that fail for three seconds: how many people a tracker reports over time.

Run it: python docs/examples/05-fault.py [PICTURE.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import twin

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for label, changes in {
    "without a fault": [],
    "knee silent, waist loses half its beams": [
        "faults.silent={sensor: knee, kind: dropout, from_s: 2, to_s: 5}",
        "faults.coat={sensor: waist, kind: blocked_sector, bearings_deg: [-90, 20], at_m: 0.15, from_s: 2, to_s: 5}",
    ],
}.items():
    scenario = twin.load_scenario("lab-five-people", ["duration_s=6", *changes])
    with twin.Simulation(scenario, images=False) as simulation:
        rng = twin.stream(scenario.seed, "tracker", "imm")
        tracker = twin.make_tracker("laser-imm", simulation.rig, simulation.background(), rng)
        frames = list(twin.track_frames(tracker, simulation.rig, simulation))
    axes.step([frame.stamp_ns / 1e9 for frame in frames], [len(frame.tracks) for frame in frames], label=label)
axes.axvspan(2, 5, color="0.93")
axes.set(xlabel="t [s]", ylabel="tracks", ylim=(0, 7))
axes.legend(frameon=False, loc="lower right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "05-fault.png")
