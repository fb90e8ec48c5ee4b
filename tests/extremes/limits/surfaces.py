"""Laws of triangles, lengths and surface meshes."""

from __future__ import annotations

import numpy as np

from skinmap.errors import InvalidArrayError, InvalidMeshError
from skinmap.geometry.proximity import edge_graph, path_distances
from skinmap.geometry.rigid import rigid_fit, transform_points
from skinmap.geometry.topology import check_surface, edges, euler_number
from skinmap.geometry.triangles import face_normals, signed_areas, smallest_altitudes
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface

from .law import Law, Outside
from .shapes import bent_skin, dome, lattice, normals, with_holes

WIDE = (1e-30, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e30)
DOME, FACES = dome()
FLAT = DOME[:, :2]


def areas(scale: float) -> float:
    apart = signed_areas(scale * FLAT, FACES) / scale**2 - signed_areas(FLAT, FACES)
    return float(np.abs(apart).max() / signed_areas(FLAT, FACES).max())


def altitudes(scale: float) -> float:
    plain = smallest_altitudes(DOME, FACES)
    return float(np.abs(smallest_altitudes(scale * DOME, FACES) / scale / plain - 1).max())


def facing(offset: float) -> float:
    return float(np.abs(face_normals(DOME + offset, FACES) - face_normals(DOME, FACES)).max())


def paths(scale: float) -> float:
    def lengths(points: np.ndarray) -> np.ndarray:
        return path_distances(edge_graph(points, edges(FACES)), np.array([0]))

    return float(np.abs(lengths(scale * DOME) / scale - lengths(DOME)).max())


def fitted(scale: float) -> float:
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = scale * (DOME @ turn.T + [3.0, -2.0, 1.0])
    found = rigid_fit(scale * DOME, moved, np.ones(len(DOME)))
    return float(np.abs(transform_points(found, scale * DOME) - moved).max() / scale)


def triangles_differ(**how: float) -> float:
    """Triangles in one of two surface meshes and not in the other."""
    plain, other = build_surface(bent_skin()).faces, build_surface(bent_skin(**how)).faces
    one, two = ({tuple(sorted(face)) for face in faces.tolist()} for faces in (plain, other))
    return float(len(one ^ two))


def unmeshed(skin: object, euler: int = 1) -> float:
    """Taxels that no triangle uses, and how far the mesh is from one sheet."""
    mesh = build_surface(skin)  # type: ignore[arg-type]
    return float((mesh.taxel_patches != 0).sum() + abs(euler_number(mesh.faces) - euler))


def without(modules: int) -> float:
    """Taxels that no triangle of the first patch uses."""
    skin = bent_skin(20, 20, keep=with_holes(modules))
    return float((build_surface(skin).taxel_patches != 0).sum())


def nan_at(row: int) -> np.ndarray:
    points = lattice()
    points[row, 1] = np.nan
    return points


SLIVER = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]])
FIN = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])

LAWS = [
    Law(
        "signed_areas",
        "scale",
        "areas grow with its square",
        areas,
        1e-12,
        "rounding",
        (1e-150, 1e-30, 1e-6, 1.0, 1e6, 1e30, 1e150),
        (
            Outside(
                1e-170,
                "areas of 0",
                lambda: f"areas of {signed_areas(1e-170 * FLAT, FACES).max():g}",
            ),
            Outside(1e160, RuntimeWarning, lambda: signed_areas(1e160 * FLAT, FACES), "overflow"),
        ),
    ),
    Law(
        "smallest_altitudes",
        "scale",
        "altitudes grow with it",
        altitudes,
        1e-12,
        "rounding",
        (1e-70, 1e-30, 1e-6, 1.0, 1e6, 1e30, 1e70),
        (
            Outside(
                1e-100,
                "altitudes of 0",
                lambda: f"altitudes of {smallest_altitudes(1e-100 * DOME, FACES).max():g}",
            ),
        ),
    ),
    Law(
        "face_normals",
        "offset",
        "normals stay",
        facing,
        1e-6,
        "1e8 leaves 1e-8 of edges of 0.1",
        (0.0, 1.0, 1e4, 1e8),
        unit="times the width",
    ),
    Law("path_distances", "scale", "paths grow with it", paths, 1e-12, "rounding", WIDE),
    Law(
        "rigid_fit", "scale", "a planted pose comes back", fitted, 1e-9, "rounding of 4 units", WIDE
    ),
    Law(
        "check_surface",
        "input",
        "an oriented manifold passes",
        lambda _: check_surface(FACES) or 0.0,
        0.0,
        "yes or no",
        ("a dome",),
        (Outside("an edge in three triangles", InvalidMeshError, lambda: check_surface(FIN)),),
    ),
    Law(
        "build_surface",
        "scale",
        "the same triangles",
        lambda s: triangles_differ(scale=s),
        0.0,
        "a choice among triangles",
        WIDE,
    ),
    Law(
        "build_surface",
        "offset",
        "the same triangles",
        lambda s: triangles_differ(offset=s),
        0.0,
        "a choice among triangles",
        (0.0, 1.0, 1e4, 1e6),
        unit="m",
    ),
    Law(
        "build_surface",
        "size",
        "all taxels in one sheet",
        lambda n: unmeshed(bent_skin(n, n)),
        0.0,
        "taxels and holes are counted",
        (2, 3, 12, 40),
        (
            Outside(
                "3 taxels at one place",
                InvalidMeshError,
                lambda: build_surface(skin_from_points(np.zeros((3, 3)), np.eye(3))),
                "distinct taxels",
            ),
        ),
        unit="rows and columns",
    ),
    Law(
        "build_surface",
        "noise",
        "all taxels in one sheet",
        lambda s: unmeshed(bent_skin(noise=s)),
        0.0,
        "taxels and holes are counted",
        (0.0, 0.02, 0.05, 0.1),
        unit="of the pitch",
    ),
    Law(
        "build_surface",
        "missing modules",
        "all others in one sheet",
        without,
        0.0,
        "taxels are counted",
        (0, 1, 3, 6),
    ),
    Law(
        "skin_from_points",
        "input",
        "finite places are taken",
        lambda n: float(len(bent_skin(n, 1)) - n),
        0.0,
        "counted",
        (1, 12, 144),
        (
            Outside(
                "NaN", InvalidArrayError, lambda: skin_from_points(nan_at(7), normals()), "row 7"
            ),
        ),
        "taxels",
    ),
]
