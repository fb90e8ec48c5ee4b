"""Archives of plain arrays (`.npz`), opened with bounds on what they unpack to."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from skinmap.errors import DataFormatError

MAGIC = b"\x93NUMPY"
MAX_LETTER = 0x10FFFF  # of Unicode; the surrogates below it stand for no letter either
LARGEST = 2**32  # bytes unpacked: an hour of 4,326 taxels at 50 Hz has 0.8e9


@contextmanager
def open_arrays(path: Path) -> Iterator[NpzFile]:
    """The arrays of an archive; nothing in it is executed.

    Opened here, as numpy leaves a damaged file open when it opens it itself.

    Raises
    ------
    DataFormatError
        A member that is no array, or more than 4 GB unpacked. Damage raises what is listed in
        `skinmap.errors.DAMAGED_ARCHIVE`.
    """
    with path.open("rb") as file:
        with zipfile.ZipFile(file) as whole:
            size = sum(entry.file_size for entry in whole.infolist())
            strange = [name for name in whole.namelist() if not _is_array(whole, name)]
        if size > LARGEST:
            raise DataFormatError(f"unpacks to {size / 2**30:.1f} GB; at most 4 GB are read", path)
        if strange:
            raise DataFormatError(f"holds {strange[0]!r}, which is no array", path)
        file.seek(0)
        with _Arrays(file, allow_pickle=False) as arrays, quiet_headers():
            yield arrays


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
    """An archive whose texts are texts: numpy hands on code points that Python fails on."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        array: NDArray[Any] = super().__getitem__(name)
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
