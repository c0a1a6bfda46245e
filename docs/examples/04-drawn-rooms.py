"""The baseline in four drawn rooms: places of people, coloured by the distance of their track.

Run it: python docs/examples/04-drawn-rooms.py [PICTURE.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import twin

figure, panels = plt.subplots(1, 4, figsize=(13, 3.6), layout="constrained")
for seed, axes in enumerate(panels, start=1000):
    scenario = twin.load_scenario("drawn", [f"seed={seed}", "duration_s=3"])
    truth = []
    with twin.Simulation(scenario, on_truth=truth.append, images=False) as simulation:
        tracker = twin.make_tracker(
            "sort", simulation.rig, simulation.background(), twin.stream(seed, "tracker", "sort")
        )
        tracks = twin.track_table(twin.track_frames(tracker, simulation.rig, simulation))
        for name, sensor in simulation.rig.sensors.items():
            axes.plot(*sensor.room_from_sensor.translation[:2], "k^", label=name)
    people = twin.truth_table(truth)
    metrics = twin.evaluate_tracks(people, tracks)
    axes.plot(people.x, people.y, ".", color="0.8", markersize=3)
    axes.scatter(tracks.x, tracks.y, c=tracks.id % 10, cmap="tab10", s=3)
    axes.set(title=f"seed {seed}: MOTA {metrics['mota']:.2f}", aspect="equal")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "04-drawn-rooms.png")
