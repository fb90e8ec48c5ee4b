"""A part's skin: taxels with repaired normals, on one link, and how it is recognised again.

Notebooks show it as a small picture: lines and dots in SVG, with a line of words below.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    check_finite,
    check_points,
    check_whole,
    freeze,
)
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.normals import less_hidden, on_a_line, repair_normals
from skinmap.skin.taxels import TaxelTable
from skinmap.summary import Summary

ALONE = 0.01  # across the disc that a taxel without neighbours is shown as [m]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Skin(Summary):
    """Taxels of one part, dense rows 0..n-1, in the frame of their link.

    Attributes
    ----------
    part, link : str
        Names of the part and of the URDF body that carries it.
    channels, modules : (n,) int
        Place in the live vector, and module, of each taxel.
    positions : (n, 3) float
        [m].
    normals : (n, 3) float
        Unit, outward.
    up : (3,) float or None
        What is up for the robot at rest; flat maps are turned by it. None where it is unknown.
    pieces : (n,) int or None
        Shell that carries each taxel, where the part has several: no triangle goes from one to
        another.
    ring : bool
        Whether its patches close to a ring: a contact goes on across their joints.
    wired : (n,) bool or None
        Which taxels have a channel of their own; the others never speak. None: all.

    Examples
    --------
    >>> import skinmap
    >>> skinmap.load_robot("kaspar").skin("left_hand")
    Skin(part=left_hand, taxels=144, modules=12, link=left_hand)
    """

    part: str
    link: str
    channels: IntArray
    modules: IntArray
    positions: FloatArray
    normals: FloatArray
    up: FloatArray | None = None
    pieces: IntArray | None = None
    ring: bool = False
    wired: BoolArray | None = None

    def __post_init__(self) -> None:
        positions = check_points(self.positions, "positions")
        normals = check_finite(self.normals, "normals", (len(positions), 3))
        channels, modules = np.asarray(self.channels), np.asarray(self.modules)
        if channels.shape != (len(positions),) or modules.shape != (len(positions),):
            raise InvalidArrayError(
                f"channels and modules must have shape ({len(positions)},), "
                f"got {channels.shape} and {modules.shape}"
            )
        freeze(self, channels=channels, modules=modules, positions=positions, normals=normals)
        if self.up is not None:
            freeze(self, up=check_finite(self.up, "up", (3,)))
        if self.pieces is not None:
            freeze(self, pieces=check_whole(self.pieces, "pieces", (len(positions),)))
        if self.wired is not None:
            freeze(self, wired=np.broadcast_to(self.wired, (len(positions),)))

    def __len__(self) -> int:
        return len(self.channels)

    @property
    def spacing(self) -> float:
        """Median distance of a taxel to the nearest other [m]; 10 mm where there is no other."""
        return median_spacing(self.positions) or ALONE

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "part": self.part,
            "taxels": len(self),
            "modules": len(np.unique(self.modules)),
            "link": self.link or "none",
        }

    def _repr_html_(self) -> str:
        """A picture for notebooks: the taxels, seen from where they spread most."""
        middle = self.positions - self.positions.mean(axis=0)
        axes = np.linalg.svd(middle, full_matrices=False)[2][:2]
        modules = len(np.unique(self.modules))
        words = f"{self.part}: {len(self):,} taxels on {modules} modules"
        return Summary._repr_html_(self) + svg_picture(middle @ axes.T, np.zeros((0, 2, 2)), words)


def skin_from_points(
    positions: ArrayLike, normals: ArrayLike | None = None, *, part: str = "skin"
) -> Skin:
    """A skin from bare positions (n, 3) [m]; normals (n, 3) are estimated where none are given.

    Parameters
    ----------
    positions : (n, 3) array-like of float
    [m].
    normals : (n, 3) array-like of float, optional
    Outward.
    part : str
    Its name.

    Returns
    -------
    Skin

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.skin import skin_from_points
    >>> grid = np.stack(np.meshgrid(np.arange(4), np.arange(4), [0]), axis=-1).reshape(-1, 3)
    >>> len(skin_from_points(0.01 * grid, np.tile([0, 0, 1], (16, 1))))
    16
    """
    points = check_points(positions, "positions")
    if normals is None:
        normals = repair_normals(points, None)
    index = np.arange(len(points))
    return Skin(part, "", index, np.zeros_like(index), points, np.asarray(normals))


def skin_from_table(
    table: TaxelTable,
    body: TriangleMesh | None,
    part: str,
    link: str,
    *,
    hint: FloatArray | None = None,
    keep_normals: bool = False,
    up: FloatArray | None = None,
    ring: bool = False,
) -> Skin:
    """A part's skin from its table and its link's mesh; normals are estimated.

    Those of the table are taken where the estimated ones point into the body more often.

    `hint` (n, 3) are rough outward directions for where there is no body; `keep_normals` trusts
    the file.

    Parameters
    ----------
    table : TaxelTable
    Of n taxels [m].
    body : TriangleMesh or None
    Mesh of the link.
    part, link : str
    Their names.
    hint : (n, 3) array of float, optional
    Rough outward directions.
    keep_normals : bool
    Whether the table's normals are right.
    up : (3,) array of float, optional
    Upward direction of the robot in the link.
    ring : bool
    Whether the skin goes round its link.

    Returns
    -------
    Skin

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.skin import skin_from_table
    >>> robot = skinmap.load_robot("icub")
    >>> table = robot.repair("left_hand").table
    >>> len(skin_from_table(table, robot.mesh_under("left_hand"), "left_hand", "l_hand"))
    48
    """
    if hint is None and on_a_line(table.positions):  # they span no surface: the file alone knows
        hint = table.normals
    normals = table.normals
    if not keep_normals:
        normals = repair_normals(table.positions, body, hint)
        if body is not None and len(body.faces):
            normals = less_hidden(table.positions, normals, table.normals, body)
    return Skin(
        part,
        link,
        table.channels,
        table.modules,
        table.positions,
        normals,
        up,
        table.pieces if len(table.pieces) else None,
        ring,
        ~np.isin(table.channels, table.unwired) if len(table.unwired) else None,
    )


SAME = 1e-6  # [m]; tables are written to a micrometre


def layout_fingerprint(part: str, positions: FloatArray) -> str:
    """SHA-256 of a part's name and its taxels (n, 3) [m] in micrometres."""
    whole = np.round(positions / SAME).astype("<i8")
    return hashlib.sha256(part.encode() + b"\0" + whole.tobytes()).hexdigest()


def fingerprint(skin: Skin) -> str:
    """SHA-256 of a part's name and layout."""
    return layout_fingerprint(skin.part, skin.positions)


WIDE, HIGH = 420.0, 320.0  # of the picture at most [px]
EDGE = 6.0  # free around it [px]
DOT = 0.22  # radius of a dot, in the distance of taxels if they were spread evenly
INK, LINE = "#0b3d91", "#8d97a3"


def svg_picture(points: FloatArray, lines: FloatArray, words: str) -> str:
    """HTML with a picture of dots and lines.

    Parameters
    ----------
    points : (n, 2) float
        Dots [m], y upwards; those that are not finite are left out.
    lines : (k, 2, 2) float
        Ends of lines [m].
    words : str
        Below the picture.
    """
    dots = points[np.isfinite(points).all(axis=1)]
    every = np.concatenate([dots, lines.reshape(-1, 2)])
    every = every if len(every) else np.zeros((1, 2))
    low, high = every.min(axis=0), every.max(axis=0)
    side = np.maximum(high - low, 1e-6)
    scale = float(min((WIDE - 2 * EDGE) / side[0], (HIGH - 2 * EDGE) / side[1]))
    width, height = scale * side + 2 * EDGE

    def place(at: FloatArray) -> FloatArray:
        return np.stack(
            [EDGE + (at[..., 0] - low[0]) * scale, EDGE + (high[1] - at[..., 1]) * scale], axis=-1
        ).round(1)

    radius = max(0.8, DOT * scale * float(np.sqrt(side.prod() / max(len(dots), 1))))
    path = "".join(f"M{a} {b}L{c} {d}" for (a, b), (c, d) in place(lines).tolist())
    circles = "".join(
        f'<circle cx="{x}" cy="{y}" r="{radius:.1f}"/>' for x, y in place(dots).tolist()
    )
    return (
        f'<figure style="margin:0"><svg width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="{escape(words)}"><path d="{path}" stroke="{LINE}" fill="none"/>'
        f'<g fill="{INK}">{circles}</g></svg><figcaption>{escape(words)}</figcaption></figure>'
    )
