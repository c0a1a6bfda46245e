"""One frame of scans with the truth.

Run it: python docs/examples/01-scans-and-truth.py [PICTURE.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import twin

scenario = twin.load_scenario("lab-five-people", ["duration_s=1"])
truth, scans = [], {}
with twin.Simulation(scenario, on_truth=truth.append, images=False) as simulation:
    for scan in simulation:
        scans[scan.sensor] = scan
    rig = simulation.rig

figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
for name, scan in scans.items():
    pose, hit = rig.sensors[name].room_from_sensor, np.isfinite(scan.ranges_m)
    bearing, distance = scan.angles_rad[hit], scan.ranges_m[hit]
    local = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), np.zeros_like(distance)])
    x, y, _ = (local @ pose.rotation.T + pose.translation).T
    axes.plot(x, y, ".", markersize=3, label=name)
people = twin.truth_table(truth)
last = people.t == people.t.max()
axes.plot(people.x[last], people.y[last], "o", markersize=14, fillstyle="none", color="0.3", label="truth")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "01-scans-and-truth.png")
