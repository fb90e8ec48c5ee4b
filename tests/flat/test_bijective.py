"""Maps that are one to one as a whole: ramps that would lie over themselves."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from skinmap.errors import SkinWarning
from skinmap.flat.dirichlet import energy_and_gradient, locally_injective_map
from skinmap.flat.disc import Disc
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.methods import Barrier, bijective_map, flatten_disc
from skinmap.geometry.topology import boundary_loops


def ramp(turns, along=80, across=8):
    """A strip that winds up round an axis: laid flat without strain it would lie over itself."""
    i, j = (g.ravel() for g in np.meshgrid(np.arange(along), np.arange(across), indexing="ij"))
    angle, radius = 2 * np.pi * turns * i / (along - 1), 0.5 + 0.5 * j / (across - 1)
    height = 0.3 * turns * i / (along - 1)
    a = (np.arange(along - 1)[:, None] * across + np.arange(across - 1)).ravel()
    lower = np.column_stack([a, a + across + 1, a + across])
    upper = np.column_stack([a, a + 1, a + across + 1])
    vertices = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    return vertices, np.concatenate([lower, upper])


def covered(uv, faces):
    """Area of the union of the triangles over the sum of their areas: below 1 with an overlap."""
    triangles = shapely.polygons(uv[faces])
    return shapely.union_all(triangles).area / shapely.area(triangles).sum()


@pytest.mark.parametrize("turns", [1.3, 2.5])
def test_a_map_that_would_overlap_is_mended(turns):
    vertices, faces = ramp(turns)
    disc = Disc(vertices, faces, boundary_loops(faces)[0])
    plain = locally_injective_map(disc)
    assert disc.is_injective(plain)
    assert disc.overlaps(plain)
    assert covered(plain, faces) < 0.95
    with pytest.warns(SkinWarning, match="balanced overlaps itself, bijective is used"):
        uv, method, _ = flatten_disc(vertices, faces)
    assert method == "bijective"
    assert covered(uv, faces) == pytest.approx(1.0, abs=1e-9)
    # Tutte's map, the only other that never overlaps, has edges off by half.
    assert measure_distortion(vertices, faces, uv).edge_rms < 0.1


def test_a_map_that_does_not_overlap_is_left_alone():
    vertices, faces = ramp(0.9)
    uv, method, _ = flatten_disc(vertices, faces)
    assert method == "balanced"
    assert covered(uv, faces) == pytest.approx(1.0, abs=1e-9)


def test_a_flat_ring_whose_seam_closes_again_is_left_alone():
    for turns, simple, over in ((0.99, True, False), (1.0, False, False), (1.02, False, True)):
        points, faces = ramp(turns)
        uv = points[:, :2].copy()
        if turns == 1.0:
            uv[-8:] = uv[:8]  # without rounding
        disc = Disc(points, faces, boundary_loops(faces)[0])
        assert (disc.is_border_simple(uv), disc.overlaps(uv)) == (simple, over)


def test_where_nothing_meets_the_barrier_changes_nothing():
    vertices, faces = ramp(0.5)
    disc = Disc(vertices, faces, boundary_loops(faces)[0])
    free, bounded = locally_injective_map(disc), bijective_map(disc)
    assert energy_and_gradient(disc, bounded)[0] == pytest.approx(
        energy_and_gradient(disc, free)[0], rel=1e-3
    )


def test_the_gradient_of_the_barrier_is_that_of_its_energy(rng):
    vertices, faces = ramp(0.97)
    disc = Disc(vertices, faces, boundary_loops(faces)[0])
    barrier = Barrier(disc)
    uv = locally_injective_map(disc)
    # Both ends brought close to each other, well within the clearance.
    gap = uv[:8].mean(axis=0) - uv[-8:].mean(axis=0)
    while barrier(uv)[0] == 0.0:
        uv[-40:] += 0.02 * gap * (np.arange(40)[:, None] // 8 / 4.0)
    energy, gradient = barrier(uv)
    assert 0.0 < energy < np.inf
    step = rng.normal(size=uv.shape)
    small = 1e-7
    slope = (barrier(uv + small * step)[0] - barrier(uv - small * step)[0]) / (2 * small)
    assert slope == pytest.approx(float((gradient * step).sum()), rel=1e-4)
