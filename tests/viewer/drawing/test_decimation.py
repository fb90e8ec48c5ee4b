import numpy as np

from skinmap.geometry.triangles import TriangleMesh
from viewer.drawing.body.bare_body import _used, cluster


def plate(n: int = 20, z: float = 0.0, flip: bool = False):
    """A square of 1 x 1 in n x n quads."""
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (k.ravel() for k in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])
    return points, faces[:, ::-1] if flip else faces


def test_cluster_keeps_a_plane_flat_and_covered():
    reduced = cluster(TriangleMesh(*plate()), 0.2)
    assert 0 < len(reduced.faces) < 200
    np.testing.assert_array_equal(reduced.vertices[:, 2], 0.0)
    np.testing.assert_allclose(reduced.normals, np.tile([0, 0, 1.0], (len(reduced.normals), 1)))
    a, b, c = (reduced.vertices[reduced.faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2
    assert (area > 0).all()
    # The border draws back by less than half a cell on each side.
    assert (1 - 0.2) ** 2 < area.sum() <= 1.0


def test_cluster_keeps_a_mesh_whose_cells_hold_one_vertex():
    points, faces = plate(8)
    reduced = cluster(TriangleMesh(points, faces), 1e-3)
    assert len(reduced.vertices) == len(points)
    assert len(reduced.faces) == len(faces)
    triangles = {tuple(sorted(map(tuple, t))) for t in np.round(points[faces], 9).tolist()}
    found = np.round(reduced.vertices[reduced.faces], 9).tolist()
    assert {tuple(sorted(map(tuple, t))) for t in found} == triangles


def test_cluster_does_not_mind_repeated_corners():
    points, faces = plate(8)
    torn = TriangleMesh(points[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    joined, parted = cluster(TriangleMesh(points, faces), 0.3), cluster(torn, 0.3)
    assert len(joined.faces) == len(parted.faces)
    np.testing.assert_allclose(joined.vertices, parted.vertices, atol=1e-12)


def test_cluster_keeps_both_walls_of_a_thin_cover_lit():
    low, high = plate(z=0.0, flip=True), plate(z=0.02)
    both = TriangleMesh(
        np.concatenate([low[0], high[0]]), np.concatenate([low[1], high[1] + len(low[0])])
    )
    reduced = cluster(both, 0.2)
    # Merged into one normal, the two would cancel and be drawn black.
    np.testing.assert_allclose(np.abs(reduced.normals[:, 2]), 1.0)
    assert set(np.sign(reduced.normals[:, 2])) == {-1.0, 1.0}


def test_cluster_keeps_a_right_angle_sharp():
    points, faces = plate()
    wall = points[:, [0, 2, 1]] * [1, -1, -1]
    corner = TriangleMesh(
        np.concatenate([points, wall]), np.concatenate([faces, faces + len(points)])
    )
    normals = cluster(corner, 0.2).normals
    straight = np.abs(normals).max(axis=1)
    # One normal for both sides would be (0, 0.7, 0.7); where a cell holds but a rim of one side, it
    # may follow the other side, and no further than the share of area that it has.
    assert straight.min() > 0.95
    assert (straight > 1 - 1e-9).mean() > 0.8


def test_cluster_takes_an_empty_mesh():
    empty = cluster(TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), 0.1)
    assert empty.vertices.shape == (0, 3)
    assert empty.faces.shape == (0, 3)


def test_numbers_in_use_are_those_of_unique(rng):
    numbers = rng.integers(0, 5000, (700, 3))
    found, inverse = _used(numbers)
    expected, places = np.unique(numbers, return_inverse=True)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(inverse, places.reshape(numbers.shape))
