"""Look at a robot's skin in one call: in a window, a cell of a notebook, or as a file.

In a cell the page of `viewer.web` stands in a frame of its own, with scene and moments in it: no
port is opened, and the notebook shows plain HTML, as Jupyter, VS Code and marimo do.
"""

from __future__ import annotations

import html
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.commands.options import STREAMS
from skinmap.errors import InvalidArrayError, MissingLibraryError, SkinError, UnknownNameError
from skinmap.flat.flat_map import FlatMap
from skinmap.io.recordings.touch_files import recorded_robot
from skinmap.io.robots.manifest import builtin_named, builtin_robots, load_robot
from skinmap.io.robots.urdf import Link, UrdfBody
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.open_source import FILES, open_source, sources
from skinmap.report.touch_figures import with_contacts
from skinmap.skin.robot import Part, Robot
from skinmap.skin.skin import Skin
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.export.html_page import page
from viewer.layers import Layers
from viewer.playing.recent_moments import Excerpt
from viewer.view_files import Wanted, write_files
from viewer.view_options import Look, Session, new_scene
from viewer.web.sample import pack_reel
from viewer.web.scene_data import WebScene
from viewer.window import SIZE, play

# What is written for a suffix.
SUFFIXES = {
    **dict.fromkeys((".png", ".jpg", ".svg", ".pdf", ".glb"), "screenshot"),
    **dict.fromkeys((".mp4", ".gif"), "movie"),
    ".html": "html",
}
HEIGHT = 560  # of the cell's frame [px]
STILL = (1000, 640)  # of the picture for where no page can stand [px]
FRAME = (
    '<iframe title="skin" sandbox="allow-scripts allow-downloads" srcdoc="{}" style="width: 100%; '
    'height: {}px; border: 1px solid #dde1e6; border-radius: 6px"></iframe>'
)
THINGS = ("Skin", "FlatMap", "Robot", "file", "source's name")


@dataclass(eq=False)
class _Given(Session):
    """A session whose moments are given instead of read from a source."""

    given: Iterable[Moment] = ()

    def moments(self, seconds: float | None, *, start: float = 0.0) -> Iterator[Moment]:
        first = math.nan
        for moment in self.given:
            first = moment.time if math.isnan(first) else first
            if seconds is not None and moment.time - first > seconds:
                return
            yield replace(moment, latency=math.nan)  # no file or cell is live


def show(
    thing: Robot | Skin | FlatMap | str | Path,
    moments: Moment | Iterable[Moment] | None = None,
    *,
    robot: Robot | str | Path | None = None,
    parts: Sequence[str] | None = None,
    seconds: float | None = None,
    path: str | Path | None = None,
) -> Any:
    """Show a robot's skin, its pressures and named touches.

    Parameters
    ----------
    thing : Robot, Skin, FlatMap, str or Path
        A robot, its name or manifest, a skin or a flat map alone; or, without moments, a
        recording's file or a source ("sim", "lsl:NAME", "zmq:HOST:PORT"), which is played.
    moments : Moment, TouchLoop or iterable of Moment, optional
        What is felt, pressures (n,) of 0 to 255 counts for each part; nothing by default. A
        picture shows the one that tells most. Contacts of a moment made by hand are found.
    robot : Robot, str or Path, optional
        Of a recording or a source: whose touches it has; by default the robot that it names, else
        the iCub.
    parts : sequence of str, optional
        Parts to show; those of the moments by default, else all.
    seconds : float, optional
        Stop after these [s].
    path : str or Path, optional
        File to write instead of opening a window: a picture (.png, .jpg, .svg, .pdf), a movie
        (.mp4, .gif), a page for a browser (.html) or a body with its skin (.glb).

    Returns
    -------
    Path, Cell or None
        The file; what stands in a cell, in a notebook without moments, and of a skin or a flat map
        (`viewer.picture.show_in_cell`); None after a window was closed.

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
    alone = not isinstance(thing, Robot | str | Path)
    if alone and moments is not None:
        raise InvalidArrayError("moments are of a robot: give it instead of a skin or a flat map")
    if path is None and (alone or (moments is None and in_notebook())):
        return show_in_cell(thing, robot=robot, parts=parts, seconds=seconds)
    kind = None if path is None else _kind(Path(path))
    if moments is None or alone:
        session, look = _session(thing, robot, parts)
    else:
        session, look = _felt_session(thing, moments, parts), Look()
    if path is None or kind is None:
        scene = new_scene(session, look, size=SIZE, off_screen=False)
        felt = session.given if isinstance(session, _Given) else session.live()
        play(scene, felt, seconds=math.inf if seconds is None else seconds)
        return None
    file: dict[str, Any] = {kind: Path(path)}
    write_files(session, look, Wanted(**file, seconds=seconds))
    return Path(path)


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


def _felt_session(
    robot: Any, moments: Moment | Iterable[Moment], parts: Sequence[str] | None
) -> _Given:
    """A robot and its moments."""
    loaded = robot if isinstance(robot, Robot) else load_robot(robot)
    felt, known = _felt(moments)
    wanted = tuple(parts) if parts is not None else known or loaded.parts
    made = moments.skins if isinstance(moments, TouchLoop) else {}
    skins = {part: made.get(part) or PreparedSkin(loaded.skin(part)) for part in wanted}
    if not isinstance(moments, TouchLoop):
        looked = (with_contacts(one, skins) for one in felt)
        felt = list(looked) if isinstance(felt, Sequence) else looked  # a list is read again
    return _Given(loaded, wanted, skins=skins, given=felt or [at_rest(skins)])


def _felt(
    moments: Moment | Iterable[Moment],
) -> tuple[Iterable[Moment], tuple[str, ...]]:
    """The moments one by one, and the parts that they tell of where that is known before."""
    if isinstance(moments, Moment):
        return [moments], tuple(moments.pressures)
    if isinstance(moments, TouchLoop):
        return moments, tuple(moments.skins)
    if isinstance(moments, Sequence):
        return moments, tuple(moments[0].pressures) if moments else ()
    return moments, ()


@dataclass(frozen=True, slots=True)
class Cell:
    """What stands in a cell.

    Attributes
    ----------
    content : str
        The page.
    still : bytes or None
        A picture (PNG) for where no page can stand; None where there is no library to draw with.
    """

    content: str
    still: bytes | None

    def _repr_html_(self) -> str:
        return FRAME.format(html.escape(self.content), HEIGHT)

    def _repr_png_(self) -> bytes | None:
        return self.still


def show_in_cell(
    thing: Any,
    *,
    robot: Robot | str | Path | None = None,
    parts: Iterable[str] | None = None,
    seconds: float | None = None,
) -> Cell:
    """Show something in a notebook cell.

    Parameters
    ----------
    thing : Skin, FlatMap, Robot, str or path
        A skin or a flat map alone; a robot, its name or its manifest, at rest; a recording's file,
        which is played in the cell; or a source ("sim", "lsl:NAME", "zmq:HOST:PORT"), whose next
        seconds are.
    robot : Robot, str or Path, optional
        Whose touches a recording or a source has; by default the robot that it names, else the
        iCub.
    parts : iterable of str, optional
        Only these; all of a robot, or of what is played, by default.
    seconds : float, optional
        How long a recording or a source is watched [s].

    Returns
    -------
    Cell
        Put it at the end of a cell.
    """
    session, look = _session(thing, robot, parts)
    return _played(session, look.layer or "pressure", seconds)


def _session(
    thing: Any, robot: Robot | str | Path | None, parts: Iterable[str] | None
) -> tuple[Session, Look]:
    """Something at rest, or a recording or a source to be played, and how it is shown."""
    look = Look()
    if isinstance(thing, str | Path) and _is_source(thing):
        loaded = robot if isinstance(robot, Robot) else load_robot(robot or _said(thing) or "icub")
        session = Session(loaded, tuple(parts or loaded.parts), source=str(thing))
        if parts is None:
            session.parts = _parts_of(session)
        session.prepare()
        return session, look
    if isinstance(thing, Skin):
        loaded, skins = alone(PreparedSkin(thing))
    elif isinstance(thing, FlatMap):
        (loaded, skins), look = alone(PreparedSkin.of(thing.mesh, thing)), Look(layer="distortion")
    elif isinstance(thing, Robot | str | Path):
        loaded = thing if isinstance(thing, Robot) else load_robot(thing)
        skins = {part: PreparedSkin(loaded.skin(part)) for part in parts or loaded.parts}
    else:
        raise UnknownNameError("thing to show of type", type(thing).__name__, THINGS)
    return _Given(loaded, tuple(skins), skins=skins, given=[at_rest(skins)]), look


def _is_source(thing: str | Path) -> bool:
    """Whether a word is a recording or a source, rather than a robot or its manifest."""
    path, suffix = Path(thing), Path(thing).suffix.lower()
    if str(thing) in builtin_robots() or suffix == ".toml":
        return False
    return path.exists() or suffix in FILES or str(thing).partition(":")[0] in sources.names()


def _said(thing: str | Path) -> str | None:
    """The robot that a recording or a stream names."""
    if str(thing).partition(":")[0] not in STREAMS:
        return recorded_robot(Path(thing)) if Path(thing).exists() else None
    with closing(open_source(thing)) as source:
        return builtin_named(source.info.robot)


def _still(
    robot: Robot, skins: Mapping[str, PreparedSkin], layer: str, moment: Moment
) -> bytes | None:
    session = Session(robot, tuple(skins), skins=dict(skins))
    try:
        scene = new_scene(session, Look(layer=layer), size=STILL, off_screen=True)
    except MissingLibraryError:
        return None
    scene.follow(moment)
    with tempfile.TemporaryDirectory(prefix="skinmap-") as folder:
        content = scene.screenshot(Path(folder) / "still.png").read_bytes()
    scene.close()
    return content


class Bodiless(UrdfBody):
    """The body of a skin that is alone: its link, without a mesh."""

    def __init__(self, link: str) -> None:
        self._links, self._tree, self._moved = {link: Link(())}, {}, {}


def alone(skin: PreparedSkin) -> tuple[Robot, dict[str, PreparedSkin]]:
    """A skin without a robot, as a robot of which nothing else is known."""

    def read() -> Any:
        raise SkinError("a skin that is alone has no table")

    own = skin.skin
    robot = Robot(own.part, Bodiless(own.link), {own.part: Part(own.part, own.link, read)})
    robot._skins[own.part] = own
    return robot, {own.part: skin}


def at_rest(skins: Mapping[str, PreparedSkin]) -> Moment:
    """A moment without a touch."""
    return Moment(0.0, {part: np.zeros(len(skin)) for part, skin in skins.items()})


def _parts_of(session: Session) -> tuple[str, ...]:
    """The parts of the robot that the source has."""
    with closing(session.open(hurry=True)) as source:
        found = tuple(part for part in source.info.parts if part in session.robot.parts)
    return found or session.parts


def _played(session: Session, layer: str, seconds: float | None) -> Cell:
    """A page that plays what a session sends, with a picture of what tells most."""
    excerpt, best = Excerpt(), at_rest(session.skins)
    for moment in excerpt.watch(session.moments(seconds)):
        best = max(best, moment, key=lambda one: sum(len(touch.taxels) for touch in one.touches))
    moments, now = excerpt.around(best if excerpt.moments else None)
    if not moments or now is None:
        raise InvalidArrayError(f"{session.source}: no sample to show")
    robot, skins = session.robot, session.skins
    scene = WebScene(robot, skins)
    reel = pack_reel(scene, Layers(skins), moments, now=now, layer=layer)
    return Cell(page(scene.packed, reel, robot.name), _still(robot, skins, layer, moments[now]))
