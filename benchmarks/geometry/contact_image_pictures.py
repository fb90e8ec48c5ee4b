"""Draw docs/pictures/contact_images.png: `python -m benchmarks.geometry.contact_image_pictures`."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from benchmarks import ROOT

mpl.use("Agg")

import matplotlib.pyplot as plt

from skinmap.io.robots.manifest import load_robot
from skinmap.recognition.protocols.baxter import PART, ROBOT
from skinmap.recognition.protocols.baxter_images import GESTURES, simulate_images
from skinmap.touch.images.contact_image import image_geometry
from skinmap.touch.prepared_skin import PreparedSkin

TARGET = ROOT / "docs" / "pictures" / "contact_images.png"


def main() -> None:
    """One touch of each gesture: the image as published; the coverage; a fine image."""
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
    figure.savefig(TARGET, dpi=90)


if __name__ == "__main__":
    main()
