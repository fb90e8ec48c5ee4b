"""The same link in metres and in millimetres: whether the wrapped patch is the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.calibration.patches import Case, far_apart
from calibration import wrap_layout
from calibration.patch.link_surface import rounded
from skinmap.arrays import FloatArray

MADE = 60  # meshes made besides the links
SAME = 1e-6  # [m]


def unit_rows(cases: list[Case]) -> list[dict[str, Any]]:
    """Targets of links and made meshes, and patches on the links, read in both units."""
    links = [case.vertices for case in {len(case.vertices): case for case in cases}.values()]
    meshes = [*links, *_made()]
    rows = []
    for name, how in PAIRS.items():
        same = [np.array_equal(*map(rounded, how(vertices))) for vertices in meshes]
        rows.append({"files": name, "meshes": len(meshes), "same_target": int(sum(same))})
    rows.append(_wrapped(cases))
    return rows


def _single(vertices: FloatArray, unit: float) -> FloatArray:
    """Vertices [m] once through a file of single floats in a unit."""
    return unit * (vertices / unit).astype(np.float32).astype(np.float64)


def _decimals(vertices: FloatArray, unit: float) -> FloatArray:
    return unit * np.round(vertices / unit, 8)


PAIRS = {
    "double floats": lambda x: (x, 1e-3 * (1e3 * x)),
    "single floats, mm made from m": lambda x: (
        _single(x, 1.0),
        _single(_single(x, 1.0), 1e-3),
    ),
    "single floats, m made from mm": lambda x: (
        _single(_single(x, 1e-3), 1.0),
        _single(x, 1e-3),
    ),
    "single floats, both from doubles": lambda x: (_single(x, 1.0), _single(x, 1e-3)),
    "text of 8 decimals, both from doubles": lambda x: (_decimals(x, 1.0), _decimals(x, 1e-3)),
}


def _made() -> list[FloatArray]:
    """Bumpy balls and capsules, some on round numbers, some anywhere."""
    rng = np.random.default_rng(0)
    meshes = []
    for number in range(MADE):
        ball = trimesh.creation.icosphere(3, radius=0.05)
        capsule = trimesh.creation.capsule(height=0.1, radius=0.04, count=[32, 32])
        mesh = (ball, capsule)[number % 2]
        points = mesh.vertices * rng.uniform(0.7, 1.3, 3) + rng.normal(0, 1e-3, mesh.vertices.shape)
        turned = Rotation.random(rng=rng).apply(points) + rng.normal(0, 0.1, 3)
        meshes.append(np.round(points, 6) if number % 3 == 0 else turned)
    return meshes


def _wrapped(cases: list[Case]) -> dict[str, Any]:
    """All patches by six anchors, their links from single floats in metres and in millimetres."""
    apart = []
    for number, case in enumerate(cases):
        rng = np.random.default_rng([number, 7])
        taxels = far_apart(case.layout, 6, rng)
        points = case.truth[taxels] + rng.normal(0.0, 1e-3, (6, 3))
        metres = _single(case.vertices, 1.0)
        found = [
            wrap_layout(
                layout, link, case.faces, taxels, places, rng=np.random.default_rng(number)
            ).positions
            for layout, link, places in (
                (case.layout, metres, points),
                (1e-3 * (1e3 * case.layout), _single(metres, 1e-3), 1e-3 * (1e3 * points)),
            )
        ]
        apart.append(float(np.abs(found[1] - found[0]).max()))
    return {
        "files": "patches on links of single floats, mm made from m",
        "patches": len(cases),
        "same_within_1e-6": int(np.sum(np.array(apart) <= SAME)),
        "furthest_m": max(apart),
    }
