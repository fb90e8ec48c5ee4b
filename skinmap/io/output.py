"""Writing results so that a failed run leaves nothing half written."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skinmap.errors import OutputError


@contextmanager
def staged_folder(out: Path) -> Iterator[Path]:
    """A fresh folder whose files move into `out` when all went well, and vanish when not.

    Files of the same name in `out` are replaced one by one; other files there stay.

    Raises
    ------
    OutputError
        `out` cannot be made or written to (found before any work is done).
    """
    made = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=".skinmap-", dir=out))
    except OSError as error:
        raise OutputError(f"cannot write to the folder {str(out)!r}: {error.strerror}") from None
    try:
        yield stage
        for path in sorted(path for path in stage.rglob("*") if path.is_file()):
            target = out / path.relative_to(stage)
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, target)
    except BaseException:
        shutil.rmtree(stage, ignore_errors=True)
        if made and not any(out.iterdir()):
            out.rmdir()
        raise
    shutil.rmtree(stage, ignore_errors=True)


def check_folder(out: Path) -> None:
    """Refuse a folder that cannot be made or written to; leaves nothing behind.

    Raises
    ------
    OutputError
    """
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    try:
        with tempfile.TemporaryDirectory(prefix=".skinmap-", dir=there):
            pass
    except OSError as error:
        raise OutputError(f"cannot write to the folder {str(out)!r}: {error.strerror}") from None


@contextmanager
def staged_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name when all went well.

    Raises
    ------
    OutputError
        The folder of `path` does not exist or cannot be written to.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=".skinmap-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise OutputError(f"cannot write {str(path)!r}: {error.strerror}") from None
    os.close(handle)
    stage = Path(name)
    try:
        if path.is_dir():
            raise OutputError(f"cannot write {str(path)!r}: it is a folder")
        yield stage
        stage.chmod(0o666 & ~_umask())
        os.replace(stage, path)
    finally:
        stage.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
