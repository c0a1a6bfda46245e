"""Two trackers on the same observations, beside the truth.

Run it: python docs/examples/02-two-trackers.py [PICTURE.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import twin

scenario = twin.load_scenario("lab-five-people", ["duration_s=4"])
truth = []
with twin.Simulation(scenario, on_truth=truth.append, images=False) as simulation:
    rig, background, observations = simulation.rig, simulation.background(), list(simulation)
people = twin.truth_table(truth)

figure, panels = plt.subplots(1, 2, figsize=(9, 4), sharex=True, sharey=True, layout="constrained")
for name, axes in zip(("sort", "laser-imm"), panels, strict=True):
    tracker = twin.make_tracker(name, rig, background, twin.stream(scenario.seed, "tracker", name))
    tracks = twin.track_table(twin.track_frames(tracker, rig, observations))
    metrics = twin.evaluate_tracks(people, tracks)
    axes.plot(people.x, people.y, ".", color="0.85")
    axes.scatter(tracks.x, tracks.y, c=tracks.id % 10, cmap="tab10", s=4)
    axes.set(title=f"{name}: HOTA {metrics['hota']:.3f}", xlabel="x [m]", aspect="equal")
panels[0].set_ylabel("y [m]")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "02-two-trackers.png")
