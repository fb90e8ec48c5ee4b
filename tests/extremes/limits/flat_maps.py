"""Laws of flat maps, geodesics and structures."""

from __future__ import annotations

from functools import cache

import numpy as np

from skinmap.errors import FlatteningError, InvalidArrayError
from skinmap.flat.costs import geodesic_stress
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.flat_map import flatten_disc
from skinmap.io.robots.manifest import load_robot
from skinmap.neighbours.offsets import auto_radius, geodesic_neighbourhoods, neighbourhoods
from skinmap.neighbours.structures import find_structures
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.surface.surface_mesh import build_surface

from .law import Law, Outside
from .shapes import PITCH, dome, lattice

METHODS = ("tutte", "harmonic", "lscm", "bff", "balanced", "fast", "accurate", "dirichlet", "auto")
DOME, FACES = dome()
FLAT = DOME[:, :2]


def map_of(method: str, scale: float = 1.0, offset: float = 0.0, n: int = 9) -> float:
    """Change of the edge error, and flips, of a dome at another size or place."""
    points, faces = dome(n)
    plain, _, _ = flatten_disc(points, faces, method=method)
    moved = scale * points + offset
    uv, _, _ = flatten_disc(moved, faces, method=method)
    one, other = measure_distortion(points, faces, plain), measure_distortion(moved, faces, uv)
    return float(abs(one.edge_rms - other.edge_rms) + other.flips)


def straight(scale: float) -> float:
    """Stress of a flat grid laid as it is."""
    flat = np.column_stack([FLAT, 0 * FLAT[:, 0]])
    rng = np.random.default_rng(0)
    return geodesic_stress(scale * flat, FACES, scale * FLAT, rng=rng).value


def shapes_found(points: np.ndarray, scale: float = 1.0, **how: float) -> int:
    up, north = np.tile([0.0, 0, 1], (len(points), 1)), np.tile([0.0, 1, 0], (len(points), 1))
    hoods = neighbourhoods(points, up, north, radius=8e-3 * scale, band=1e-3 * scale)
    return len(
        find_structures(hoods, **{"tolerance": 2e-3 * scale, "rotations": 6, **how}).prototypes
    )


def flat_lattice() -> np.ndarray:
    row, column = np.divmod(np.arange(144), 12)
    flat = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)])
    return np.column_stack([flat, 0 * flat[:, 0]])


def structures(scale: float) -> float:
    return float(abs(shapes_found(scale * flat_lattice(), scale) - shapes_found(flat_lattice())))


def structures_in_noise(share: float) -> float:
    """Structures beside those of the undisturbed lattice; noise is a share of the pitch."""
    points = flat_lattice()
    points[:, :2] += share * PITCH * np.random.default_rng(0).normal(size=(144, 2))
    return float(abs(shapes_found(points) - shapes_found(flat_lattice())))


def without_structure(radius_mm: float = 8.8, noise_mm: float = 0.0) -> float:
    """Taxels of a sheet of 12-pad boards, on a bent plate, that have no structure."""
    points = hand().positions + 1e-3 * noise_mm * np.random.default_rng(0).normal(size=(144, 3))
    directions = np.tile([0.0, 1.0, 0.0], (144, 1))
    hoods = neighbourhoods(points, hand().normals, directions, radius=1e-3 * radius_mm)
    return float(np.count_nonzero(find_structures(hoods, rotations=1).labels < 0))


@cache
def hand() -> Skin:
    return load_robot("kaspar").skin("right_hand")


def around(scale: float) -> float:
    """Geodesic against straight neighbours on flat skin."""
    points = scale * flat_lattice()
    up, north = np.tile([0.0, 0, 1], (144, 1)), np.tile([0.0, 1, 0], (144, 1))
    mesh = build_surface(skin_from_points(points, up))
    how = {"radius": 8e-3 * scale, "band": 1e-3 * scale}
    one, other = (
        neighbourhoods(points, up, north, **how),
        geodesic_neighbourhoods(mesh, north, **how),
    )
    if one.index.shape != other.index.shape:
        return float("inf")

    def far(hoods):
        return np.sort(np.linalg.norm(hoods.offsets, axis=2), axis=1)

    return float(np.abs(far(one) - far(other)).max() / scale / PITCH)


SLIVER = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]])

LAWS = [
    *(
        Law(
            f"flatten_disc, {m}",
            "scale",
            "the same edge error, no flip",
            lambda s, m=m: map_of(m, scale=s),
            1e-6,
            "steps of solvers end at 1e-9",
            (1e-30, 1e-6, 1e6, 1e30),
        )
        for m in METHODS
    ),
    *(
        Law(
            f"flatten_disc, {m}",
            "offset",
            "the same edge error, no flip",
            lambda s, m=m: map_of(m, offset=s),
            1e-6,
            "1e8 leaves eight digits",
            (1.0, 1e4, 1e8),
            unit="times the width",
        )
        for m in METHODS
    ),
    Law(
        "flatten_disc",
        "size",
        "no flip",
        lambda n: map_of("balanced", n=n),
        1e-9,
        "the same map",
        (2, 3, 9, 60),
        (
            Outside(
                "a triangle without area",
                FlatteningError,
                lambda: flatten_disc(SLIVER, np.array([[0, 1, 2], [0, 2, 3]])),
            ),
            Outside(
                "no triangle", FlatteningError, lambda: flatten_disc(DOME, FACES[:0]), "no faces"
            ),
        ),
        unit="rows and columns",
    ),
    Law(
        "measure_distortion",
        "scale",
        "an isometry has no error",
        lambda s: (
            measure_distortion(np.column_stack([FLAT, 0 * FLAT[:, 0]]), FACES, s * FLAT).edge_rms
        ),
        1e-9,
        "rounding",
        (1e-30, 1e-6, 1.0, 1e6, 1e30),
    ),
    Law(
        "geodesic_stress",
        "scale",
        "an isometry has none",
        straight,
        1e-6,
        "the exact search has tolerances",
        (1e-6, 1e-3, 1.0, 1e3, 1e6),
    ),
    Law(
        "find_structures",
        "scale",
        "as many structures",
        structures,
        0.0,
        "counted",
        (1e-6, 1e-3, 1.0, 1e3, 1e6),
    ),
    Law(
        "find_structures",
        "noise",
        "as many structures",
        structures_in_noise,
        0.0,
        "counted",
        (0.0, 0.01, 0.03),
        (
            Outside(
                "a tolerance of 0",
                InvalidArrayError,
                lambda: shapes_found(flat_lattice(), tolerance=0.0),
                "tolerance must be",
            ),
        ),
        unit="of the pitch",
    ),
    Law(
        "find_structures",
        "radius",
        "taxels without a structure",
        without_structure,
        0.0,
        "counted",
        (0.1, 2.0, 5.0, 8.0, 8.8, 15.0, 30.0, 100.0, 1000.0),
        unit="mm",
    ),
    Law(
        "find_structures",
        "noise",
        "taxels without a structure",
        lambda sigma: without_structure(noise_mm=sigma),
        0.0,
        "counted",
        (0.0, 0.25, 0.5, 1.0, 2.0),
        unit="mm",
    ),
    Law(
        "geodesic_neighbourhoods",
        "scale",
        "on flat skin those of straight lines",
        around,
        1e-9,
        "the exact search has tolerances",
        (1e-3, 1.0, 1e3),
    ),
    Law(
        "auto_radius",
        "scale",
        "it grows with it",
        lambda s: (
            abs(
                auto_radius([s * flat_lattice()], near=8e-3 * s, band=1e-3 * s) / s
                - auto_radius([flat_lattice()], near=8e-3, band=1e-3)
            )
            / PITCH
        ),
        1e-9,
        "rounding",
        (1e-6, 1.0, 1e6),
        (Outside(0, InvalidArrayError, lambda: auto_radius([lattice()], near=0.0)),),
    ),
]
