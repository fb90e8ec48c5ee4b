"""Movies of a scene: mp4 where ffmpeg is to be had, else gif."""

from __future__ import annotations

import os
import shutil
import subprocess
import warnings
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import InvalidArrayError, OutputError, SkinWarning
from skinmap.io.output import refusals, staged_file

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
    movie = MovieWriter(path, fps)
    try:
        for picture in frames:
            movie.add(picture)
        written = movie.close()
    except BaseException:
        movie.drop()
        raise
    if written is None:
        raise InvalidArrayError("a movie needs at least one picture")
    return written


class MovieWriter:
    """A movie that grows picture by picture, for windows that do not know how long it will be.

    It is made far from its place and moved there when all went well: whoever kills it finds nothing
    half made in the folder.

    Parameters
    ----------
    path : path-like
        Ends in .mp4 or .gif; without ffmpeg an .mp4 becomes a .gif.
    fps : float
        Pictures a second.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to; told before any work.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        path = Path(path)
        self._program = find_ffmpeg()
        self.path = path
        if self._program is None and path.suffix != ".gif":
            self.path = path.with_suffix(".gif")
            warnings.warn(
                f"no ffmpeg: writing {self.path.name} instead; for .mp4: "
                "pip install 'skinmap[movies]'",
                SkinWarning, stacklevel=2,
            )  # fmt: skip
        self.fps = fps
        self.count = 0
        self._size: tuple[int, int] | None = None
        self._ffmpeg: subprocess.Popen[bytes] | None = None
        self._pictures: list[Picture] = []  # of a gif, which is written at the end
        if self.path.is_dir():
            raise OutputError(f"cannot write {str(self.path)!r}: it is a folder")
        if not os.access(self.path.parent, os.W_OK | os.X_OK):
            why = "no permission" if self.path.parent.is_dir() else "no such folder"
            raise OutputError(f"cannot write {str(self.path)!r}: {why}")
        self._folder = TemporaryDirectory(prefix="skinmap-", ignore_cleanup_errors=True)
        self._stage = Path(self._folder.name) / f"movie{self.path.suffix}"

    def add(self, picture: Picture) -> None:
        """Append a picture (h, w, 3); one of another size than the first is left out."""
        height, width = picture.shape[:2]
        size = (height - height % 2, width - width % 2)
        if self._size is None:
            self._size = size
            if self.path.suffix != ".gif":
                self._ffmpeg = self._started(*size)
        if size != self._size:
            return
        cut = np.ascontiguousarray(picture[: size[0], : size[1]])
        if self._ffmpeg is None:
            self._pictures.append(cut)
        elif self._ffmpeg.stdin is not None:
            with suppress(OSError):  # it has ended: its exit code says so when the movie does
                self._ffmpeg.stdin.write(cut.tobytes())
        self.count += 1

    def close(self) -> Path | None:
        """Finish the file; None, and no file, where no picture came."""
        try:
            if self.count == 0:
                return None
            with refusals(self.path, self._stage):
                self._finish()
            with staged_file(self.path) as copy:
                shutil.copyfile(self._stage, copy)
            return self.path
        finally:
            self.drop()

    def drop(self) -> None:
        """Give up what was made so far; after `close` nothing happens."""
        if self._ffmpeg is not None:
            self._ffmpeg.kill()
            self._ffmpeg.communicate()
        self._folder.cleanup()

    def _started(self, height: int, width: int) -> subprocess.Popen[bytes]:
        source = f"-y -v error -f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {self.fps:g} -i -"
        words: list[str | Path] = [str(self._program), *source.split(), *CODEC.split(), self._stage]
        quiet = subprocess.DEVNULL
        return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet)

    def _finish(self) -> None:
        if self._ffmpeg is None:
            from PIL import Image

            first, *more = (Image.fromarray(one) for one in self._pictures)
            each = round(1000.0 / self.fps)
            first.save(self._stage, save_all=True, append_images=more, duration=each, loop=0)
            return
        with suppress(OSError):
            self._ffmpeg.communicate()
        if self._ffmpeg.wait() != 0:
            raise OutputError(
                f"cannot write {str(self.path)!r}: ffmpeg left no whole movie, for want of room in "
                f"{str(self._stage.parent.parent)!r} perhaps"
            )


def find_ffmpeg() -> str | None:
    """The program of the extra `movies`, else the system's; None where there is neither."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")
