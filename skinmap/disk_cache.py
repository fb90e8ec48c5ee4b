"""Results kept on disk between runs, under the content they were made from.

An entry is an archive of arrays named by a hash of everything that decides what is in it: nothing
is ever out of date, and two processes that make the same entry write the same bytes. A cache can
only save time: whatever is wrong with it, the result is made anew.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeAlias

from skinmap.errors import DAMAGED_ARCHIVE, InvalidArrayError, SkinWarning
from skinmap.imports import installed

if TYPE_CHECKING:  # who only asks what is kept needs no arrays
    import numpy as np
    from numpy.typing import NDArray

Arrays: TypeAlias = "dict[str, NDArray[Any]]"
Digest = bytes
# By id, with the object itself: as long as it is held here no other one can have its id.
Known = dict[int, tuple[Any, Digest]]
Ingredient: TypeAlias = "NDArray[Any] | str | bytes | int | float"

FORMAT = 1  # of the archives; another one has another folder
FOLDER_VARIABLE = "SKINMAP_CACHE"  # a folder, or `off`
LIMIT_VARIABLE = "SKINMAP_CACHE_MB"
LIMIT_MB = 1000.0
SIZE = 16  # bytes of a key: two of a million million share one with a chance of 1e-15
ABANDONED = 3600.0  # age of a half-written file from which whoever wrote it is gone [s]
SUFFIX, PARTIAL = ".npz", ".partial"


class CacheWarning(SkinWarning):
    """A cache that cannot be used as it is; results are right all the same, only slower."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One kept result: its file, kind, size [bytes] and time of last use [s since 1970]."""

    path: Path
    kind: str
    size: int
    used: float


class Cache:
    """Archives of arrays in one folder, the longest unused leaving when they grow too large.

    Parameters
    ----------
    folder : Path
        Made when first written to, for its owner alone.
    limit : int
        Most bytes of all entries together.
    """

    def __init__(self, folder: Path, *, limit: int = int(LIMIT_MB * 1e6)) -> None:
        self.folder, self.limit = folder, limit
        self._complained = False

    @property
    def _home(self) -> Path:
        return self.folder / f"v{FORMAT}"

    def get(self, kind: str, key: str) -> Arrays | None:
        """The arrays kept under a key; None where there are none, or none that can be read."""
        from skinmap.archive import open_arrays

        path = self._path(kind, key)
        try:
            with open_arrays(path) as archive:
                arrays = {name: archive[name] for name in archive.files}
        except (FileNotFoundError, NotADirectoryError):
            return None
        except DAMAGED_ARCHIVE as error:
            self._complain(f"{str(path)!r} cannot be read ({error}); it is made anew")
            self._remove(path)
            return None
        with suppress(OSError):  # what cannot be touched is dropped earlier, no more
            os.utime(path)
        return arrays

    def put(self, kind: str, key: str, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Keep arrays under a key; whether they were. What does not fit is not kept."""
        size = sum(array.nbytes for array in arrays.values())
        if size > self.limit:
            return False
        try:
            self.write(kind, key, arrays)
        except OSError as error:
            self._complain(f"cannot write the cache {self.folder}: {error.strerror or error}")
            return False
        self._shrink(keep=self._path(kind, key))
        return True

    def write(
        self, kind: str, key: str, arrays: Mapping[str, NDArray[Any]], *, packed: bool = False
    ) -> None:
        """Keep arrays under a key, whole or not at all; OSError where they cannot be written."""
        import numpy as np

        path = self._path(kind, key)
        for folder in (self.folder, path.parent):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(suffix=PARTIAL, dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                save = np.savez_compressed if packed else np.savez
                save(file, **arrays)  # type: ignore[arg-type]
            os.replace(name, path)  # whoever else writes it
        except OSError:
            self._remove(Path(name))
            raise

    def entries(self) -> list[Entry]:
        """What is kept, the longest unused first."""
        found = []
        for path in self._files(SUFFIX):
            with suppress(OSError):  # another process has just dropped it
                facts = path.stat()
                found.append(Entry(path, path.parent.name, facts.st_size, facts.st_mtime))
        return sorted(found, key=lambda entry: (entry.used, entry.path))

    def trusted(self) -> bool:
        """Whether only this user can write the folder that is read."""
        try:
            facts = self.folder.stat()
        except OSError:
            return True  # not there yet
        others = stat.S_IWGRP | stat.S_IWOTH
        return facts.st_uid == os.getuid() and not facts.st_mode & others

    def _path(self, kind: str, key: str) -> Path:
        return self._home / kind / f"{key}{SUFFIX}"

    def _files(self, suffix: str) -> Iterator[Path]:
        return self._home.glob(f"*/*{suffix}")

    def _shrink(self, keep: Path) -> None:
        """Drop the longest unused until all fit, and what a killed process left half-written."""
        entries = self.entries()
        total = sum(entry.size for entry in entries)
        for entry in entries:
            if total <= self.limit:
                break
            if entry.path != keep and self._remove(entry.path):
                total -= entry.size
        for path in self._files(PARTIAL):
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > ABANDONED:
                    self._remove(path)

    def _remove(self, path: Path) -> bool:
        try:
            path.unlink()
        except OSError:  # gone already, or read-only: nothing hangs on it
            return False
        return True

    def _complain(self, words: str) -> None:
        if not self._complained:
            self._complained = True
            warnings.warn(words, CacheWarning, stacklevel=4)


_opened: dict[tuple[str, str], Cache | None] = {}


def open_cache() -> Cache | None:
    """The cache that the environment names; None where it is `off` or there is no home for it.

    `SKINMAP_CACHE` is a folder or `off`, by default `skinmap` in the user's folder for caches;
    `SKINMAP_CACHE_MB` is the most that it holds.
    """
    names = os.environ.get(FOLDER_VARIABLE, ""), os.environ.get(LIMIT_VARIABLE, "")
    where = (*names, os.environ.get("XDG_CACHE_HOME", ""), os.environ.get("HOME", ""))
    key = ("\0".join(where), str(os.getpid()))
    if key not in _opened:
        _opened[key] = _opened_at(*names)
    return _opened[key]


def cached(
    kind: str,
    ingredients: Sequence[Ingredient],
    make: Callable[[], Arrays],
    *,
    made_by: Sequence[str] = (),
) -> Arrays:
    """What `make` gives, from the cache where it was made before of the same ingredients.

    Parameters
    ----------
    kind : str
        What it is, a folder's name ("link_mesh").
    ingredients : sequence of array, str, bytes, int or float
        All that decides the result; arrays count with type and shape.
    make : callable
        Makes the arrays; called where the cache does not have them.
    made_by : sequence of str
        Distributions whose version decides too ("pymeshlab"), beside our own. The code of the
        folder that `make` is defined in decides as well: what it makes is another thing once
        that was edited, though the version is the same.

    Returns
    -------
    dict of array
        Equal to the bit whether made or kept.
    """
    cache = open_cache()
    if cache is None:
        return make()
    code = _code(getattr(sys.modules.get(make.__module__), "__file__", None))
    versions = (f"{name} {installed(name) or 'none'}" for name in ("skinmap", "numpy", *made_by))
    key = content_key(kind, code, *versions, *ingredients)
    kept = cache.get(kind, key)
    if kept is not None:
        return kept
    arrays = make()
    cache.put(kind, key, arrays)
    return arrays


@lru_cache
def _code(module: str | None) -> str:
    """Hash of a module's file and of those beside it, which are read once in a process."""
    files = sorted(Path(module).parent.glob("*.py")) if module else []
    return _sum(*(part for one in files for part in (one.name.encode(), one.read_bytes()))).hex()


def content_key(*values: Any) -> str:
    """Hexadecimal key of some values: the same content has the same key in every process.

    Numbers, texts, arrays, paths, sequences, mappings, sets, dataclasses and functions count by
    what they are; any other object says what it consists of by a method `content()`.

    Raises
    ------
    InvalidArrayError
        An object that does not say what it consists of.
    """
    # Objects that a task holds many times (the skin of each touch) are read once.
    return _digest(values, {}).hex()


def _digest(value: Any, known: Known) -> Digest:
    if isinstance(value, str | bytes | int | float | None):
        return _sum(*_parts(value, known))
    if id(value) not in known:
        known[id(value)] = value, _sum(*_parts(value, known))
    return known[id(value)][1]


def _parts(value: Any, known: Known) -> list[bytes]:
    """What a value consists of; the first part tells its kind."""
    import numpy as np

    if value is None or isinstance(value, bool | int | float | complex | str):
        return [type(value).__name__.encode(), repr(value).encode()]
    if isinstance(value, bytes | bytearray):
        return [b"bytes", bytes(value)]
    if isinstance(value, PurePath):
        return [b"path", str(value).encode()]
    if isinstance(value, np.ndarray | np.generic):
        return _array_parts(np.asarray(value), known)
    if isinstance(value, Mapping):
        pairs = [(_digest(key, known), _digest(item, known)) for key, item in value.items()]
        return [b"mapping", *(part for pair in pairs for part in pair)]
    if isinstance(value, Set):
        return [b"set", *sorted(_digest(item, known) for item in value)]
    if isinstance(value, Sequence):
        return [b"sequence", *(_digest(item, known) for item in value)]
    return _object_parts(value, known)


def _array_parts(array: np.ndarray[Any, Any], known: Known) -> list[bytes]:
    import numpy as np

    if array.dtype.hasobject:
        return [b"objects", str(array.shape).encode(), _digest(array.ravel().tolist(), known)]
    head = f"{array.dtype.str} {array.shape}"
    return [b"array", head.encode(), np.ascontiguousarray(array).tobytes()]


def _object_parts(value: Any, known: Known) -> list[bytes]:
    if callable(value) and hasattr(value, "__qualname__"):
        if "<" in value.__qualname__:  # a lambda's name says nothing of what it does
            raise InvalidArrayError(f"{value.__qualname__} has no name to key a result by")
        return [b"function", f"{value.__module__}.{value.__qualname__}".encode()]
    kind = f"{type(value).__module__}.{type(value).__qualname__}".encode()
    if hasattr(value, "content"):
        return [b"object", kind, _digest(value.content(), known)]
    if is_dataclass(value):
        own = [getattr(value, field.name) for field in fields(value)]
        return [b"object", kind, *(_digest(item, known) for item in own)]
    raise InvalidArrayError(
        f"a task holds a {type(value).__qualname__}, without a list of its content"
    )


def _sum(*parts: bytes) -> Digest:
    found = hashlib.blake2b(digest_size=SIZE)
    for part in parts:
        found.update(len(part).to_bytes(8, "little"))  # so that parts cannot run into each other
        found.update(part)
    return found.digest()


def _opened_at(folder: str, limit: str) -> Cache | None:
    if folder.lower() == "off":
        return None
    try:
        most = int(float(limit or LIMIT_MB) * 1e6)
    except (ValueError, OverflowError):
        most = -1
    if most < 0:
        words = f"{LIMIT_VARIABLE}={limit!r} is not a number of megabytes; it is {LIMIT_MB:.0f}"
        warnings.warn(words, CacheWarning, stacklevel=4)
        most = int(LIMIT_MB * 1e6)
    try:
        path = Path(folder) if folder else default_folder()
    except RuntimeError:  # no home, as in some containers
        return None
    cache = Cache(path, limit=most)
    if not cache.trusted():
        words = f"the cache {path} can be written by others, so it is not used; chmod go-w would do"
        warnings.warn(words, CacheWarning, stacklevel=4)
        return None
    return cache


def default_folder() -> Path:
    """`skinmap` in the user's folder for caches.

    Raises
    ------
    RuntimeError
        A user without a home.
    """
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "skinmap"
