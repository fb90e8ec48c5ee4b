"""What keys save: views of a scene, and pictures under names that are still free."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinmap.errors import OutputError, SkinMismatchError
from skinmap.skin.robot import Robot
from viewer.interaction.selection import Selection
from viewer.interaction.view_file import SavedView
from viewer.scene import Scene, check_part, check_taxels

NUMBERS = 100_000


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """A file of the folder that does not exist yet: nothing is ever written over.

    Raises
    ------
    OutputError
        The folder is not there, or full of such names.
    """
    if not folder.is_dir():
        raise OutputError(f"no folder {str(folder)!r} to write to")
    for number in range(1, NUMBERS):
        path = folder / f"{stem}-{number:03d}{suffix}"
        if not path.exists():
            return path
    raise OutputError(f"too many files {stem}-*{suffix} in {str(folder)!r}")


def view_of(scene: Scene, selection: Selection) -> SavedView:
    """What a scene shows now, and from where."""
    camera = scene.plotter.renderers[0].GetActiveCamera()
    return SavedView(
        robot=scene.robot.name,
        position=camera.GetPosition(),
        focus=camera.GetFocalPoint(),
        up=camera.GetViewUp(),
        angle=camera.GetViewAngle(),
        mode=scene.framing.mode,
        layer=scene.layer.name,
        style=scene.style,
        part="" if scene.panel is None else scene.panel.part,
        selection={part: tuple(map(int, taxels)) for part, taxels in selection.items()},
    )


def check_view(view: SavedView, robot: Robot) -> None:
    """Raise SkinMismatchError for a view of another robot."""
    if view.robot != robot.name:
        raise SkinMismatchError(
            f"the view was saved of {view.robot!r}, this robot is {robot.name!r}"
        )


def apply_view(scene: Scene, view: SavedView, selection: Selection) -> None:
    """Show what was saved; nothing changes where it does not fit the scene.

    Raises
    ------
    SkinMismatchError, UnknownNameError, InvalidArrayError
        A view of another robot, with taxels that are not there or a layer that does not exist.
    """
    check_view(view, scene.robot)
    for part, taxels in view.selection.items():
        check_taxels(taxels, part, len(check_part(part, scene.layers).skin))
    scene.set_layer(view.layer)
    scene.set_style(view.style)
    if view.part and scene.panel is not None:
        scene.show_flat_map(view.part)
    selection.clear()
    for part, taxels in view.selection.items():
        selection.set(part, np.array(taxels, np.int64))
    scene.framing.mode = "auto" if view.mode == "auto" else "free"
    renderer = scene.plotter.renderers[0]
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*view.position)
    camera.SetFocalPoint(*view.focus)
    camera.SetViewUp(*view.up)
    camera.SetViewAngle(view.angle)
    renderer.ResetCameraClippingRange()
