"""The pictures of docs/viewer.md, and those of docs/gallery.md that no page draws: `make gallery`.

    python scripts/gallery.py [NAME ...]

Each is one command of ours, but for the glossary's picture and that of contact images; written to
docs/pictures.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "pictures"
SKINMAP = Path(sys.executable).with_name("skinmap")
WIDTH = 720  # of a picture in the pages [px]

# What `skinmap view` draws.
VIEWS = {
    **{
        f"viewer/{layer}": f"icub --source sim --layer {layer}"
        for layer in ("pressure", "structures", "distortion", "health")
    },
    "gallery/kaspar_touches": "kaspar --source sim --at 3",
    "gallery/baxter_forearm": "baxter-forearm --source sim",
    "gallery/cyskin_arm": "ur10e-cyskin --source sim --at 3",
    "gallery/torso_modules": "icub --part torso --layer patches",
}
# What other commands leave in a folder, and the picture in it.
FOLDERS = {
    "gallery/foot_map": ("flatten icub --part left_foot", "left_foot.png"),
    "gallery/torso_map": ("flatten icub --part torso", "torso.png"),
    "gallery/forearm_structures": ("structures icub --part right_forearm", "structures.png"),
    "gallery/kaspar_structures": ("structures kaspar --part torso", "structures.png"),
}
# The command of each picture; OUT is a fresh folder, and the picture is taken from it.
COMMANDS = {
    **{name: (f"view {words} --screenshot OUT/a.png", "a.png") for name, words in VIEWS.items()},
    **{name: (f"{words} --out OUT", made) for name, (words, made) in FOLDERS.items()},
}


def draw(name: str) -> None:
    """Draw one picture, and make it as large as the pages show it."""
    from PIL import Image

    words, made = COMMANDS[name]
    with tempfile.TemporaryDirectory() as folder:
        command = [str(SKINMAP), *words.replace("OUT", folder).split()]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with Image.open(Path(folder) / made) as whole:
            picture = whole.copy()
    picture.thumbnail((WIDTH, WIDTH))
    few_colours(picture).save(OUT / f"{name}.png", optimize=True)


def few_colours(picture: Any) -> Any:
    """The picture in 256 colours: a third of the bytes, the same to the eye.

    They are chosen to cover all colours: the commonest ones alone would turn a legend's rare red
    into the body's grey.
    """
    from PIL import Image

    chosen, plain = Image.Quantize.MAXCOVERAGE, Image.Dither.NONE
    return picture.convert("RGB").quantize(256, chosen, dither=plain)


def glossary(path: Path) -> None:
    """A thigh with the words of the glossary: on its link, and its chart with a moment of touch."""
    import matplotlib as mpl
    import numpy as np

    import skinmap

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    robot = skinmap.load_robot("icub")
    skin = robot.skin("left_leg_upper")
    chart = skinmap.flatten(skinmap.build_surface(skin)).charts[0]
    figure = plt.figure(figsize=(10, 5), dpi=100)
    body = figure.add_subplot(1, 2, 1, projection="3d")
    link = robot.mesh(skin.link)
    some = np.random.default_rng(0).choice(len(link.vertices), 2500)
    body.scatter(*(1e3 * link.vertices[some]).T, color="#c3cad1", s=1)
    places = 1e3 * skin.positions
    body.scatter(*places.T, color="#34506b", s=5, depthshade=False)
    for axis, colour in zip(np.eye(3) * 60, ("#c0392b", "#2e8b57", "#2b6cb0"), strict=True):
        body.plot(*np.column_stack([np.zeros(3), axis]), color=colour, lw=2)
    words = (
        "axes: the frame of the link\nplacement: where the patch is in it\n"
        "dots: taxels of the patch"
    )
    body.text2D(0.0, 0.0, words, transform=body.transAxes, fontsize=8, color="#34506b")
    body.set_title("link, with a patch of skin", fontsize=9)
    body.set_box_aspect(np.ptp(1e3 * link.vertices, axis=0))
    body.set_axis_off()
    _chart(figure.add_subplot(1, 2, 2), chart, skin)
    figure.tight_layout()
    figure.savefig(path)


def _chart(axes: Any, chart: Any, skin: Any) -> None:
    """The chart with a module, a structure, its border and a touch."""
    import numpy as np

    u, v = 1e3 * chart.uv.T
    taxel = chart.taxels
    axes.triplot(u, v, chart.faces, color="#c3cad1", lw=0.5)
    axes.plot(u, v, ".", color="#34506b", ms=3)
    edges = np.sort(np.concatenate([chart.faces[:, k] for k in ([0, 1], [1, 2], [2, 0])]), axis=1)
    pairs, counts = np.unique(edges, axis=0, return_counts=True)
    for a, b in pairs[counts == 1].tolist():
        axes.plot(u[[a, b]], v[[a, b]], color="#d9902f", lw=1.6)
    far = np.hypot(u - u.min(), v - v.max())
    board = skin.modules[taxel] == skin.modules[taxel[np.argsort(far)[len(far) // 4]]]
    axes.plot(u[board], v[board], "o", color="#c0392b", ms=4)
    inner = int(np.argmin(np.hypot(u - u.mean(), v - v.mean())))
    around = np.unique(pairs[(pairs == inner).any(axis=1)])
    axes.plot(u[around], v[around], "o", color="#2e8b57", ms=4)
    low = int(np.argmin(np.hypot(u - np.quantile(u, 0.7), v - np.quantile(v, 0.15))))
    axes.scatter(u, v, s=90 * np.exp(-((u - u[low]) ** 2 + (v - v[low]) ** 2) / 150),
                 color="#6b1f7c", alpha=0.7, lw=0)  # fmt: skip
    right, height = u.max() + 12, np.linspace(v.max(), v.min(), 5)
    words = [
        ("module: one board", "#c0392b", (u[board].mean(), v[board].mean())),
        ("structure: a taxel\nand its neighbours", "#2e8b57", (u[inner], v[inner])),
        ("triangle of the surface mesh", "#8a96a3", (u[chart.faces[5]].mean(),
                                                     v[chart.faces[5]].mean())),
        ("a moment of touch", "#6b1f7c", (u[low], v[low])),
        ("border or seam of the chart", "#a8651a", (u[np.argmin(v)], v.min())),
    ]  # fmt: skip
    for (text, colour, place), y in zip(words, height, strict=True):
        axes.annotate(text, place, (right, y), color=colour, fontsize=8, va="center",
                      arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.8})  # fmt: skip
    axes.set_xlim(u.min() - 5, right + 0.75 * np.ptp(u))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title("chart: the patch laid flat", fontsize=9)


def contact_images(path: Path) -> None:
    """One touch of each gesture: the image as published; the coverage; a fine image."""
    import matplotlib as mpl
    import numpy as np

    from skinmap.io.robots.manifest import load_robot
    from skinmap.recognition.protocols.baxter import PART, ROBOT
    from skinmap.recognition.protocols.baxter_images import GESTURES, simulate_images
    from skinmap.touch.images.contact_image import image_geometry
    from skinmap.touch.prepared_skin import PreparedSkin

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    skin = PreparedSkin(load_robot(ROBOT).skin(PART))
    data = simulate_images(skin, images=120, rng=np.random.default_rng(4))
    names = [name for group in GESTURES.values() for name in group]
    first = {name: int(np.flatnonzero(data.gestures == name)[1]) for name in names}
    figure, axes = plt.subplots(3, 3, figsize=(10, 7.4), layout="constrained")
    for axis, name in zip(axes.flat, names, strict=False):
        axis.imshow(data.images[first[name]], cmap="gray", vmin=0, vmax=255)
        axis.set_title(name.replace("_", " "))
    coverage = axes.flat[7].imshow(skin.image_geometry.coverage, cmap="viridis", vmin=0, vmax=1)
    axes.flat[7].set_title("coverage of the 8 mm grid")
    figure.colorbar(coverage, ax=axes.flat[7], location="bottom", shrink=0.8)
    fine = image_geometry(skin.flat, pitch=1e-3)
    image = np.where(fine.mask, fine.image(data.raw[first["whole_hand"]]), np.nan)
    axes.flat[8].imshow(image, cmap="magma")
    axes.flat[8].set_title("whole hand, 1 mm pixels")
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
    figure.savefig(path, dpi=90)


DRAWN = {"glossary": glossary, "contact_images": contact_images}  # by no command


def main(names: list[str]) -> None:
    """Draw those that are named, or all."""
    for name in names or [*COMMANDS, *DRAWN]:
        print(name, flush=True)
        if name in DRAWN:
            DRAWN[name](OUT / f"{name}.png")
        else:
            draw(name)


if __name__ == "__main__":
    main(sys.argv[1:])
