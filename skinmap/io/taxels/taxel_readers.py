"""Taxel-table readers by name and file suffix, with plug-ins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from skinmap.errors import UnknownNameError
from skinmap.io.text import check_file
from skinmap.registry import Registry
from skinmap.skin.taxels import TaxelTable

Reader = Callable[[Path], TaxelTable]
readers: Registry[Reader] = Registry(
    "taxel format",
    "skinmap.readers",
    built_in={
        "csv": "skinmap.io.taxels.taxel_table:read_csv",
        "cyskin": "skinmap.io.taxels.cyskin:read_cyskin_taxels",
        "icub": "skinmap.io.taxels.icub:read_icub",
        "skinware": "skinmap.io.taxels.skinware:read_skinware",
        "urdf": "skinmap.io.taxels.tactile_urdf:read_tactile_urdf",
    },
)
# `skin.calib` is the name that Skinware gives its database.
SUFFIXES = {
    ".csv": "csv", ".txt": "icub", ".json": "cyskin", ".calib": "skinware", ".urdf": "urdf",
}  # fmt: skip


def read_taxels(path: Path, format: str | None = None) -> TaxelTable:
    r"""Read a taxel table in the format named, or the one its suffix stands for.

    Parameters
    ----------
    path : Path
    format : str, optional
        One of `readers`, built in or of a plug-in.

    Returns
    -------
    TaxelTable
        Positions in the units of the file.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, one that does not follow its format, or one that is too large.
    UnknownNameError
        A format that no reader has.

    Examples
    --------
    >>> from pathlib import Path
    >>> from skinmap.io import read_taxels
    >>> header = "channel,module,x,y,z,nx,ny,nz"
    >>> _ = Path("two.csv").write_text(f"{header}\n0,0,1,0,0,0,0,0\n1,0,2,0,0,0,0,0\n")
    >>> read_taxels(Path("two.csv")).positions[:, 0].tolist()
    [1.0, 2.0]
    """
    check_file(path, "a taxel table")
    if format is None:
        if path.suffix.lower() not in SUFFIXES:
            raise UnknownNameError("reader for files ending in", path.suffix, SUFFIXES)
        format = SUFFIXES[path.suffix.lower()]
    return readers.get(format)(path)
