"""The pictures of docs/gallery.md that no other command draws: a part of `make gallery`.

    python scripts/gallery.py [NAME ...]

Each is one command of ours, or the glossary's picture; written to docs/pictures/gallery.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "pictures" / "gallery"
SKINMAP = Path(sys.executable).with_name("skinmap")
WIDTH = 720  # of a picture in the pages [px]

# What is drawn by which command; OUT is a fresh folder, and the picture is taken from it.
COMMANDS = {
    "kaspar_touches": ("view kaspar --source sim --at 3 --screenshot OUT/a.png", "a.png"),
    "baxter_forearm": ("view baxter-forearm --source sim --at 3 --screenshot OUT/a.png", "a.png"),
    "cyskin_arm": ("view ur10e-cyskin --source sim --at 3 --screenshot OUT/a.png", "a.png"),
    "torso_modules": ("view icub --part torso --layer patches --screenshot OUT/a.png", "a.png"),
    "foot_map": ("flatten icub --part left_foot --out OUT", "left_foot.png"),
    "torso_map": ("flatten icub --part torso --out OUT", "torso.png"),
    "forearm_structures": ("structures icub --part right_forearm --out OUT", "structures.png"),
    "kaspar_structures": ("structures kaspar --part torso --out OUT", "structures.png"),
}


def draw(name: str) -> None:
    """Draw one picture, and make it as large as the pages show it."""
    from PIL import Image

    words, made = COMMANDS[name]
    with tempfile.TemporaryDirectory() as folder:
        command = [str(SKINMAP), *words.replace("OUT", folder).split()]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with Image.open(Path(folder) / made) as whole:
            picture = whole.convert("RGB")
    picture.thumbnail((WIDTH, WIDTH))
    picture.quantize(128, dither=Image.Dither.NONE).save(OUT / f"{name}.png", optimize=True)


def glossary(path: Path) -> None:
    """A foot with the words of the glossary: 3D on the left, its flat map on the right."""
    import matplotlib as mpl
    import numpy as np

    import skinmap

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    skin = skinmap.load_robot("icub").skin("left_foot")
    mesh = skinmap.build_surface(skin)
    chart = skinmap.flatten(mesh).charts[0]
    figure = plt.figure(figsize=(9, 4.2), dpi=100)
    body = figure.add_subplot(1, 2, 1, projection="3d")
    x, y, z = 1e3 * skin.positions.T
    body.plot_trisurf(x, y, z, triangles=mesh.faces, color="#cfd6dd", edgecolor="#8a96a3", lw=0.4)
    first = skin.modules == skin.modules[0]
    body.scatter(x[first], y[first], z[first], color="#d23b2a", s=18, depthshade=False)
    body.text(
        x[first].mean(), y[first].mean(), z.max() + 4, "module\n(its taxels)", color="#d23b2a"
    )
    body.set_title("patch: surface mesh on the link [mm]", fontsize=9)
    body.set_box_aspect(np.ptp(np.column_stack([x, y, z]), axis=0) + 20)
    body.tick_params(labelsize=6)
    flat = figure.add_subplot(1, 2, 2)
    u, v = 1e3 * chart.uv.T
    flat.triplot(u, v, chart.faces, color="#8a96a3", lw=0.6)
    flat.plot(u, v, ".", color="#34506b", ms=4)
    edges = np.sort(np.concatenate([chart.faces[:, k] for k in ([0, 1], [1, 2], [2, 0])]), axis=1)
    pairs, counts = np.unique(edges, axis=0, return_counts=True)
    for a, b in pairs[counts == 1].tolist():
        flat.plot(u[[a, b]], v[[a, b]], color="#d9902f", lw=1.6)
    flat.annotate("border or seam", (u.min(), v.mean()), color="#a8651a", fontsize=9)
    flat.annotate("taxel", (u[0], v[0]), (u[0] + 8, v[0] + 8), color="#34506b", fontsize=9,
                  arrowprops={"arrowstyle": "->", "color": "#34506b"})  # fmt: skip
    flat.set_aspect("equal")
    flat.set_title("chart: the patch laid flat [mm]", fontsize=9)
    flat.tick_params(labelsize=6)
    figure.tight_layout()
    figure.savefig(path)


def main(names: list[str]) -> None:
    """Draw those that are named, or all."""
    OUT.mkdir(parents=True, exist_ok=True)
    for name in names or [*COMMANDS, "glossary"]:
        print(name, flush=True)
        if name == "glossary":
            glossary(OUT.parent / "glossary.png")
        else:
            draw(name)
    shutil.rmtree(OUT / "__pycache__", ignore_errors=True)


if __name__ == "__main__":
    main(sys.argv[1:])
