"""Files that keys ask for: saved views, pictures, movies, exports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from viewer.export.gltf import write_gltf
from viewer.export.html_page import write_html
from viewer.export.movie import MOVIE_FPS, MovieWriter
from viewer.interaction.pointing import Pointing
from viewer.interaction.saving import apply_view, free_name, view_of
from viewer.interaction.view_file import load_view, save_view
from viewer.scene import Scene


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
        self._movie: MovieWriter | None = None

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
        if self._movie is None:
            self._movie = MovieWriter(free_name(self.folder, "skinmap", ".mp4"), MOVIE_FPS)
            self.say("movie begins; o ends it")
        else:
            self.end_movie()

    def end_movie(self) -> None:
        """Finish the movie's file, if one is being made."""
        if self._movie is not None:
            movie, self._movie = self._movie, None
            path = movie.close()
            self.say(f"wrote {path.name}" if path is not None else "no picture: no movie")

    @property
    def recording(self) -> MovieWriter | None:
        """The movie that is being made."""
        return self._movie

    def export_gltf(self) -> None:
        """Write the scene as it stands for other 3D programs."""
        path = write_gltf(self.scene, free_name(self.folder, "skinmap", ".glb"))
        self.say(f"wrote {path.name}")

    def export_html(self) -> None:
        """Write the scene as it stands as a page that needs nothing else."""
        path = write_html(self.scene, free_name(self.folder, "skinmap", ".html"))
        self.say(f"wrote {path.name}")
