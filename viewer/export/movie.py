"""Movies of a scene: mp4 where ffmpeg is to be had, else gif."""

from __future__ import annotations

import io
import os
import shutil
import struct
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import InvalidArrayError, OutputError
from skinmap.io.output import refusals, staged_file

Picture = NDArray[np.uint8]
MOVIE_FPS = 25.0  # of movies of a scene: every other sample at 50 Hz
BOX = struct.Struct(">I4s")  # length and kind: what an .mp4 file is made of
QUALITY = "26"  # x264's constant rate factor: labels stay sharp, 6 s take about 1 MB


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
    """
    path = Path(path)
    if path.suffix == ".mp4" and not has_ffmpeg():
        path = path.with_suffix(".gif")
    with moved_file(path) as stage:
        if _write(stage, frames, fps) == 0:
            raise InvalidArrayError("a movie needs at least one picture")
    return path


@contextmanager
def moved_file(path: Path) -> Iterator[Path]:
    """A temporary path far from `path`, which is filled from there when all went well.

    A movie takes long to make: whoever kills it finds nothing half made in the folder.

    Raises
    ------
    OutputError
        The folder of `path` does not exist or cannot be written to; told before any work.
    """
    if path.is_dir():
        raise OutputError(f"cannot write {str(path)!r}: it is a folder")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        why = "no permission" if path.parent.is_dir() else "no such folder"
        raise OutputError(f"cannot write {str(path)!r}: {why}")
    with TemporaryDirectory(prefix="skinmap-", ignore_cleanup_errors=True) as folder:
        stage = Path(folder) / f"movie{path.suffix}"
        unfinished = OutputError(
            f"cannot write {str(path)!r}: ffmpeg left no whole movie, for want of room in "
            f"{str(Path(folder).parent)!r} perhaps"
        )
        try:
            with refusals(path, stage):
                yield stage
        except OSError as error:
            if "FFMPEG COMMAND" in str(error):  # it ended while pictures were written
                raise unfinished from None
            raise
        if path.suffix == ".mp4" and not is_whole(stage):  # nobody looks at its exit code
            raise unfinished
        with staged_file(path) as copy:
            shutil.copyfile(stage, copy)


class MovieWriter:
    """A movie that grows picture by picture, for windows that do not know how long it will be.

    Parameters
    ----------
    path : path-like
        Ends in .mp4 or .gif; without ffmpeg an .mp4 becomes a .gif.
    fps : float
        Pictures a second.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        path = Path(path)
        self.path = path if has_ffmpeg() else path.with_suffix(".gif")
        self.fps = fps
        self.count = 0
        self._stack = ExitStack()
        self._stage = self._stack.enter_context(moved_file(self.path))
        self._writer = self._stack.enter_context(_opened(self._stage, fps))
        self._size: tuple[int, int] | None = None

    def add(self, picture: Picture) -> None:
        """Append a picture (h, w, 3); one of another size than the first is left out."""
        height, width = picture.shape[:2]
        size = (height - height % 2, width - width % 2)
        if self._size is None:
            self._size = size
        if size != self._size:
            return
        self._writer.append_data(picture[: size[0], : size[1]])
        self.count += 1

    def close(self) -> Path | None:
        """Finish the file; None, and no file, where no picture came."""
        if self.count == 0:
            with suppress(InvalidArrayError), self._stack:
                raise InvalidArrayError("a movie needs at least one picture")
            return None
        self._stack.close()
        return self.path


def is_whole(path: Path) -> bool:
    """Whether the boxes of an .mp4 file end where it ends, and one of them is its index."""
    kinds, place, size = set[bytes](), 0, path.stat().st_size if path.exists() else 0
    with path.open("rb") if size else io.BytesIO() as file:
        while place < size:
            file.seek(place)
            length, kind = BOX.unpack(file.read(BOX.size).ljust(BOX.size))
            if length == 1:
                length = int.from_bytes(file.read(8), "big")
            kinds.add(kind)
            place += max(length, BOX.size)
    return place == size and b"moov" in kinds


def has_ffmpeg() -> bool:
    """Whether imageio finds an ffmpeg: its own wheel brings one on common machines."""
    try:
        import imageio_ffmpeg

        return bool(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return False


def _write(path: Path, frames: Iterable[Picture], fps: float) -> int:
    count = 0
    with _opened(path, fps) as writer:
        for picture in frames:
            height, width = picture.shape[:2]
            writer.append_data(picture[: height - height % 2, : width - width % 2])
            count += 1
    return count


@contextmanager
def _opened(path: Path, fps: float) -> Iterator[Any]:
    """The writer of imageio for a path, closed once: ffmpeg ends, whatever happens."""
    import imageio

    options: dict[str, Any] = {"duration": 1000.0 / fps, "loop": 0}
    if path.suffix != ".gif":
        options = {
            "fps": fps,
            "codec": "libx264",
            "pixelformat": "yuv420p",  # plays in every browser; needs even sizes
            "macro_block_size": 2,
            "output_params": ["-crf", QUALITY, "-preset", "veryfast", "-movflags", "+faststart"],
            "ffmpeg_log_level": "error",
        }
    open_writer: Any = imageio.get_writer
    # A gif is kept in memory to its end anyway, and written here: imageio would try it thrice.
    buffer = io.BytesIO()
    where = {"uri": buffer, "format": "GIF"} if path.suffix == ".gif" else {"uri": str(path)}
    with closing(open_writer(**where, **options)) as writer:
        yield writer
    if path.suffix == ".gif":
        path.write_bytes(buffer.getvalue())
