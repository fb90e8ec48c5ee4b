"""Taxel-table readers by name and file suffix, with plug-ins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from skinmap.errors import MissingFileError, UnknownNameError
from skinmap.io.icub import read_icub
from skinmap.io.table import read_csv
from skinmap.registry import Registry
from skinmap.skin.taxels import TaxelTable

Reader = Callable[[Path], TaxelTable]
readers: Registry[Reader] = Registry("taxel format", "skinmap.readers")
readers.register("csv")(read_csv)
readers.register("icub")(read_icub)
SUFFIXES = {".csv": "csv", ".txt": "icub"}


def read_taxels(path: Path, format: str | None = None) -> TaxelTable:
    """Read a taxel table in the format named, or the one its suffix stands for.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one that does not follow its format.
    UnknownNameError
        A format that no reader has.
    """
    if not path.is_file():
        raise MissingFileError(path, "a taxel table")
    if format is None:
        if path.suffix.lower() not in SUFFIXES:
            raise UnknownNameError("reader for files ending in", path.suffix, SUFFIXES)
        format = SUFFIXES[path.suffix.lower()]
    return readers.get(format)(path)
