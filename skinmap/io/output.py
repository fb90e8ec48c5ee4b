"""Writing results so that a failed run leaves nothing half written."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skinmap.errors import OutputError, SkinError
from skinmap.interrupts import undisturbed

# What a disk or its file system says to a writer, and no reader ever hears.
REFUSED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)


@contextmanager
def staged_folder(out: Path) -> Iterator[Path]:
    """A fresh folder whose files move into `out` when all went well, and vanish when not.

    Files of the same name in `out` are replaced one by one; other files there stay.

    Parameters
    ----------
    out : Path
        The folder, made where it does not exist.

    Yields
    ------
    Path
        The fresh folder.

    Raises
    ------
    OutputError
        `out` cannot be made or written to (found before any work is done), or became full or
        read-only since.

    Examples
    --------
    >>> from pathlib import Path
    >>> from skinmap.io import staged_folder
    >>> with staged_folder(Path("maps")) as stage:
    ...     _ = (stage / "torso.txt").write_text("flat")
    >>> [file.name for file in Path("maps").iterdir()]
    ['torso.txt']
    """
    made, stage = not out.exists(), None
    try:
        # Undisturbed, or nobody would know what to take away.
        with undisturbed(), refused(f"to the folder {str(out)!r}"):
            out.mkdir(parents=True, exist_ok=True)
            stage = Path(tempfile.mkdtemp(prefix=".skinmap-", dir=out))
        with refusals(out, stage):
            yield stage
        with refusals(out, out), undisturbed():
            for path in sorted(path for path in stage.rglob("*") if path.is_file()):
                target = out / path.relative_to(stage)
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(path, target)
    finally:
        with undisturbed(), suppress(OSError):
            if stage is not None:
                shutil.rmtree(stage, ignore_errors=True)
            if made and out.is_dir() and not any(out.iterdir()):
                out.rmdir()


def check_folder(out: Path) -> None:
    """Refuse a folder that cannot be made or written to; leaves nothing behind.

    Raises
    ------
    OutputError
    """
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    with refused(f"to the folder {str(out)!r}"), undisturbed():
        tempfile.TemporaryDirectory(prefix=".skinmap-", dir=there).cleanup()


@contextmanager
def staged_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name when all went well.

    Parameters
    ----------
    path : Path
        The file to write.

    Yields
    ------
    Path
        Where to write it, with the same ending.

    Raises
    ------
    OutputError
        The folder of `path` does not exist, cannot be written to, or became full.

    Examples
    --------
    >>> from pathlib import Path
    >>> from skinmap.io import staged_file
    >>> with staged_file(Path("words.txt")) as stage:
    ...     print(stage.write_text("all of it"), Path("words.txt").exists())
    9 False
    >>> Path("words.txt").read_text()
    'all of it'
    """
    stage = None
    try:
        with undisturbed():  # or nobody would know what to take away
            stage = _temporary(path)
        if path.is_dir():
            raise OutputError(f"cannot write {str(path)!r}: it is a folder")
        with refusals(path, stage):
            yield stage
        with refusals(path, path):
            stage.chmod(0o666 & ~_umask())
            os.replace(stage, path)
    finally:
        with undisturbed(), suppress(OSError):  # in a folder that became read-only it stays
            if stage is not None:
                stage.unlink(missing_ok=True)


@contextmanager
def refused(what: str) -> Iterator[None]:
    """What the system refuses to write, as a line that names it."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write {what}: {error.strerror}") from None


def _temporary(path: Path) -> Path:
    """An empty file beside `path`, of the same ending."""
    with refused(repr(str(path))):
        handle, name = tempfile.mkstemp(prefix=".skinmap-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    return Path(name)


@contextmanager
def refusals(named: Path, place: Path) -> Iterator[None]:
    """An error of the system while writing at a place, as a line that names the result."""
    try:
        yield
    except OutputError as error:  # of a writer that was given the temporary name
        why = error.__cause__ or error.__context__
        if str(place) in str(error) and place != named and isinstance(why, OSError):
            reason = why.strerror or str(why)
            raise OutputError(f"cannot write {str(named)!r}: {reason}") from why
        raise
    except SkinError:
        raise
    except OSError as error:
        at = str(error.filename or error.filename2 or "")
        ours = at.startswith(str(place)) or str(error.filename2 or "").startswith(str(place))
        if error.errno in REFUSED or (ours and isinstance(error, PermissionError)):
            reason = error.strerror or type(error).__name__
            raise OutputError(f"cannot write {str(named)!r}: {reason}") from error
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
