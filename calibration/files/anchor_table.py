"""Anchors as a table: read and written so that what is written is read to the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.files.tables import BoardTable, read_anchors
from skinmap.errors import DataFormatError

MAX_ANCHORS = 100_000  # measured one by one: a table of more is another table


@dataclass(frozen=True, slots=True)
class Anchor:
    """One taxel whose place is known, in the unit of its file.

    Attributes
    ----------
    taxel : int
        Row of the board.
    point : (x, y, z)
        In the frame of the mesh.
    sigma : float or None
        Standard deviation of each coordinate; None where the file does not say.
    """

    taxel: int
    point: tuple[float, float, float]
    sigma: float | None = None


def read_anchor_table(path: Path, board: BoardTable) -> list[Anchor]:
    """Anchors of a file `channel,x,y,z[,sigma]`, in its own unit.

    Raises
    ------
    DataFormatError
        As `read_anchors`, and where there are more than `MAX_ANCHORS`.
    """
    taxels, points, sigma = read_anchors(path, board)
    if len(taxels) > MAX_ANCHORS:
        raise DataFormatError(f"{len(taxels)} anchors, expected at most {MAX_ANCHORS}", path)
    spread = [None] * len(points) if sigma is None else sigma.tolist()
    return [
        Anchor(taxel, (place[0], place[1], place[2]), own)
        for taxel, place, own in zip(taxels.tolist(), points.tolist(), spread, strict=True)
    ]


def write_anchor_table(anchors: Sequence[Anchor], board: BoardTable, path: Path) -> None:
    """Write what `read_anchor_table` reads, with all digits."""
    stated = all(anchor.sigma is not None for anchor in anchors)
    lines = ["channel,x,y,z,sigma" if stated else "channel,x,y,z"]
    for anchor in anchors:
        numbers = (*anchor.point, anchor.sigma) if stated else anchor.point
        lines.append(f"{board.channels[anchor.taxel]},{','.join(map(repr, numbers))}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
