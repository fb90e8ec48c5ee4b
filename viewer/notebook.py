"""Skins, flat maps, recordings and live sources in a notebook cell: `skinmap.show(...)`.

The page of `viewer.web` stands in a frame of its own in the cell, with its scene in it; what is
live comes over the notebook's own connection, so that no port is opened. By anywidget: Jupyter,
VS Code and marimo.
"""

from __future__ import annotations

import asyncio
import base64
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, MissingLibraryError, SkinError, UnknownNameError
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.triangles import TriangleMesh
from skinmap.live.loop import TouchLoop
from skinmap.live.moment import Moment
from skinmap.live.sources.source import Source
from skinmap.skin.joints import Joint
from skinmap.skin.robot import Part, Robot
from skinmap.skin.skin import Skin
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.export.html_page import page
from viewer.layers import Layers
from viewer.playing.player import Player, stepwise
from viewer.playing.recent_moments import Excerpt
from viewer.view_options import Look, Session, new_scene
from viewer.web.hub import Hub
from viewer.web.sample import pack_reel
from viewer.web.scene_data import WebScene, make_scene

HEIGHT = 560  # of the cell's frame [px]
STILL = (1000, 640)  # of the picture that stays in a saved notebook [px]
WAITING = 64  # letters of a page that wait to be read; more are forgotten


def show(
    thing: Any,
    *,
    robot: Robot | str = "icub",
    parts: Iterable[str] | None = None,
    model: str | Path | None = None,
    layer: str | None = None,
    height: int = HEIGHT,
) -> Any:
    """Show something in a notebook cell.

    Parameters
    ----------
    thing : Skin, FlatMap, Robot, str, path, Source or TouchLoop
        A skin or a flat map alone; a robot at rest; a recording's file, which is played in the
        cell; or what is live: "sim", "lsl:NAME", "zmq:HOST:PORT", a source or a loop on one.
    robot : Robot or str
        Whose touches a recording or a source has.
    parts : iterable of str, optional
        Only these; all of a robot, or of what is played, by default.
    model : path, optional
        Names the touches; the one that comes with Skinmap by default.
    layer : str, optional
        What the skin shows first.
    height : int
        Of the cell's frame [px].

    Returns
    -------
    anywidget.AnyWidget
        With a still picture, for where nothing is connected: a notebook that was saved.

    Raises
    ------
    MissingLibraryError
        anywidget is not installed.
    """
    import skinmap

    if isinstance(thing, Skin):
        return _resting(Shown(*alone(PreparedSkin(thing)), layer or "pressure", height))
    if isinstance(thing, FlatMap):
        own = PreparedSkin.of(thing.mesh, thing)
        return _resting(Shown(*alone(own), layer or "distortion", height))
    if isinstance(thing, Robot):
        skins = {part: PreparedSkin(thing.skin(part)) for part in parts or thing.parts}
        return _resting(Shown(thing, skins, layer or "pressure", height))
    loaded = robot if isinstance(robot, Robot) else skinmap.load_robot(robot)
    if isinstance(thing, TouchLoop):
        return _live(Shown(thing.robot, thing.skins, layer or "pressure", height), thing)
    names = tuple(parts) if parts is not None else None
    chosen = None if model is None else Path(model)
    if isinstance(thing, str | Path):
        session = Session(loaded, names or loaded.parts, source=str(thing), model=chosen)
        if names is None:
            session.parts = _parts_of(session)
        session.prepare()
        shown = Shown(loaded, session.skins, layer or "pressure", height)
        if Path(thing).exists():
            return _played(shown, session)
        return _live(shown, session.live())
    if isinstance(thing, Source):
        skins = {part: PreparedSkin(loaded.skin(part)) for part in names or thing.info.parts}
        loop = TouchLoop(loaded, stepwise(thing), skins=skins, parts=tuple(skins))
        return _live(Shown(loaded, skins, layer or "pressure", height), loop)
    raise UnknownNameError("thing to show of type", type(thing).__name__, THINGS)


THINGS = ("Skin", "FlatMap", "Robot", "file", "source's name", "Source", "TouchLoop")


@dataclass(frozen=True, slots=True)
class Shown:
    """A robot with the parts of it that are shown, the layer and the frame's height [px]."""

    robot: Robot
    skins: Mapping[str, PreparedSkin]
    layer: str
    height: int

    @property
    def at_rest(self) -> Moment:
        """A moment without a touch."""
        return Moment(0.0, {part: np.zeros(len(skin)) for part, skin in self.skins.items()})

    def played(self, moments: Sequence[Moment], now: int) -> Any:
        """A frame that plays moments, with a picture of one of them for where nothing runs."""
        scene = make_scene(self.robot, self.skins)
        reel = pack_reel(scene, Layers(self.skins), moments, now=now, layer=self.layer)
        return self.cell(scene, reel, moments[now])

    def cell(self, scene: WebScene, reel: bytes | None, moment: Moment) -> Any:
        """A frame with a page, and a picture of a moment."""
        content = page(scene.packed, reel, self.robot.name)
        return widget(content, self.still(moment), self.height)

    def still(self, moment: Moment) -> bytes | None:
        """A picture (PNG) of a moment; None where there is no library to draw with."""
        session = Session(self.robot, tuple(self.skins), skins=dict(self.skins))
        try:
            scene = new_scene(session, Look(layer=self.layer), size=STILL, off_screen=True)
        except MissingLibraryError:
            return None
        scene.follow(moment)
        with tempfile.TemporaryDirectory(prefix="skinmap-") as folder:
            content = scene.screenshot(Path(folder) / "still.png").read_bytes()
        scene.close()
        return content


class Bodiless:
    """The body of a skin that is alone: its link, without a mesh."""

    def __init__(self, link: str) -> None:
        self.links = (link,)
        self.visible_links: tuple[str, ...] = ()
        self.joints: dict[str, tuple[float, float]] = {}
        self.sliding_joints: frozenset[str] = frozenset()
        self.tree: dict[str, Joint] = {}

    def poses(self, angles: Mapping[str, float]) -> dict[str, FloatArray]:
        """The link stands in the origin."""
        return {link: np.eye(4) for link in self.links}

    def mesh(self, link: str) -> TriangleMesh:
        """Raise: there is none."""
        raise UnknownNameError("link with a mesh", link, ())


def alone(skin: PreparedSkin) -> tuple[Robot, dict[str, PreparedSkin]]:
    """A skin without a robot, as a robot of which nothing else is known."""

    def read() -> Any:
        raise SkinError("a skin that is alone has no table")

    own = skin.skin
    robot = Robot(own.part, Bodiless(own.link), {own.part: Part(own.part, own.link, read)})
    robot._skins[own.part] = own
    return robot, {own.part: skin}


def _parts_of(session: Session) -> tuple[str, ...]:
    """The parts of the robot that the source has."""
    with closing(session.open(hurry=True)) as source:
        found = tuple(part for part in source.info.parts if part in session.robot.parts)
    return found or session.parts


def _resting(shown: Shown) -> Any:
    """A frame of what is at rest."""
    return shown.played([shown.at_rest], 0)


def _played(shown: Shown, session: Session) -> Any:
    """A frame that plays a recording, whose moments stand in it."""
    excerpt, best = Excerpt(), shown.at_rest
    for moment in excerpt.watch(session.moments(None)):
        best = max(best, moment, key=lambda one: sum(len(touch.taxels) for touch in one.touches))
    moments, now = excerpt.around(best if excerpt.moments else None)
    if not moments or now is None:
        raise InvalidArrayError(f"{session.source}: no sample to show")
    return shown.played(moments, now)


def _live(shown: Shown, loop: TouchLoop) -> Any:
    """A frame of a source, whose samples come over the notebook's connection."""
    try:
        events = asyncio.get_running_loop()
    except RuntimeError:
        raise InvalidArrayError(
            "a live source is shown in a notebook, where an event loop runs; "
            "elsewhere: skinmap view --web"
        ) from None
    scene, player = make_scene(shown.robot, shown.skins), Player(loop)
    first = {"layer": shown.layer, "style": "surface", "view": None, "size": None}
    hub = Hub(scene, player, Layers(shown.skins), first, loop.totals)
    made = shown.cell(scene, None, shown.at_rest)
    Wires(made, hub, events)
    player.start()
    return made


class Wire:
    """One frame, in place of a WebSocket's connection.

    Parameters
    ----------
    widget : anywidget.AnyWidget
    name : str
        Of the frame: one widget may be shown in several cells.
    """

    def __init__(self, widget: Any, name: str) -> None:
        self._widget, self._name = widget, name
        self.letters: asyncio.Queue[str] = asyncio.Queue(WAITING)

    async def send(self, message: str | bytes) -> None:
        """Send text or bytes to the frame."""
        text = isinstance(message, str)
        about = {"to": self._name, "text": message if text else None}
        self._widget.send(about, None if text else [message])
        await asyncio.sleep(0)  # others have their turn, the notebook's own messages too

    def __aiter__(self) -> Wire:
        return self

    async def __anext__(self) -> str:
        return await self.letters.get()


class Wires:
    """All frames of one widget, and the hub that tells them of a player.

    Parameters
    ----------
    widget : anywidget.AnyWidget
    hub : Hub
    events : asyncio.AbstractEventLoop
        The notebook's.
    """

    def __init__(self, widget: Any, hub: Hub, events: asyncio.AbstractEventLoop) -> None:
        self._widget, self._hub, self._events = widget, hub, events
        self._wires: dict[str, Wire] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._watch = events.create_task(hub.watch())
        widget.on_msg(self._take)
        widget.end = self.end

    def _take(self, _: Any, content: Mapping[str, Any], __: Any) -> None:
        """A frame opened, closed, or asks for something."""
        name, text = str(content.get("from")), content.get("text")
        if content.get("open"):
            self._wires[name] = Wire(self._widget, name)
            talk = self._hub.talk(self._wires[name])  # type: ignore[arg-type]
            self._tasks[name] = self._events.create_task(talk)
        elif content.get("close") and name in self._tasks:
            self._tasks.pop(name).cancel()
            self._wires.pop(name, None)
        elif name in self._wires and isinstance(text, str) and len(text) <= 4096:
            letters = self._wires[name].letters
            if not letters.full():
                letters.put_nowait(text)

    def end(self) -> None:
        """End the source: nothing more comes."""
        for task in (self._watch, *self._tasks.values()):
            task.cancel()
        self._hub.player.close()


def widget(content: str, still: bytes | None, height: int) -> Any:
    """A widget with the page in a frame and a still picture."""
    return _kind()(content=content, height=height, still=still)


@cache
def _kind() -> Any:
    """The widget's class, made where anywidget is."""
    try:
        import anywidget
        import traitlets
    except ImportError:
        raise MissingLibraryError(
            "showing in a notebook needs anywidget: pip install 'skinmap[notebook]'"
        ) from None

    class SkinmapWidget(anywidget.AnyWidget):
        """The page in a cell of a notebook."""

        _esm = resources.files("viewer.web").joinpath("page", "cell.mjs").read_text("utf-8")
        content = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int(HEIGHT).tag(sync=True)

        def __init__(self, *, still: bytes | None, **about: Any) -> None:
            super().__init__(**about)
            self._still = still
            self.end = lambda: None

        def _repr_mimebundle_(self, **about: Any) -> Any:
            """The widget, and a picture for where there is none of it."""
            made = super()._repr_mimebundle_(**about)
            if made is None or self._still is None:
                return made
            data, more = made if isinstance(made, tuple) else (made, {})
            picture = base64.b64encode(self._still).decode()
            return {**data, "image/png": picture}, more

    return SkinmapWidget
