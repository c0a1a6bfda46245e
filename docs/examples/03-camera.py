"""A picture of the fisheye camera with the true places of people.

Run it: python docs/examples/03-camera.py [PICTURE.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import twin
from trackers.observations import Image
from trackers.rig import placed_camera

scenario = twin.load_scenario("lab-five-people", ["duration_s=0.5", "background_frames=1"])
truth = []
with twin.Simulation(scenario, on_truth=truth.append) as simulation:
    pictures = [each for each in simulation if isinstance(each, Image)]
    camera = placed_camera(simulation.rig.sensors["fisheye"])

people = twin.truth_table(truth)
now = np.isclose(people.t, pictures[-1].t)
heads = np.column_stack([people.head_x[now], people.head_y[now], people.head_z[now]])
pixels, _ = camera.project(heads)

figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.imshow(pictures[-1].rgb)
axes.plot(*pixels.T, "+", color="yellow", markersize=12)
axes.set_axis_off()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "03-camera.png")
