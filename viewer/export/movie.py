"""Movies of a scene: mp4 where ffmpeg is to be had, else gif."""

from __future__ import annotations

import os
import shutil
import subprocess
import warnings
from collections.abc import Iterable
from contextlib import suppress
from itertools import chain
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
