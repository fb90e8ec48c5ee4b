"""Errors and warnings: one root, and each leaf is also the builtin a caller would expect."""

from __future__ import annotations

import difflib
import os
import re
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Collection, Iterable
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


class WrongTypeError(SkinError, TypeError):
    """An argument of a type that a function cannot take."""


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
        folder = os.path.isdir(path)  # False, too, for a name that no file can have
        found = f"{str(path)!r} is a folder" if folder else f"no file {str(path)!r}"
        super().__init__(f"{found}; expected {expected}")
        self.path, self.expected = Path(path), expected

    def __reduce__(self) -> tuple[Any, ...]:  # errors come back from other processes
        return type(self), (self.path, self.expected)


KINDS = {
    "a manifest": (".toml",),
    "a URDF": (".urdf", ".xacro"),
    "a model": (".skinmodel",),
    "a recording": (".mcap", ".npz", ".xdf", ".log", ".db3"),
    "a table": (".csv", ".tsv"),
    "a mesh": (".stl", ".obj", ".ply", ".off", ".dae", ".glb", ".gltf"),
    "a picture": (".png", ".jpg", ".svg", ".pdf"),
    "a text": (".txt", ".md", ".log"),
    "an array": (".npy",),
}


def check_kind(path: Path, expected: str, *suffixes: str, hint: str = "") -> None:
    """Refuse a file of another kind by its suffix: "m.stl: a mesh where a model is expected".

    Parameters
    ----------
    path : Path
    expected : str
        With its article, as in `KINDS`.
    *suffixes : str
        That it may have beside those of `KINDS`.
    hint : str
        What to type instead.

    Raises
    ------
    DataFormatError
    """
    suffix = path.suffix.lower()
    if suffix not in (*suffixes, *KINDS.get(expected, ())):
        for kind, known in KINDS.items():
            if suffix in known:
                ending = f" ({', '.join(KINDS.get(expected, suffixes))})"
                raise DataFormatError(f"{kind} where {expected}{ending}{hint} is expected", path)


def unknown_name(kind: str, name: str, known: Iterable[str], where: str = "") -> str:
    """What to say of a name that does not exist: the nearest one, and all that there are."""
    names = [str(one) for one in known]
    head = re.split(r" (?:(?:of|in|with|for|to|among|shown|here)\b|\()", kind, maxsplit=1)[0]
    if not names:
        return f"no {kind} {name!r}{where}; there are not any {_plural(head)}"
    exist = f"the {_plural(head)} are: {', '.join(names)}"
    if len(names) == 1:
        exist = f"the only {head} is {names[0]}"
    lower = {one.lower(): one for one in names}
    near = difflib.get_close_matches(name.lower(), lower, n=1)
    meant = f"did you mean {lower[near[0]]!r}? {exist[0].upper()}{exist[1:]}" if near else exist
    return f"no {kind} {name!r}{where}; {meant}"


def _plural(noun: str) -> str:
    if " or " in noun:
        return " and ".join(map(_plural, noun.split(" or ")))
    if noun.endswith("s") and not noun.endswith("ss"):
        return noun
    return noun + ("es" if noun.endswith(("s", "ch", "x")) else "s")


class UnknownNameError(SkinError, LookupError):
    """A name that nothing has, with the nearest one and all that exist.

    Parameters
    ----------
    kind : str
        What was looked for, in the singular ("part", "flattening method").
    name : str
        The name asked for.
    known : iterable of str
        The names that exist.
    where : str, optional
        Words behind the name: in what it does not exist.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.known, self.where = kind, name, tuple(known), where
        super().__init__(unknown_name(kind, name, self.known, where))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.kind, self.name, self.known, self.where)


def check_known(kind: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse the first name that nothing has.

    Raises
    ------
    UnknownNameError
        As its parameters: what was looked for, and the names that exist.
    """
    for name in names:
        if name not in known:
            raise UnknownNameError(kind, name, known)


class DataFormatError(SkinError, ValueError):
    """A file that does not follow its format.

    Parameters
    ----------
    message : str
        What the file holds, and what was expected.
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


def warn(text: str, above: int = 0) -> None:
    """Warn with `SkinWarning`, at the line that called the caller.

    Parameters
    ----------
    text : str
    above : int
        So many callers further up.
    """
    warnings.warn(text, SkinWarning, stacklevel=3 + above)
