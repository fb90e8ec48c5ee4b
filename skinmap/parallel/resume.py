"""Results that survive an interruption: a file with a line for each finished task.

A line stands in the file as soon as its task is done, with a checksum, so that a killed run loses
at most the tasks under way. Lines are found by the content of their task: another setting, seed or
skin has another key, and nothing of another sweep is ever taken for ours.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import tempfile
import warnings
import zlib
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any

from skinmap.errors import DataFormatError, OutputError, SkinWarning
from skinmap.parallel.plain import pack, unpack

FORMAT = 1
MARK = "skinmap_resume"
# What decides about the bits of a result beside the task's content.
LIBRARIES = ("skinmap", "numpy", "scipy", "scikit-learn", "libigl")
KEY = 32  # letters
LONGEST_HEAD = 4096
_UNREADABLE = (ValueError, LookupError, TypeError, RecursionError, MemoryError, zlib.error)


class ResumeFile:
    """Finished results on disk, found by the key of their task.

    Parameters
    ----------
    path : Path
        Made where it does not exist.
    sweep : str
        What the results are of ("evaluate kaspar").

    Raises
    ------
    DataFormatError
        Another kind of file, or the results of another sweep.
    OutputError
        A file that cannot be written, or that another run has open.

    Notes
    -----
    Results of another version of Skinmap or of the libraries below it are put aside
    (`NAME.old`) with a warning: their bits may differ. Damaged lines are computed again, with a
    warning too.
    """

    def __init__(self, path: Path, sweep: str) -> None:
        self.path, self.sweep = path, sweep
        self.recalled = 0
        self._places: dict[str, tuple[int, int]] = {}
        self._file = self._open()

    def __enter__(self) -> ResumeFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def recall(self, key: str) -> Any:
        """The result under a key; KeyError where there is none or it cannot be read."""
        start, length = self._places[key]
        self._file.seek(start)
        try:
            result = unpack(self._file.read(length))
        except _UNREADABLE:
            del self._places[key]
            self._warn_damaged(1)
            raise KeyError(key) from None
        self.recalled += 1
        return result

    def keep(self, key: str, result: Any) -> None:
        """Write a result down, at once.

        Raises
        ------
        OutputError
            The disk is full or gone.
        """
        data = pack(result).encode()
        line = f"{key} {zlib.crc32(data):08x} ".encode()
        try:
            start = self._file.seek(0, os.SEEK_END)
            self._file.write(line + data + b"\n")
            self._file.flush()
        except OSError as error:
            raise OutputError(f"cannot write {str(self.path)!r}: {error.strerror}") from None
        self._places[key] = (start + len(line), len(data))

    def close(self) -> None:
        """Let others have the file."""
        if not self._file.closed:
            self._file.close()

    def _open(self) -> io.BufferedRandom:
        try:
            if not self.path.exists() or self.path.stat().st_size == 0:
                self._start()
            file = _locked(self.path)
        except OutputError:
            raise
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise OutputError(f"cannot write {str(self.path)!r}: {reason}") from None
        try:
            older = self._check_head(file.readline(LONGEST_HEAD))
            if older is None:
                self._index(file)
                return file
        except BaseException:
            file.close()
            raise
        file.close()
        return self._anew(older)

    def _anew(self, older: str) -> io.BufferedRandom:
        aside = self.path.with_name(self.path.name + ".old")
        warnings.warn(
            f"{str(self.path)!r} holds results of {older}, which may differ: all is computed "
            f"anew, and that file is now {aside.name!r}",
            SkinWarning,
            stacklevel=2,
        )
        os.replace(self.path, aside)
        self._start()
        file = _locked(self.path)
        file.readline()
        return file

    def _start(self) -> None:
        """A file with its head alone, whole or not at all."""
        head = {MARK: FORMAT, "sweep": self.sweep, "versions": _versions()}
        handle, name = tempfile.mkstemp(prefix=".skinmap-", dir=self.path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(json.dumps(head).encode() + b"\n")
        os.replace(name, self.path)

    def _check_head(self, line: bytes) -> str | None:
        """Which other version the file is of, or None; refuses other files."""
        try:
            head = json.loads(line)
            form, sweep, versions = head[MARK], str(head["sweep"]), dict(head["versions"])
        except _UNREADABLE:
            raise DataFormatError(
                "no file of results to resume (its first line says nothing of them); name "
                "another file, or a new one",
                self.path,
            ) from None
        if sweep != self.sweep:
            raise DataFormatError(
                f"holds the results of {sweep[:100]!r}, this is {self.sweep!r}; name another file",
                self.path,
            )
        if form != FORMAT:
            return f"another format ({form!r}, this is {FORMAT})"
        for name, ours in _versions().items():
            if versions.get(name) != ours:
                return f"{name} {versions.get(name)} (this is {ours})"
        return None

    def _index(self, file: io.BufferedRandom) -> None:
        """Where each whole line lies; what a killed run left half written is cut off."""
        damaged, start = 0, file.tell()
        for line in file:
            if not line.endswith(b"\n"):
                file.truncate(start)
                break
            found = _read_line(line)
            if found is None:
                damaged += 1
            else:
                key, at = found
                self._places[key] = (start + at, len(line) - at - 1)
            start += len(line)
        if damaged:
            self._warn_damaged(damaged)

    def _warn_damaged(self, count: int) -> None:
        warnings.warn(
            f"{str(self.path)!r}: {count} damaged results are computed again",
            SkinWarning,
            stacklevel=3,
        )


def _versions() -> dict[str, str]:
    return {name: version(name) for name in LIBRARIES}


def _read_line(line: bytes) -> tuple[str, int] | None:
    """Key of a line and where its data starts; None where the checksum does not fit."""
    key, check, data = (line[:KEY], line[KEY + 1 : KEY + 9], line[KEY + 10 : -1])
    if len(line) < KEY + 11 or check != f"{zlib.crc32(data):08x}".encode():
        return None
    return key.decode("ascii", "replace"), KEY + 10


def _locked(path: Path) -> io.BufferedRandom:
    """The file, open for reading and writing by this run alone."""
    file = path.open("r+b")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise OutputError(f"{str(path)!r} is in use by another run") from None
    except BaseException:
        file.close()
        raise
    return file
