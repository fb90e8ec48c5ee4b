"""What keys save: views of a scene, pictures, movies, exports, under names that are still free."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from skinmap.errors import OutputError, SkinMismatchError
from skinmap.skin.robot import Robot
from viewer.export.gltf import write_gltf
from viewer.export.html_page import write_html
from viewer.export.movie import MOVIE_FPS, MovieWriter
from viewer.interaction.pointing import Pointing
from viewer.interaction.selection import Selection
from viewer.interaction.view_file import SavedView, load_view, save_view
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


class Files:
    """Writes what a scene shows, and tells in the picture where.

    Parameters
    ----------
    scene : Scene
    pointing : Pointing
        Its selection is part of a view.
    say : callable
        Shows a short line.
    folder : Path, optional
        Where screenshots, movies and exports go; the present one by default.
    view_file : Path, optional
        Where the view is saved and loaded; one in the folder by default.
    """

    def __init__(
        self,
        scene: Scene,
        pointing: Pointing,
        say: Callable[[str], None],
        *,
        folder: Path | None = None,
        view_file: Path | None = None,
    ) -> None:
        self.scene, self.pointing, self.say = scene, pointing, say
        self.folder = Path() if folder is None else folder
        self.view_file = self.folder / "skinmap-view.json" if view_file is None else view_file
        self.recording: MovieWriter | None = None

    def save_view(self) -> None:
        """Write what is shown and from where."""
        save_view(view_of(self.scene, self.pointing.selection), self.view_file)
        self.say(f"view saved in {self.view_file.name}")

    def load_view(self) -> None:
        """Go back to a saved view."""
        apply_view(self.scene, load_view(self.view_file), self.pointing.selection)
        self.pointing.refresh()
        self.say(f"view of {self.view_file.name}")

    def screenshot(self) -> None:
        """Write the picture."""
        path = self.scene.screenshot(free_name(self.folder, "skinmap", ".png"))
        self.say(f"wrote {path.name}")

    def toggle_movie(self) -> None:
        """Begin a movie of what is shown, or end it."""
        if self.recording is None:
            self.recording = MovieWriter(free_name(self.folder, "skinmap", ".mp4"), MOVIE_FPS)
            self.say("movie begins; o ends it")
        else:
            self.end_movie()

    def end_movie(self) -> None:
        """Finish the movie's file, if one is being made."""
        if self.recording is not None:
            movie, self.recording = self.recording, None
            path = movie.close()
            self.say(f"wrote {path.name}" if path is not None else "no picture: no movie")

    def export_gltf(self) -> None:
        """Write the scene as it stands for other 3D programs."""
        path = write_gltf(self.scene, free_name(self.folder, "skinmap", ".glb"))
        self.say(f"wrote {path.name}")

    def export_html(self) -> None:
        """Write the scene as it stands as a page that needs nothing else."""
        path = write_html(self.scene, free_name(self.folder, "skinmap", ".html"))
        self.say(f"wrote {path.name}")
