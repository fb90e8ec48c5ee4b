"""Archives of plain arrays (`.npz`), opened with bounds on what they unpack to."""

from __future__ import annotations

import io
import json
import os
import struct
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, InvalidArrayError, SkinError

MAGIC = b"\x93NUMPY"
MAX_LETTER = 0x10FFFF  # of Unicode; the surrogates below it stand for no letter either
END = struct.Struct("<4s6xH10x")  # of a zip: its mark and its number of members
END_MARK, MANY = b"PK\5\6", 0xFFFF  # so many or more are counted elsewhere
LARGEST = 2**32  # bytes unpacked: an hour of 4,326 taxels at 50 Hz has 0.8e9


@contextmanager
def open_arrays(path: Path, expected: str = "") -> Iterator[NpzFile]:
    """The arrays of an archive; nothing in it is executed.

    Opened here, as numpy leaves a damaged file open when it opens it itself.

    Parameters
    ----------
    path : Path
    expected : str
        What the archive is, for messages. Without it damage raises what is listed in
        `skinmap.errors.DAMAGED_ARCHIVE`.

    Raises
    ------
    DataFormatError
        A member that is no array, or more than 4 GB unpacked; with `expected` damage too, and
        arrays that cannot be what they should.
    """
    try:
        with _opened(path) as arrays:
            yield arrays
    except DAMAGED_ARCHIVE as error:
        known = isinstance(error, SkinError) and not isinstance(error, InvalidArrayError)
        if known or not expected:
            raise
        raise DataFormatError(f"not {expected}: {str(error)[:200]}", path) from error


@contextmanager
def _opened(path: Path) -> Iterator[NpzFile]:
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise zipfile.BadZipFile("not an .npz archive")
        with zipfile.ZipFile(file) as whole:
            size = sum(entry.file_size for entry in whole.infolist())
            strange = [name for name in whole.namelist() if not _is_array(whole, name)]
            check_directory(whole)
        if size > LARGEST:
            raise DataFormatError(f"unpacks to {size / 2**30:.1f} GB; at most 4 GB are read", path)
        if strange:
            raise DataFormatError(f"holds {strange[0]!r}, which is not an array", path)
        file.seek(0)
        with _Arrays(file, allow_pickle=False) as arrays, quiet_headers():
            yield arrays


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of an archive by their names.

    Raises
    ------
    DataFormatError
        A damaged archive too.
    """
    with open_arrays(path, "an archive of arrays") as arrays:
        return {name: arrays[name] for name in arrays.files}


def headed(head: Mapping[str, Any], arrays: Mapping[str, Any]) -> bytes:
    """A compressed archive of arrays whose member `head` is JSON; `open_headed` opens it."""
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(head).encode(), np.uint8)
    np.savez_compressed(buffer, head=text, **arrays)
    return buffer.getvalue()


@contextmanager
def open_headed(path: Path, format: str, expected: str) -> Iterator[tuple[dict[str, Any], NpzFile]]:
    """Head and arrays of an archive that `headed` made.

    Parameters
    ----------
    path : Path
    format : str
        Of its head.
    expected : str
        What the archive is, for messages.

    Raises
    ------
    DataFormatError
        Another format or a damaged archive. Errors of its content, raised inside the `with`, too.
    """
    try:
        with open_arrays(path) as arrays:
            head = json.loads(arrays["head"].tobytes())
            if head["format"] != format:
                raise DataFormatError(f"format {head['format']!r}, expected {format!r}", path)
            yield head, arrays
    except DAMAGED_ARCHIVE as error:
        if isinstance(error, DataFormatError):
            raise
        raise DataFormatError(f"not {expected}: {error}", path) from error


def check_directory(whole: zipfile.ZipFile) -> None:
    """Refuse an archive whose directory lists fewer members than its end counts.

    It has no checksum: a flipped bit in the length of one entry's comment hides those behind it.

    Raises
    ------
    zipfile.BadZipFile
    """
    assert whole.fp is not None
    whole.fp.seek(-END.size - len(whole.comment), os.SEEK_END)
    mark, count = END.unpack(whole.fp.read(END.size))
    if mark == END_MARK and count not in (MANY, len(whole.infolist())):
        raise zipfile.BadZipFile(f"{len(whole.infolist())} of {count} members are listed")


@contextmanager
def quiet_headers() -> Iterator[None]:
    """Silence about headers of arrays that numpy reads, but would rather see written otherwise.

    Names of types of its first versions, and shapes as Python 2 wrote them.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.filterwarnings("ignore", "Reading `.npy` or `.npz` file required", UserWarning)
        yield


class _Arrays(NpzFile):
    """An archive whose checksums hold and whose texts are texts.

    numpy reads no further than an array's last byte, where a checksum may not have been looked at
    yet, and hands on code points that Python fails on.
    """

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self.files:
            raise KeyError(f"{name} is not a file in the archive")
        if self.zip is None:
            raise ValueError("the archive is closed")
        with self.zip.open(f"{name}.npy") as member:
            array: NDArray[Any] = np.lib.format.read_array(member, allow_pickle=False)
            if member.read(1):  # at the end its checksum is compared
                raise ValueError(f"{name!r} is longer than its array")
        if array.dtype.kind == "U" and array.dtype.itemsize:
            number = np.dtype(np.uint32).newbyteorder(array.dtype.byteorder)
            codes = np.ascontiguousarray(array).reshape(-1).view(number)
            if ((codes > MAX_LETTER) | ((codes >= 0xD800) & (codes < 0xE000))).any():
                raise ValueError(f"{name!r} holds invalid Unicode")
        return array


def _is_array(whole: zipfile.ZipFile, name: str) -> bool:
    """Whether numpy gives an array for a member, and not its bytes."""
    with whole.open(name) as member:
        return name.endswith(".npy") and member.read(len(MAGIC)) == MAGIC
