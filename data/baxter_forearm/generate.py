"""Make the table and mesh of the Baxter-like forearm.

    python data/baxter_forearm/generate.py

Writes `taxels/forearm.csv` and `meshes/*.ply` beside this file and prints the hashes that the
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

from made_limbs import EllipticCone, lay_on_cone  # noqa: E402

LAYOUT = module_layout("triangle_11pad")
DIGITS = 9  # nanometres: the same file whatever the last bit of a sine

FOREARM = EllipticCone(0.072, 0.060, 0.27, 0.78)  # semi-axes, length, taper [m], assumed
WRIST = EllipticCone(0.046, 0.042, 0.08, 0.95)
ROWS = [(0, 14)] * 5  # 70 boards, 7 pairs round the arm, 5 rows along it
TILE = 37e-3  # side of the tiling where boards lie closest [m]
UNEVEN = 0.35  # how much further apart they lie at the borders, as a share
UNMOUNTED = ((0, 0), (69, 0))  # 70 boards of 11 pads less two: 768


def tables() -> dict[str, TaxelTable]:
    """The taxel table of each part."""
    centres, angles = triangle_sheet(ROWS, TILE)
    poses = lay_on_cone(FOREARM, spread(centres), angles, angle=0.0, height=0.125)
    table = taxel_table(poses, LAYOUT, unmounted=UNMOUNTED)
    positions = np.round(table.positions, DIGITS) + 0.0
    return {
        "forearm": replace(
            table, positions=positions, normals=np.round(table.normals, DIGITS) + 0.0
        )
    }


def spread(centres: FloatArray) -> FloatArray:
    """Centres (m, 2) of the even tiling moved apart towards the borders.

    Each coordinate grows by a cubic, so that no two boards come closer than in the tiling.
    """
    reach = np.abs(centres).max(axis=0)
    return np.asarray(centres * (1.0 + UNEVEN / 3.0 * (centres / reach) ** 2))


def meshes() -> dict[str, TriangleMesh]:
    """The closed mesh of each link."""
    return {
        "forearm": FOREARM.mesh(around=72, along=14, cap=0.3),
        "wrist": WRIST.mesh(around=56, along=8, cap=0.3),
    }


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
