"""`skinmap view`: touches on the body in a window, a picture, a movie, a file or a browser."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import SkinMismatchError
from skinmap.geometry.rigid import transform_directions
from skinmap.live.moment import Moment
from viewer.drawing.body import check_links
from viewer.drawing.camera import front_view
from viewer.drawing.flat_panel import LazyMaps
from viewer.export.gltf import write_gltf
from viewer.export.html_page import write_html
from viewer.export.movie import write_movie
from viewer.interaction.saving import apply_view
from viewer.interaction.selection import Selection
from viewer.interaction.view_file import SavedView
from viewer.layers import Layers
from viewer.playing.player import Player
from viewer.scene import Scene
from viewer.session import Session

FPS = 25.0
STILL_SIZE = (1600, 1100)
LIVE_SIZE = (1024, 768)
MOVIE_SECONDS = 12.0  # of the simulator, which has no end


@dataclass(frozen=True, slots=True)
class Look:
    """How the scene is shown.

    Attributes
    ----------
    layer, style : str or None
        None for what the view says, or the scene's own.
    angles : mapping of str to float
        Joint angles [rad].
    links : {"all", "skin", "none"}
        What is drawn of the body.
    view : SavedView or None
    """

    layer: str | None = None
    style: str | None = None
    angles: dict[str, float] | None = None
    links: str = "all"
    view: SavedView | None = None


@dataclass(frozen=True, slots=True)
class Wanted:
    """Files to write; without any a window opens.

    Attributes
    ----------
    screenshot, movie, gltf, html : Path or None
    at : float or None
        Time of the picture from the source's beginning [s]; the moment that shows most by default.
    seconds : float or None
        How long the source is watched.
    """

    screenshot: Path | None = None
    movie: Path | None = None
    gltf: Path | None = None
    html: Path | None = None
    at: float | None = None
    seconds: float | None = None

    @property
    def files(self) -> list[Path]:
        """What is asked for."""
        every = (self.screenshot, self.movie, self.gltf, self.html)
        return [path for path in every if path is not None]


def new_scene(session: Session, look: Look, *, size: tuple[int, int], off_screen: bool) -> Scene:
    """The scene that a user asked for.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A layer that does not exist, or a view of another robot.
    """
    if look.view is not None and look.view.robot != session.robot.name:
        raise SkinMismatchError(
            f"the view was saved of {look.view.robot!r}, this robot is {session.robot.name!r}"
        )
    data = Layers(session.skins, covariances=session.covariances, healths=session.healths)
    scene = Scene(
        session.robot,
        {part: skin.mesh for part, skin in session.skins.items()},
        LazyMaps(session.skins),
        data=data,
        angles=look.angles or None,
        links=_links(session, look),
        window_size=size,
        off_screen=off_screen,
    )
    if look.view is not None:
        selection = Selection()
        apply_view(scene, look.view, selection)
        for part, taxels in selection.items():
            scene.select(part, taxels)
    if look.layer is not None:
        scene.set_layer(look.layer)
    if look.style is not None:
        scene.set_style(look.style)
    return scene


def _links(session: Session, look: Look) -> tuple[str, ...] | None:
    """Links to draw; None for all."""
    if look.links == "all":
        return None
    return check_links(session.robot, "skin", session.parts) if look.links == "skin" else ()


def write_files(session: Session, look: Look, wanted: Wanted) -> dict[str, Any]:
    """Write pictures and files of what the source shows; no screen is needed."""
    best = Best(session, look)
    files: list[Path] = []
    moments = best.watch(session.moments(_length(session, wanted), start=_start(wanted)))
    if wanted.movie is not None:
        scene = new_scene(session, look, size=LIVE_SIZE, off_screen=True)
        files.append(write_movie(wanted.movie, movie_frames(scene, moments), FPS))
        scene.close()
    elif wanted.at is not None:
        best.moment = next(moments, None)
    else:
        for _ in moments:
            pass
    if wanted.screenshot or wanted.gltf or wanted.html:
        files += _stills(session, look, wanted, best.moment)
    touches = () if best.moment is None else best.moment.touches
    return {
        "robot": session.robot.name,
        "parts": list(session.parts),
        "source": session.source,
        "time": math.nan if best.moment is None else best.moment.time,
        "touches": [
            {"part": one.part, "label": one.label, "confidence": one.confidence} for one in touches
        ],
        "files": files,
    }


def _stills(session: Session, look: Look, wanted: Wanted, moment: Moment | None) -> list[Path]:
    scene = new_scene(session, look, size=STILL_SIZE, off_screen=True)
    if moment is not None:
        show(scene, moment)
    scene.update(step=360.0)
    files = []
    if wanted.screenshot is not None:
        files.append(scene.screenshot(wanted.screenshot))
    if wanted.gltf is not None:
        files.append(write_gltf(scene, wanted.gltf))
    if wanted.html is not None:
        files.append(write_html(scene, wanted.html))
    scene.close()
    return files


def _length(session: Session, wanted: Wanted) -> float | None:
    if wanted.seconds is None and wanted.movie is not None and session.simulated:
        return MOVIE_SECONDS
    return wanted.seconds


def _start(wanted: Wanted) -> float:
    return 0.0 if wanted.at is None else wanted.at


class Best:
    """Keeps the moment that shows most: large, surely named touches that are seen from the front.

    Parameters
    ----------
    session : Session
    look : Look
    """

    def __init__(self, session: Session, look: Look) -> None:
        robot = session.robot
        poses = robot.body.poses({**robot.pose, **(look.angles or {})})
        self._poses = {part: poses[robot.part(part).link] for part in session.parts}
        normals = [
            transform_directions(self._poses[part], skin.skin.normals)
            for part, skin in session.skins.items()
        ]
        self._front = front_view(np.concatenate(normals)).direction
        self.moment: Moment | None = None
        self.worth = -math.inf

    def watch(self, moments: Iterable[Moment]) -> Iterator[Moment]:
        """The same moments, looked at as they pass."""
        for moment in moments:
            worth = self._worth(moment)
            if worth > self.worth:
                self.moment, self.worth = moment, worth
            yield moment

    def _worth(self, moment: Moment) -> float:
        total = 0.0
        for touch in moment.touches:
            # What has no name yet has just begun: a later moment says more.
            sure = touch.confidence if math.isfinite(touch.confidence) else -1.0
            seen = 1.0
            if touch.normal is not None:
                normal = transform_directions(self._poses[touch.part], touch.normal[None])[0]
                seen = float(np.clip(0.5 + normal @ self._front, 0.2, 1.0))
            total += sure * seen * math.sqrt(min(len(touch.taxels), 16))
        return total


def show(scene: Scene, moment: Moment) -> None:
    """Show a moment, with the flat map of the part that was touched last."""
    scene.show_moment(moment)
    if scene.panel is not None:
        for touch in reversed(moment.touches):
            if touch.part in scene.panel.flat_maps:
                scene.show_flat_map(touch.part)
                return


def movie_frames(scene: Scene, moments: Iterable[Moment]) -> Iterator[NDArray[Any]]:
    """Pictures (h, w, 3) of moments, 25 for each of their seconds."""
    due = -math.inf
    for moment in moments:
        if moment.time < due - 1e-6:
            continue
        due = (moment.time if math.isinf(due) else due) + 1.0 / FPS
        if moment.time > due:
            due = moment.time + 1.0 / FPS
        show(scene, moment)
        yield scene.frame()


def open_window(
    session: Session, look: Look, *, seconds: float | None, view_file: Path | None
) -> dict[str, Any]:
    """Play the source in a window until it is closed."""
    from viewer.window import Window, run

    loop = session.live()
    try:
        scene = new_scene(session, look, size=LIVE_SIZE, off_screen=False)
        player = Player(loop)
        player.speed = session.speed
        window = Window(scene, player, view_file=view_file)
        window.open()
        if session.model is None:
            session.train(loop, window.controls.say)
        drawn = run(window, seconds=math.inf if seconds is None else seconds)
    finally:
        loop.close()
    return {"robot": session.robot.name, "parts": list(session.parts), "drawn": drawn}


def serve_web(
    session: Session, look: Look, *, host: str, port: int, seconds: float | None
) -> dict[str, Any]:
    """Serve the scene to a browser until it is interrupted, or for so many seconds.

    Raises
    ------
    UnreachableError
        The port is in use, or the address is not this machine's.
    """
    import click

    from viewer.web.server import serve

    loop = session.live()
    with Player(loop) as player:
        player.speed = session.speed
        with serve(
            session.robot,
            session.skins,
            player,
            host=host,
            port=port,
            layers=Layers(session.skins, covariances=session.covariances, healths=session.healths),
            layer=look.layer or "pressure",
            style=look.style or "surface",
            angles=look.angles or None,
            links=_links(session, look),
        ) as server:
            click.echo(server.url, err=True)
            if session.model is None:
                session.train(loop, lambda line: click.echo(line, err=True))
            with contextlib.suppress(KeyboardInterrupt):
                _wait(player, math.inf if seconds is None else seconds)
            address = server.url
    if player.error is not None:
        raise player.error
    return {"robot": session.robot.name, "parts": list(session.parts), "address": address}


def _wait(player: Player, seconds: float) -> None:
    """Until a source fails, or for so long; one that ended is still looked at."""
    end = time.monotonic() + seconds
    while player.error is None and (left := end - time.monotonic()) > 0:
        player.wait(player.number, min(left, 1.0))
