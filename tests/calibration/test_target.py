"""The wrapped link: the same from metres and millimetres, and as far off the mesh as it should."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from calibration.patch.link_surface import OFFSET, make_target, rounded


def single(vertices, unit):
    """Vertices [m] once through a file of single floats in a unit."""
    return unit * (vertices / unit).astype(np.float32).astype(np.float64)


def bumpy(rng):
    ball = trimesh.creation.icosphere(3, radius=0.05)
    points = ball.vertices + rng.normal(0, 1e-3, ball.vertices.shape)
    return Rotation.random(rng=rng).apply(points * rng.uniform(0.7, 1.3, 3)) + rng.normal(0, 0.1, 3)


def test_rounded_vertices_do_not_depend_on_the_unit_of_the_file(icub):
    rng = np.random.default_rng(0)
    links = [icub.mesh(icub.skin(part).link).vertices for part in icub.parts]
    decimals = [np.round(bumpy(rng), 6) for _ in range(20)]  # CAD files hold round numbers
    meshes = [*links, *decimals, *(bumpy(rng) for _ in range(40))]
    assert len(meshes) > 60
    for vertices in meshes:
        metres, millimetres = single(vertices, 1.0), single(vertices, 1e-3)
        pairs = {
            "double floats": (vertices, 1e-3 * (1e3 * vertices)),
            "mm made from m": (metres, single(metres, 1e-3)),
            "m made from mm": (single(millimetres, 1.0), millimetres),
        }
        for name, (one, other) in pairs.items():
            np.testing.assert_array_equal(rounded(one), rounded(other), err_msg=name)


def test_target_stands_its_offset_off_a_ball():
    ball = trimesh.creation.icosphere(4, radius=0.05)
    target = make_target(np.asarray(ball.vertices), np.asarray(ball.faces, np.int64))
    _, distance, _ = trimesh.proximity.closest_point(ball, target.vertices)
    # The wrap's own facets stand off by twice the offset and more; those below are drawn to it.
    assert np.median(np.abs(distance - OFFSET)) < 0.01e-3
    assert distance.max() < 3.0 * OFFSET


@pytest.mark.parametrize("scale", [1e-9, 1e-3])
def test_target_follows_a_vertex_by_as_much_as_it_moves(scale):
    ball = trimesh.creation.icosphere(3, radius=0.05)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces, np.int64)
    # Bits that a file drops, or a move within the steps of the rounding: no other triangles.
    moved = vertices * (1.0 + scale * 1e-3)
    if not np.array_equal(rounded(vertices), rounded(moved)):
        pytest.fail("this ball lies on a step of the rounding: choose another")
    one, other = make_target(vertices, faces), make_target(moved, faces)
    np.testing.assert_array_equal(one.faces, other.faces)
    apart = np.linalg.norm(other.vertices - one.vertices, axis=1).max()
    assert apart <= 0.052 * scale * 1e-3 + 1e-8  # single floats are kept to 4e-9 m
