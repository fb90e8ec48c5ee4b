"""`skinmap view`: touches on the body in a window, a picture, a movie, a file or a browser."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinmap.live.moment import Moment
from viewer.export.gltf import write_gltf
from viewer.export.html_page import write_html
from viewer.export.movie import MOVIE_FPS, write_movie
from viewer.export.thinned_moments import Excerpt
from viewer.filming import Best, movie_frames, show
from viewer.look import Look, new_scene
from viewer.playing.player import Player
from viewer.session import Session

STILL_SIZE = (1600, 1100)
LIVE_SIZE = (1024, 768)
MOVIE_SECONDS = 7.0  # of the simulator, which has no end


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


def write_files(session: Session, look: Look, wanted: Wanted) -> dict[str, Any]:
    """Write pictures and files of what the source shows; no screen is needed."""
    best = Best(session, look)
    files: list[Path] = []
    moments = best.watch(session.moments(_length(session, wanted), start=_start(wanted)))
    excerpt = Excerpt()
    if wanted.html is not None and wanted.at is None:
        moments = excerpt.watch(moments)
    if wanted.movie is not None:
        scene = new_scene(session, look, size=LIVE_SIZE, off_screen=True)
        if scene.framing.mode == "auto" and not look.follow:
            scene.framing.mode = "still"  # touches come and go all around: it would never rest
        files.append(write_movie(wanted.movie, movie_frames(scene, moments), MOVIE_FPS))
        scene.close()
    elif wanted.at is not None:
        best.moment = next(moments, None)
    else:
        for _ in moments:
            pass
    if wanted.screenshot or wanted.gltf or wanted.html:
        files += _stills(session, look, wanted, best.moment, excerpt)
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


def _stills(
    session: Session, look: Look, wanted: Wanted, moment: Moment | None, excerpt: Excerpt
) -> list[Path]:
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
        played, now = excerpt.around(moment)
        files.append(write_html(scene, wanted.html, moments=played, now=now))
    scene.close()
    return files


def _length(session: Session, wanted: Wanted) -> float | None:
    if wanted.seconds is None and wanted.movie is not None and session.simulated:
        return MOVIE_SECONDS
    return wanted.seconds


def _start(wanted: Wanted) -> float:
    return 0.0 if wanted.at is None else wanted.at


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
