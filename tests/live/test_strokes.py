from __future__ import annotations

import numpy as np
import pytest
import trimesh

from skinmap.geometry.point_surface import SurfaceWalker
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.live.contacts.sample_contacts import POINTS, STEP, Stroke


def length(way):
    return np.linalg.norm(np.diff(way, axis=0), axis=1).sum()


def place(mesh, point):
    """Nearest point of a mesh and its triangle."""
    vertices, faces = mesh
    _, face, foot = closest_on_mesh(np.asarray(point, float)[None], vertices, faces)
    return foot[0], int(face[0])


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=4)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def test_path_on_a_sphere_is_the_great_circle(ball, rng):
    walker = SurfaceWalker(*ball)
    for _ in range(20):
        a, b = rng.normal(size=(2, 3))
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        angle = np.arccos(np.clip(a @ b, -1.0, 1.0))
        if angle > 1.5:  # the plane through both points and the mean normal is meant for steps
            continue
        start, end = place(ball, a), place(ball, b)
        way = walker.path(*start, *end)
        np.testing.assert_array_equal(way[0], start[0])
        np.testing.assert_array_equal(way[-1], end[0])
        # Chords of facets of 0.07: shorter than arcs by angle^2 / 24, 2e-4, and within a facet's
        # height of 1e-3 of the sphere.
        np.testing.assert_allclose(length(way), angle, rtol=2e-3)
        gap, _, _ = closest_on_mesh(way, *ball)
        assert gap.max() < 1e-12


def test_path_on_a_plane_is_the_straight_line(square_grid, rng):
    grid = square_grid(12)
    walker = SurfaceWalker(*grid)
    for _ in range(20):
        a, b = np.column_stack([rng.random((2, 2)), np.zeros(2)])
        way = walker.path(*place(grid, a), *place(grid, b))
        np.testing.assert_allclose(length(way), np.linalg.norm(a - b), rtol=1e-9)


def test_path_goes_round_a_hole(square_grid):
    vertices, faces = square_grid(11)
    middle = vertices[faces].mean(axis=1)
    wall = (np.abs(middle[:, 0] - 0.5) < 0.1) & (middle[:, 1] < 0.8)
    mesh = vertices, faces[~wall]
    way = SurfaceWalker(*mesh).path(*place(mesh, [0.2, 0.2, 0]), *place(mesh, [0.8, 0.2, 0]))
    gap, _, _ = closest_on_mesh(way, *mesh)
    assert gap.max() < 1e-9
    # Never shorter than the straight ways round the two upper corners of the hole.
    assert length(way) >= 2 * np.hypot(0.2, 0.6) + 0.2


def test_path_between_sheets_is_straight(square_grid):
    vertices, faces = square_grid(3)
    both = np.concatenate([vertices, vertices + [5.0, 0, 0]]), np.concatenate([faces, faces + 9])
    a, b = place(both, [0.5, 0.4, 0]), place(both, [5.5, 0.4, 0])
    np.testing.assert_array_equal(SurfaceWalker(*both).path(*a, *b), [a[0], b[0]])


def test_stroke_adds_up_its_steps_and_forgets_only_points(square_grid):
    vertices, faces = square_grid(5)
    mesh = 0.1 * vertices, faces
    at = [0.02, 0.03, 0.0]
    stroke = Stroke(SurfaceWalker(*mesh), *place(mesh, at))
    assert not stroke.add(*place(mesh, [0.02 + 0.9 * STEP, 0.03, 0.0]))
    assert stroke.length == 0.0
    for turn in range(1, 4 * POINTS):
        x = 0.02 + 1.5 * STEP * (turn % 2)
        assert stroke.add(*place(mesh, [x, 0.03, 0.0]))
    assert stroke.length == pytest.approx((4 * POINTS - 1) * 1.5 * STEP)
    assert len(stroke.points) <= POINTS
