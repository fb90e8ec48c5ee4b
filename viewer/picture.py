"""Look at a robot's skin in one call: in a window, or as a picture, a movie, a page or a body."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.errors import UnknownNameError
from skinmap.io.robots.manifest import load_robot
from skinmap.live.loop import TouchLoop
from skinmap.live.moment import Moment
from skinmap.report.touch_figures import with_contacts
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.view_files import Wanted, write_files
from viewer.view_options import Look, Session, new_scene
from viewer.window import SIZE, play

# What is written for a suffix.
SUFFIXES = {
    ".png": "screenshot",
    ".jpg": "screenshot",
    ".svg": "screenshot",
    ".pdf": "screenshot",
    ".mp4": "movie",
    ".gif": "movie",
    ".glb": "screenshot",
    ".html": "html",
}


@dataclass(eq=False)
class _Given(Session):
    """A session whose moments are given instead of read from a source."""

    given: Iterable[Moment] = ()

    def moments(
        self, seconds: float | None, *, start: float = 0.0, name: bool = True
    ) -> Iterator[Moment]:
        first = math.nan
        for moment in self.given:
            first = moment.time if math.isnan(first) else first
            if seconds is not None and moment.time - first > seconds:
                return
            yield moment


def show(
    robot: Robot | str | Path,
    moments: Moment | Iterable[Moment] | None = None,
    *,
    parts: Sequence[str] | None = None,
    seconds: float | None = None,
    path: str | Path | None = None,
) -> Any:
    """Show a robot's skin, its pressures and named touches.

    Parameters
    ----------
    robot : Robot, str or Path
        As `skinmap.load_robot` takes it.
    moments : Moment, TouchLoop or iterable of Moment, optional
        What is felt, pressures (n,) of 0 to 255 counts for each part; nothing by default. A
        picture shows the one that tells most. Contacts of a moment made by hand are found.
    parts : sequence of str, optional
        Parts to show; those of the moments by default, else all.
    seconds : float, optional
        Stop after these [s].
    path : str or Path, optional
        File to write instead of opening a window: a picture (.png, .jpg, .svg, .pdf), a movie
        (.mp4, .gif), a page for a browser (.html) or a body with its skin (.glb).

    Returns
    -------
    Path, widget or None
        The file; in a notebook, of a robot or of a loop's moments, a widget, which also takes a
        skin, a flat map, a recording's file or a source in place of a robot
        (`viewer.notebook.show`, with more options); None after a window was closed.

    Raises
    ------
    UnknownNameError
        A robot or part that does not exist, or a suffix that nothing is written as.
    SkinMismatchError
        Moments of another skin.
    MissingLibraryError
        No OpenGL to draw with.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> skinmap.show(robot, parts=["torso"], path="torso.png").name
    'torso.png'
    """
    alone = not isinstance(robot, Robot | str | Path)  # a skin, a flat map, a source
    if path is None and (alone or (_fits_cell(moments) and in_notebook())):
        from viewer.notebook import show as show_in_cell

        return show_in_cell(robot if moments is None else moments, parts=parts)
    kind = None if path is None else _kind(Path(path))
    loaded = robot if isinstance(robot, Robot) else load_robot(robot)
    felt, known = _felt(moments)
    wanted = tuple(parts) if parts is not None else known or loaded.parts
    made = moments.skins if isinstance(moments, TouchLoop) else {}
    skins = {part: made.get(part) or PreparedSkin(loaded.skin(part)) for part in wanted}
    if felt is not None and not isinstance(moments, TouchLoop):
        looked = (with_contacts(one, skins) for one in felt)
        felt = list(looked) if isinstance(felt, Sequence) else looked  # a list is read again
    session = _Given(loaded, wanted, skins=skins, given=felt or [_at_rest(skins)])
    if path is None or kind is None:
        scene = new_scene(session, Look(), size=SIZE, off_screen=False)
        play(scene, session.given, seconds=math.inf if seconds is None else seconds)
        return None
    file: dict[str, Any] = {kind: Path(path)}
    write_files(session, Look(), Wanted(**file, seconds=seconds))
    return Path(path)


def _fits_cell(moments: object) -> bool:
    """Whether what is felt can be followed in a cell: nothing, or what a live loop finds."""
    return moments is None or isinstance(moments, TouchLoop)


def in_notebook() -> bool:
    """Whether this runs in a notebook of Jupyter, VS Code or marimo, and not in a terminal."""
    marimo = sys.modules.get("marimo")
    if marimo is not None and marimo.running_in_notebook():
        return True
    shell = sys.modules.get("IPython")
    found = None if shell is None else shell.get_ipython()
    return found is not None and getattr(found, "kernel", None) is not None


def _kind(path: Path) -> str:
    """The field of `Wanted` for a file."""
    if path.suffix.lower() not in SUFFIXES:
        raise UnknownNameError(
            "format to show a skin in, for files ending in", path.suffix, SUFFIXES
        )
    return SUFFIXES[path.suffix.lower()]


def _felt(
    moments: Moment | Iterable[Moment] | None,
) -> tuple[Iterable[Moment] | None, tuple[str, ...]]:
    """The moments one by one, and the parts that they tell of where that is known before."""
    if isinstance(moments, Moment):
        return [moments], tuple(moments.pressures)
    if isinstance(moments, TouchLoop):
        return moments, tuple(moments.skins)
    if isinstance(moments, Sequence):
        return moments, tuple(moments[0].pressures) if moments else ()
    return moments, ()


def _at_rest(skins: Mapping[str, PreparedSkin]) -> Moment:
    return Moment(0.0, {part: np.zeros(len(skin)) for part, skin in skins.items()})
