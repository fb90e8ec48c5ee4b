"""Errors and warnings: one root, and each leaf is also the builtin a caller would expect."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

# What numpy and zipfile raise for archives that are damaged: in their directory, their compressed
# data, their method of compression or the headers of their arrays.
DAMAGED_ARCHIVE: tuple[type[Exception], ...] = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    OSError,
    EOFError,
    OverflowError,  # a shape of numbers that no integer of the machine holds
    RuntimeError,  # a flipped bit says that a member is encrypted, or compressed in an unknown way
    SyntaxError,
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    MemoryError,  # a header that asks for more than there is
)


class SkinError(Exception):
    """Root of every error that Skinmap raises on purpose."""


class InvalidArrayError(SkinError, ValueError):
    """An array has the wrong shape, type or content."""


class InvalidMeshError(SkinError, ValueError):
    """Triangles that are not a usable surface."""


class FlatteningError(SkinError, ArithmeticError):
    """A surface that cannot be laid flat, and why."""


class NotFittedError(SkinError, ValueError, AttributeError):
    """A model was asked before it was trained."""


class SkinMismatchError(SkinError, ValueError):
    """Data or a model that belong to another skin."""


class OutputError(SkinError, OSError):
    """A result that cannot be written where it was asked for."""


class MissingLibraryError(SkinError, ImportError):
    """A system library or an optional package that is not installed."""


class UnreachableError(SkinError, ConnectionError):
    """A machine or service that does not answer."""


class VersionMismatchError(SkinError, RuntimeError):
    """Another version than this process has, where results would differ."""


class MessageError(SkinError, ValueError):
    """A message of a live stream that does not follow its layout."""


class MissingFileError(SkinError, FileNotFoundError):
    """A file that does not exist."""

    def __init__(self, path: Path | str, expected: str) -> None:
        super().__init__(f"no file {str(path)!r}; expected {expected}")
        self.path, self.expected = Path(path), expected

    def __reduce__(self) -> tuple[Any, ...]:  # errors come back from other processes
        return type(self), (self.path, self.expected)


class UnknownNameError(SkinError, LookupError):
    """A name that nothing has, with the names that exist.

    Parameters
    ----------
    kind : str
        What was looked for, in the singular ("part", "flattening method").
    name : str
        What came.
    known : iterable of str
        What exists.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.kind, self.name, self.known = kind, name, tuple(known)
        exists = ", ".join(self.known) if self.known else "none"
        super().__init__(f"no {kind} {name!r}; there is: {exists}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.kind, self.name, self.known)


class DataFormatError(SkinError, ValueError):
    """A file that does not follow its format.

    Parameters
    ----------
    message : str
        What came and what was expected.
    path : path-like
        The file.
    line : int, optional
        Line of the file, counted from 1.
    """

    def __init__(self, message: str, path: Path | str, line: int | None = None) -> None:
        self.message, self.path, self.line = message, Path(path), line
        where = f"{path}:{line}" if line is not None else str(path)
        super().__init__(f"{where}: {message}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.message, self.path, self.line)


class ForbiddenPathError(SkinError, PermissionError):
    """A file that a manifest may not read, and what would allow it."""


class BrokenPluginError(SkinError, TypeError):
    """A plug-in that does not keep the contract, and which promise it breaks."""


class ImpossibleBudgetError(SkinError, ValueError):
    """A limit of time or error that no measured setting keeps, and what comes nearest."""


class SkinWarning(UserWarning):
    """A result that stands but deserves a second look."""
