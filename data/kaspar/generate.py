"""Make the tables and meshes of the KASPAR-like robot.

    python data/kaspar/generate.py

Writes `taxels/<part>.csv` and `meshes/<link>.ply` beside this file and prints the hashes that the
README lists. Nothing here is random.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.geometry.triangles import TriangleMesh
from skinmap.io.robots.mesh_file import write_mesh
from skinmap.io.taxels.taxel_table import write_csv
from skinmap.skin.modules import module_layout, taxel_table, triangle_sheet
from skinmap.skin.repair import replace
from skinmap.skin.taxels import TaxelTable

HERE = Path(__file__).resolve().parent
if str(HERE.parent) not in sys.path:  # also when it is loaded by its path
    sys.path.append(str(HERE.parent))

from made_limbs import EllipticCone, ellipsoid, hinge, lay_on_cone  # noqa: E402

LAYOUT = module_layout("triangle_12pad")
SIDE = 30e-3  # of a board [m]
DIGITS = 9  # nanometres: the same file whatever the last bit of a sine
QUARTER = np.pi / 2.0

# Sizes of a small child, assumed; z runs along each limb, away from the trunk [m].
TUBES = {
    "torso": EllipticCone(0.066, 0.090, 0.20, 0.86),
    "neck": EllipticCone(0.028, 0.028, 0.06, 0.9),
    "upper_arm": EllipticCone(0.037, 0.035, 0.15, 0.86),
    "forearm": EllipticCone(0.032, 0.029, 0.12, 0.85),
    "hand": EllipticCone(0.040, 0.027, 0.115, 0.82),
    "thigh": EllipticCone(0.046, 0.043, 0.16, 0.84),
    "shin": EllipticCone(0.038, 0.035, 0.16, 0.8),
    "foot": EllipticCone(0.030, 0.036, 0.12, 0.86),
}
HEAD = np.array([0.076, 0.066, 0.086])  # semi-axes
HEAD_AT = np.array([0.0, 0.0, 0.080])  # centre in the head's frame

# Part: tube, rows of boards (first place and number), turn of the sheet, angle and height.
SHEETS = {
    "torso": ("torso", [(0, 5), (0, 5), (0, 5), (0, 5)], 0.0, 0.0, 0.110),
    "arm": ("upper_arm", [(0, 4), (0, 4), (0, 4), (0, 4)], 0.0, QUARTER, 0.072),
    "hand": ("hand", [(0, 6), (0, 6)], QUARTER, QUARTER, 0.056),
    "foot": ("foot", [(0, 3), (0, 3)], 0.0, 0.0, 0.075),
}
CHEEK = (np.radians(48.0), np.radians(-14.0))  # azimuth and elevation of the middle board


def tables() -> dict[str, TaxelTable]:
    """The taxel table of each part, in the manifest's order."""
    made = {"torso": _rounded(taxel_table(_sheet("torso", 1.0), LAYOUT))}
    for part in ("arm", "hand", "foot"):
        for name, sign in (("right", 1.0), ("left", -1.0)):
            made[f"{name}_{part}"] = _rounded(taxel_table(_sheet(part, sign), LAYOUT))
    for name, sign in (("right", -1.0), ("left", 1.0)):
        made[f"{name}_cheek"] = _rounded(taxel_table(_cheek(sign), LAYOUT))
    return made


def meshes() -> dict[str, TriangleMesh]:
    """The closed mesh of each link."""
    made = {name: tube.mesh(around=56, along=12) for name, tube in TUBES.items()}
    head = ellipsoid(HEAD, around=56, rings=27)
    return {**made, "head": TriangleMesh(head.vertices + HEAD_AT, head.faces)}


def _sheet(part: str, sign: float) -> FloatArray:
    """Poses of the boards of a part; `sign` -1 mirrors the sheet in the xz plane of the link."""
    tube, rows, turn, angle, height = SHEETS[part]
    centres, angles = triangle_sheet(rows, SIDE, turn=turn)
    # A mirrored board is the same board turned the other way: it is symmetric about its y axis.
    return lay_on_cone(
        TUBES[tube], centres * [sign, 1.0], sign * angles, angle=sign * angle, height=height
    )


def _cheek(sign: float) -> FloatArray:
    """Poses of three boards in a row, the middle one tangent to the head."""
    azimuth, elevation = sign * CHEEK[0], CHEEK[1]
    middle = np.eye(4)
    middle[:3, :3], middle[:3, 3] = _tangent(azimuth, elevation)
    sides = [hinge(middle, edge, SIDE, _above_head) for edge in ((1, 2) if sign < 0 else (2, 1))]
    return np.stack([sides[1], middle, sides[0]])


def _tangent(azimuth: float, elevation: float) -> tuple[FloatArray, FloatArray]:
    """Axes (3, 3) of a board upright on the head, and its place (3,)."""
    ray = np.array(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    place = ray / np.linalg.norm(ray / HEAD)
    normal = place / HEAD**2
    normal /= np.linalg.norm(normal)
    across = np.cross([0.0, 0.0, 1.0], normal)
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(normal, across), normal]), place + HEAD_AT


def _above_head(point: FloatArray) -> float:
    return float(np.linalg.norm((point - HEAD_AT) / HEAD) - 1.0)


def _rounded(table: TaxelTable) -> TaxelTable:
    return replace(
        table,
        positions=np.round(table.positions, DIGITS) + 0.0,
        normals=np.round(table.normals, DIGITS) + 0.0,
    )


def main() -> None:
    """Write all files and print their hashes."""
    for part, table in tables().items():
        write_csv(table, HERE / "taxels" / f"{part}.csv")
        _report(HERE / "taxels" / f"{part}.csv", f"{len(table)}")
    for link, mesh in meshes().items():
        write_mesh(mesh, HERE / "meshes" / f"{link}.ply")
        _report(HERE / "meshes" / f"{link}.ply", "")


def _report(path: Path, count: str) -> None:
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    print(f"| `{path.relative_to(HERE)}` | {count} | `{digest}` |")


if __name__ == "__main__":
    main()
