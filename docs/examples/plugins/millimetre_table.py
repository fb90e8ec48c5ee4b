"""A reader: taxels as lines `number x y z` in millimetres, with the module before a slash."""

import numpy as np

from skinmap.errors import DataFormatError
from skinmap.skin.taxels import TaxelTable


def read(path):
    """Taxels of a file whose lines look like `3/17 12.5 0.0 41.0`."""
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            name, *place = line.split()
            module, channel = map(int, name.split("/"))
            x, y, z = map(float, place)
        except ValueError:
            raise DataFormatError(
                f"expected 'module/channel x y z', got {line!r}", path=path, line=number
            ) from None
        rows.append((channel, module, x * 1e-3, y * 1e-3, z * 1e-3))
    table = np.array(sorted(rows))
    return TaxelTable(
        table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], np.zeros((len(rows), 3))
    )
