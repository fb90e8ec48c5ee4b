"""Calibrate a patch"""

# %%
# A new patch is a flat board of taxels glued to a curved link. Its layout is known, its place is
# not. This tutorial finds every taxel from the places of four, on a board whose true places we
# know: 160 taxels of the iCub's right forearm. The anchors are simulated, with 1 mm of noise.
#
# Run it with `python docs/tutorials/calibrate_a_patch.py FOLDER`; it writes one picture there.
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np

import skinmap
from calibration import wrap_layout

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(0)

# %%
# ## The board, the link, and the truth
#
# The board is the flat map of a real patch, so that it can be bent onto the link again; of it we
# keep the sixteen modules nearest to its middle.
robot = skinmap.load_robot("icub")
skin = robot.skin("right_forearm")
link = robot.mesh(skin.link)
chart = max(
    skinmap.flatten(skinmap.build_surface(skin)).charts, key=lambda chart: len(chart.taxels)
)
modules = skin.modules[chart.taxels]
names = np.unique(modules)
middles = np.array([chart.uv[modules == name].mean(axis=0) for name in names])
near = np.argsort(np.linalg.norm(middles - chart.uv.mean(axis=0), axis=1))[:16]
keep = np.isin(modules, names[near])
board, truth = chart.uv[keep], skin.positions[chart.taxels[keep]]
print(f"{len(board)} taxels on {len(near)} modules")

# %%
# ## Four anchors at the far ends
#
# Each next anchor is the taxel that is furthest from those chosen before. A person would click
# them in `skinmap calibrate wrap --window`, or measure them with an arm.
anchors = [int(np.argmin(board.sum(axis=1)))]
while len(anchors) < 4:
    gaps = np.linalg.norm(board[:, None] - board[anchors], axis=2).min(axis=1)
    anchors.append(int(np.argmax(gaps)))
points = truth[anchors] + rng.normal(0.0, 1e-3, (4, 3))

# %%
# ## Wrap the board round the link
found = wrap_layout(board, link.vertices, link.faces, anchors, points, anchor_sigma=1e-3, rng=rng)
error_mm = 1e3 * np.linalg.norm(found.positions - truth, axis=1)
said_mm = 1e3 * found.predicted_sd
print("status:", found.status, *found.reasons)
print(f"error {np.median(error_mm):.2f} mm in the median, {said_mm.mean():.2f} mm predicted")
print("measure next:", found.next_taxels[:3].tolist())

# %%
# `status` says whether the result may be used as it is. Only a simulation knows the error; on a
# real robot the predicted one is all there is, so it must be honest: the two should be alike.
figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained", sharey=True)
for axis, values, title in ((axes[0], said_mm, "predicted"), (axes[1], error_mm, "true")):
    dots = axis.scatter(
        *(1e3 * board).T, c=values, s=36, vmin=0, vmax=max(said_mm.max(), error_mm.max())
    )
    axis.plot(*(1e3 * board[anchors]).T, "r^", ms=11, mfc="none", mew=1.8, label="anchor")
    axis.set(aspect="equal", title=f"{title} error", xlabel="board [mm]", ylabel="board [mm]")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left")
figure.colorbar(dots, ax=axes, label="mm", shrink=0.8)
figure.savefig(folder / "calibrate_a_patch.png", dpi=110)

# %%
# ![Predicted and true error of each taxel](../pictures/tutorials/calibrate_a_patch.png)
#
# The same from files: `skinmap calibrate wrap --layout board.csv --mesh link.stl --anchors
# anchors.csv -o out`. The [guide](../calibration.md) has touches, scans and self-touch too, the
# [theory](../theory.md#calibration) what is minimised.
