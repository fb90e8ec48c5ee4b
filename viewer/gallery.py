"""The pictures of docs/viewer.md: `make gallery`, or python -m viewer.gallery FOLDER."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from skinmap.io.robots.manifest import load_robot
from skinmap.live.moment import Moment
from skinmap.skin.robot import Robot
from viewer.interaction.selection import module_taxels
from viewer.scene import Scene
from viewer.view_files import Best
from viewer.view_options import Look, Session, new_scene

SIZE = (960, 720)
SECONDS = 6.0  # of simulated touches that the moment is chosen from
PICTURES: dict[str, tuple[str, str]] = {
    "pressure": ("pressure", "surface"),
    "discs": ("pressure", "discs"),
    "structures": ("structures", "discs"),
    "distortion": ("distortion", "surface"),
    "health": ("health", "discs"),
    "selection": ("pressure", "surface"),
}


def make_gallery(
    robot: Robot,
    parts: tuple[str, ...],
    folder: Path,
    *,
    seed: int = 0,
    size: tuple[int, int] = SIZE,
    seconds: float = SECONDS,
    told: Callable[[str], object] = lambda _: None,
) -> list[Path]:
    """Write all pictures into a folder that exists; the same ones for the same seed."""
    session = Session(robot, parts, seed=seed)
    session.prepare()
    best, seen = Best(session, Look()), []
    for moment in best.watch(session.moments(seconds)):
        seen.append(moment)
        if moment is best.moment:
            kept = len(seen)
    scene = new_scene(session, Look(), size=size, off_screen=True)
    for moment in seen[:kept]:
        scene.show_moment(moment)  # the traces show what came before
    files = []
    for name, (layer, style) in PICTURES.items():
        told(name)
        files.append(_picture(scene, seen[kept - 1], folder / f"{name}.png", layer, style))
    scene.close()
    return files


def _picture(scene: Scene, moment: Moment, path: Path, layer: str, style: str) -> Path:
    scene.follow(moment)
    scene.set_layer(layer)
    scene.set_style(style)
    if path.stem == "selection" and moment.touches:
        touch = moment.touches[0]
        skin = scene.layers[touch.part].skin
        scene.show_flat_map(touch.part)
        scene.select(touch.part, module_taxels(skin, int(touch.taxels[0])))
    return shrink(scene.screenshot(path))


def shrink(path: Path) -> Path:
    """Keep 256 colours of a picture: a third of the bytes, the same to the eye.

    They are chosen to cover all colours: the commonest ones alone would turn a legend's rare red
    into the body's grey.
    """
    from PIL import Image

    chosen, plain = Image.Quantize.MAXCOVERAGE, Image.Dither.NONE
    with Image.open(path) as picture:
        few = picture.convert("RGB").quantize(256, chosen, dither=plain)
    few.save(path, optimize=True)
    return path


def main() -> None:
    """Make the pictures of the whole iCub."""
    robot = load_robot("icub")
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures/viewer")
    folder.mkdir(parents=True, exist_ok=True)
    make_gallery(robot, robot.parts, folder, told=lambda name: sys.stderr.write(f"{name}\n"))


if __name__ == "__main__":
    main()
