"""The pictures of docs/viewer.md, and those of docs/gallery.md that no page draws: `make gallery`.

    python scripts/gallery.py [NAME ...]

Each is one command of ours; written to docs/pictures.
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


def main(names: list[str]) -> None:
    """Draw those that are named, or all."""
    for name in names or COMMANDS:
        print(name, flush=True)
        draw(name)


if __name__ == "__main__":
    main(sys.argv[1:])
