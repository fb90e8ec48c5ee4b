"""Anchors as a table: read and written so that what is written is read to the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.commands.patch_job import PatchTask
from calibration.files.tables import BoardTable, read_anchors, read_board
from calibration.patch.solver_budget import FULL, Effort
from skinmap.arrays import FloatArray, IntArray
from skinmap.io.robots.urdf import read_mesh
from skinmap.io.units import UNITS


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
    """Anchors of a file `channel,x,y,z[,sigma]`, in its own unit."""
    taxels, points, sigma = read_anchors(path, board)
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


def make_task(
    title: str,
    board: BoardTable,
    link: tuple[FloatArray, IntArray],
    anchors: Sequence[Anchor],
    *,
    unit: float,
    sigma: float,
    mirror: bool = False,
    effort: Effort = FULL,
) -> PatchTask:
    """Anchors in `unit` metres as a task in metres; `sigma` [m] where they do not say."""
    stated = [anchor.sigma for anchor in anchors if anchor.sigma is not None]
    whole = len(stated) == len(anchors)
    spread = np.array(stated) * unit if whole else np.full(len(anchors), sigma)
    points = np.array([anchor.point for anchor in anchors]).reshape(-1, 3) * unit
    taxels = np.array([anchor.taxel for anchor in anchors], np.int64)
    return PatchTask(title, board, link, taxels, points, spread, mirror=mirror, effort=effort)


def load_link(path: Path, unit: float) -> tuple[FloatArray, IntArray]:
    """Vertices (v, 3) [m] and faces (f, 3) of a mesh file whose lengths are in `unit` metres."""
    vertices, faces = read_mesh(path)
    return vertices * unit, faces


def load_wrap(
    layout_file: Path,
    mesh_file: Path,
    anchors_file: Path,
    *,
    units: str,
    sigma_mm: float,
    mirror: bool = False,
    effort: Effort = FULL,
) -> PatchTask:
    """The three files of a wrap."""
    unit = UNITS[units]
    board = read_board(layout_file, unit)
    return make_task(
        f"{layout_file.stem} on {mesh_file.stem}",
        board,
        load_link(mesh_file, unit),
        read_anchor_table(anchors_file, board),
        unit=unit,
        sigma=1e-3 * sigma_mm,
        mirror=mirror,
        effort=effort,
    )
