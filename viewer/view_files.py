"""Files of what a source shows: the picture of one moment, movies, pages; no screen is needed.

Movies of a scene: mp4 where ffmpeg is to be had, else gif.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import warnings
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import InvalidArrayError, OutputError, SkinWarning
from skinmap.geometry.rigid import transform_directions
from skinmap.io.output import refusals, staged_file
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.sources.source import Seekable, SourceEnded
from skinmap.touch.contacts.skin_geometry import ACTIVE
from viewer.drawing.frame.camera import AZIMUTHS, View, front_view
from viewer.export.html_page import write_gltf, write_html
from viewer.playing.recent_moments import Excerpt
from viewer.results import ShownTouch, ViewFiles
from viewer.scene import Scene
from viewer.view_options import Look, Session, new_scene

Picture = NDArray[np.uint8]
MOVIE_FPS = 25.0  # of movies of a scene: every other sample at 50 Hz
# yuv420p plays in every browser and needs even sizes; x264's rate 26 keeps labels sharp, and 6 s
# take about 1 MB.
CODEC = "-an -c:v libx264 -pix_fmt yuv420p -crf 26 -preset veryfast -movflags +faststart"


def write_movie(path: str | Path, frames: Iterable[Picture], fps: float) -> Path:
    """Write pictures as a movie that appears when it is complete.

    Parameters
    ----------
    path : path-like
        Ends in .mp4 or .gif.
    frames : iterable of (h, w, 3) uint8
        Pictures of one size; a last odd row or column is cut off.
    fps : float
        Pictures a second.

    Returns
    -------
    Path
        What was really written: without ffmpeg an .mp4 becomes a .gif beside it.

    Raises
    ------
    InvalidArrayError
        No picture at all.
    OutputError
        The folder does not exist or cannot be written to.

    Examples
    --------
    >>> from viewer import write_movie
    >>> write_movie("grey.gif", np.full((2, 48, 64, 3), 128, np.uint8), 25.0).name
    'grey.gif'
    """
    path, program = Path(path), find_ffmpeg()
    if program is None and path.suffix != ".gif":
        path = path.with_suffix(".gif")
        warnings.warn(
            f"no ffmpeg: writing {path.name} instead; for .mp4: pip install 'skinmap[movies]'",
            SkinWarning,
            stacklevel=2,
        )
    if path.is_dir():
        raise OutputError(f"cannot write {str(path)!r}: it is a folder")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        why = "no permission" if path.parent.is_dir() else "no such folder"
        raise OutputError(f"cannot write {str(path)!r}: {why}")
    even = (one[: len(one) // 2 * 2, : one.shape[1] // 2 * 2] for one in frames)
    first = next(even, None)
    if first is None:
        raise InvalidArrayError("a movie needs at least one picture")
    pictures = chain([first], even)
    # Far from its place, and moved there when all went well: whoever kills it finds nothing half
    # made in the folder.
    with TemporaryDirectory(prefix="skinmap-", ignore_cleanup_errors=True) as folder:
        stage = Path(folder) / f"movie{path.suffix}"
        if path.suffix == ".gif":
            from PIL import Image

            still, *more = map(Image.fromarray, pictures)
            with refusals(path, stage):
                each = round(1000.0 / fps)
                still.save(stage, save_all=True, append_images=more, duration=each, loop=0)
        elif not _encode(str(program), pictures, first.shape, fps, stage):
            raise OutputError(
                f"cannot write {str(path)!r}: ffmpeg left no whole movie, for want of room in "
                f"{str(stage.parent.parent)!r} perhaps"
            )
        with staged_file(path) as copy:
            shutil.copyfile(stage, copy)
    return path


def _encode(
    program: str, pictures: Iterable[Picture], shape: tuple[int, ...], fps: float, stage: Path
) -> bool:
    """Write pictures of a shape (h, w, 3) by ffmpeg; whether ffmpeg succeeded."""
    height, width = shape[:2]
    source = f"-y -v error -f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {fps:g} -i -"
    words: list[str | Path] = [program, *source.split(), *CODEC.split(), stage]
    quiet = subprocess.DEVNULL
    ffmpeg = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet)
    try:
        for picture in pictures:
            with suppress(OSError):  # it has ended: the exit code shows it
                ffmpeg.stdin.write(picture.tobytes())  # type: ignore[union-attr]
        with suppress(OSError):
            ffmpeg.communicate()
        return ffmpeg.wait() == 0
    finally:
        ffmpeg.kill()
        ffmpeg.communicate()


def find_ffmpeg() -> str | None:
    """The program of the extra `movies`, else the system's; None where there is neither."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")


STILL_SIZE = (1600, 1100)
MOVIE_SIZE = (1024, 768)
NEAR = 0.1  # a moment so near a time is of it [s]
RISE = 12.0  # of the views that a moment is judged from [deg]
# Of the simulator, which has no end: a picture sees some four touches of a part begin and grow.
MOVIE_SECONDS, STILL_SECONDS = 7.0, 5.0
STRETCH = 10.0  # of a long recording that names are looked for in, for a picture [s]
MOST = 16  # taxels that a touch is judged by at most
CALM = 1.6  # how far the camera of a movie turns between two pictures [deg]: 40 a second


@dataclass(frozen=True, slots=True)
class Wanted:
    """Files to write; without any a window opens.

    Attributes
    ----------
    screenshot, movie, html : Path or None
    at : float or None
        Time of the picture from the source's beginning [s]; the moment that shows most by default.
    seconds : float or None
        How long the source is watched.
    """

    screenshot: Path | None = None
    movie: Path | None = None
    html: Path | None = None
    at: float | None = None
    seconds: float | None = None

    @property
    def files(self) -> list[Path]:
        """What is asked for."""
        every = (self.screenshot, self.movie, self.html)
        return [path for path in every if path is not None]

    @property
    def still(self) -> bool:
        """Whether one picture is asked for, and nothing that moves."""
        return self.movie is None and self.html is None


def write_files(session: Session, look: Look, wanted: Wanted) -> ViewFiles:
    """Write pictures and files of what the source shows; no screen is needed."""
    if (look.layer or "").startswith("touched") and wanted.at is None and wanted.still:
        # A sum over all of it: no moment belongs to it.
        return shown_files(session, None, _stills(session, look, wanted, None, Excerpt()))
    best = Best(session, look)
    files: list[Path] = []
    start, seconds = wanted.at or 0.0, _length(session, wanted)
    if wanted.at is None and wanted.movie is None and wanted.html is None and seconds is None:
        start, seconds = fullest(session)
    moments = best.watch(session.moments(seconds, start=start))
    excerpt = Excerpt()
    if wanted.html is not None and wanted.at is None:
        moments = excerpt.watch(moments)
    if wanted.movie is not None:
        scene = new_scene(session, look, size=MOVIE_SIZE, off_screen=True)
        if look.view is None and scene.framing.mode == "auto":
            scene.framing.mode = "still"  # touches come and go all around: it would never rest
        frames = movie_frames(scene, moments, session.speed)
        files.append(write_movie(wanted.movie, frames, MOVIE_FPS))
        scene.close()
    elif wanted.at is not None:
        best.moment = _at(session, moments, wanted.at)
    else:
        for _ in moments:
            pass
    if wanted.screenshot or wanted.html:
        files += _stills(session, look, wanted, best.moment, excerpt)
    return shown_files(session, best.moment, files)


def still_moment(session: Session, look: Look, at: float | None) -> Moment | None:
    """The moment at a time of a source [s], or that which shows most; None where nothing came."""
    start, seconds = fullest(session) if at is None else (at, None)
    moments = session.moments(seconds, start=start)
    if at is not None:
        return _at(session, moments, at)
    best = Best(session, look)
    for _ in best.watch(moments):
        pass
    return best.moment


def _at(session: Session, moments: Iterator[Moment], at: float) -> Moment | None:
    """The first of the moments, with a warning where a gap lies between it and its time [s]."""
    moment = next(moments, None)
    if moment is not None and session.repeats:
        passed = moment.time - session.origin
        if abs(passed - at) > NEAR:
            text = f"no sample at {at:g} s: the one at {passed:.2f} s is shown"
            warnings.warn(text, SkinWarning, stacklevel=2)
    return moment


def shown_files(session: Session, moment: Moment | None, files: list[Path]) -> ViewFiles:
    """What is printed of files that show a moment."""
    return ViewFiles(
        robot=session.robot.name,
        parts=list(session.parts),
        source=session.source,
        time=None if moment is None else moment.time - session.origin,
        touches=shown_touches(moment),
        files=files,
    )


def shown_touches(moment: Moment | None) -> list[ShownTouch]:
    """What is printed of the touches of a moment."""
    touches = () if moment is None else moment.touches
    return [
        ShownTouch(part=one.part, label=one.label, confidence=one.confidence) for one in touches
    ]


def _stills(
    session: Session, look: Look, wanted: Wanted, moment: Moment | None, excerpt: Excerpt
) -> list[Path]:
    scene = new_scene(session, look, size=STILL_SIZE, off_screen=True)
    if moment is not None:
        scene.follow(moment)
    elif scene.layer.name.startswith("touched"):
        scene.show_sums(session.touched())
    scene.update(step=360.0)
    files = []
    if wanted.screenshot is not None:
        solid = wanted.screenshot.suffix.lower() == ".glb"
        files.append((write_gltf if solid else Scene.screenshot)(scene, wanted.screenshot))
    if wanted.html is not None:
        played, now = excerpt.around(moment)
        files.append(write_html(scene, wanted.html, moments=played, now=now, size=look.size))
    scene.close()
    return files


def _length(session: Session, wanted: Wanted) -> float | None:
    pace = 1.0 if wanted.movie is None else session.speed  # seconds of a movie are its own
    if wanted.seconds is not None or not session.simulated:
        return wanted.seconds and wanted.seconds * pace
    if wanted.movie is not None:
        return MOVIE_SECONDS * pace
    return STILL_SECONDS if wanted.html is None else None  # a page plays what was watched


def fullest(session: Session) -> tuple[float, float | None]:
    """Begin and length of the stretch of a recording in which most is touched [s].

    Names take a hundred times as long as finding where to look for a picture. All of what is
    shorter than two such stretches, of raw values and of what is no recording.
    """
    if not session.repeats:  # nor is what is live opened twice
        return 0.0, None
    source = session.open(hurry=True)
    try:
        info = source.info
        columns = [info.part_slice(part) for part in session.parts if part in info.parts]
        if not isinstance(source, Seekable) or source.duration < 2.0 * STRETCH:
            return 0.0, None
        if info.kind == "raw" or not columns:
            return 0.0, None
        times, worth = [], []
        with suppress(SourceEnded):
            while (block := source.read(1.0)) is not None:
                active = [(block.values[:, own] > ACTIVE).sum(axis=1) for own in columns]
                times.append(block.times)
                worth.append(np.sqrt(np.minimum(active, MOST)).sum(axis=0))
    finally:
        source.close()
    time, sums = np.concatenate(times), np.concatenate([[0.0], np.concatenate(worth).cumsum()])
    ends = np.searchsorted(time, time + STRETCH)
    gained = sums[ends] - sums[:-1]
    most = np.flatnonzero(gained >= gained.max() - 1e-6)  # its middle: what is touched is inside
    return float(time[most[len(most) // 2]] - time[0]), STRETCH


class Best:
    """Keeps the moment that shows most: large, surely named touches that one view can show."""

    def __init__(self, session: Session, look: Look) -> None:
        robot = session.robot
        poses = robot.body.poses({**robot.pose, **(look.angles or {})})
        self._poses = {part: poses[robot.part(part).link] for part in session.skins}
        normals = [
            transform_directions(self._poses[part], skin.skin.normals)
            for part, skin in session.skins.items()
        ]
        front = front_view(np.concatenate(normals)).azimuth
        self._views = np.stack([View(front + float(a), RISE).direction for a in AZIMUTHS])
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
        total = np.zeros(len(self._views))
        for touch in moment.touches:
            # What has no name yet has just begun: a later moment says more.
            sure = touch.confidence if math.isfinite(touch.confidence) else -1.0
            seen = np.ones(len(self._views))
            if touch.normal is not None:
                normal = transform_directions(self._poses[touch.part], touch.normal[None])[0]
                seen = np.clip(0.5 + self._views @ normal, 0.2, 1.0)
            total += sure * seen * math.sqrt(min(len(touch.taxels), MOST))
        return float(total.max())


def movie_frames(scene: Scene, moments: Iterable[Moment], speed: float = 1.0) -> Iterator[Picture]:
    """Pictures (h, w, 3) of moments, 25 a second; one stands as long as no sample comes.

    A turning camera is calm.
    """
    due, step = -math.inf, speed / MOVIE_FPS
    for moment in moments:
        if moment.time < due - 1e-6:
            continue
        due = moment.time if math.isinf(due) else due
        while due + step < moment.time + 1e-6:
            yield scene.frame(CALM)
            due += step
        scene.follow(moment)
        yield scene.frame(CALM)
        due += step
