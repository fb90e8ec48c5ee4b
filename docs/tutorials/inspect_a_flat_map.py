"""Inspect a flat map"""

# %%
# A skin is curved and a picture is flat. This tutorial lays the taxels of the iCub's left thigh in
# the plane, measures what that costs, and looks for the places where it costs most.
#
# Run it with `python docs/tutorials/inspect_a_flat_map.py FOLDER`; it writes one picture there.
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np

import skinmap

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)

# %%
# ## Taxels become a mesh, the mesh becomes a map
#
# Every taxel is a vertex of the surface mesh, and every triangle is kept in the map.
skin = skinmap.load_robot("icub").skin("left_leg_upper")
mesh = skinmap.build_surface(skin)
flat = skinmap.flatten(mesh, method="balanced")
chart = max(flat.charts, key=lambda chart: len(chart.taxels))
print(f"{len(skin)} taxels, {len(flat.charts)} charts, {flat.flips} triangles turned over")

# %%
# ## What it costs
#
# The map is taken at the scale that keeps its area, so that its size does not count. An edge of
# the map that is 1 % longer or shorter than on the body has a strain of 1 %.
strain = 100 * chart.distortion.face_edge_strain(chart.faces)
summary = chart.distortion.summary()
print(f"edge error {summary.edge_rms_percent:.2f} % rms, method {chart.method}")
worst = int(np.argmax(strain))
print("worst triangle: channels", skin.channels[chart.taxels[chart.faces[worst]]].tolist())

# %%
# Other methods keep other things. A conformal map keeps angles and pays with areas.
for method in ("bff", "arap", "accurate"):
    other = skinmap.flatten(mesh, method=method)
    rms = 100 * max(chart.distortion.edge_rms for chart in other.charts)
    print(f"{method:10s} edge error {rms:.2f} %, worst chart")

# %%
# ## Look at it
#
# A dark triangle has edges that are longer or shorter on the map than on the body; the red ring is
# the worst one.
figure, axes = plt.subplots(figsize=(7, 5.4), layout="constrained")
uv_mm = 1e3 * chart.uv
colours = axes.tripcolor(*uv_mm.T, chart.faces, facecolors=strain, cmap="cividis_r", vmin=0)
axes.plot(*uv_mm[chart.faces[worst]].mean(axis=0), "o", ms=16, mfc="none", mec="red", mew=2)
axes.set(aspect="equal", xlabel="mm", ylabel="mm", title="Edge strain, left thigh of the iCub")
figure.colorbar(colours, label="edge strain [%]", shrink=0.8)
figure.savefig(folder / "inspect_a_flat_map.png", dpi=110)

# %%
# ![Edge strain on the flat map of the thigh](../pictures/tutorials/inspect_a_flat_map.png)
#
# `skinmap flatten icub --part left_leg_upper --out maps` draws the same with the body beside it.
# The [theory of flat maps](../theory.md#flat-maps) has the formulas.
