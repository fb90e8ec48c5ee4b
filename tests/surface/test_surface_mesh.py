from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinmap.errors import InvalidMeshError, SkinWarning
from skinmap.geometry.topology import boundary_loops, check_surface, euler_number
from skinmap.geometry.triangles import face_areas, face_normals
from skinmap.skin.skin import skin_from_points
from skinmap.surface.consensus_meshing import close_loop, consensus, fill_holes, without_pinches
from skinmap.surface.surface_mesh import build_surface


def board(points: np.ndarray):
    """A skin of points in the plane, normals up."""
    flat = np.column_stack([points, np.zeros(len(points))]) if points.shape[1] == 2 else points
    return skin_from_points(flat, np.tile([0.0, 0, 1], (len(flat), 1)))


def canonical(faces: np.ndarray) -> set[tuple[int, ...]]:
    start = np.argmin(faces, axis=1)
    rolled = np.take_along_axis(faces, (start[:, None] + np.arange(3)) % 3, axis=1)
    return set(map(tuple, rolled.tolist()))


def test_build_surface_in_the_plane_is_the_delaunay_triangulation(rng):
    from scipy.spatial import Delaunay

    points = rng.uniform(size=(150, 2))
    mesh = build_surface(board(points), max_edge=10.0)
    expected = Delaunay(points).simplices
    # 20 neighbours do not see the long thin triangles of the hull: compare those well inside.
    inside = ((points > 0.15) & (points < 0.85)).all(axis=1)
    theirs = {f for f in canonical(expected) if inside[list(f)].all()}
    ours = {f for f in canonical(mesh.faces) if inside[list(f)].all()}
    assert len(theirs) > 80
    assert ours == theirs


def test_build_surface_of_a_square_grid_has_no_holes():
    # Every cell is co-circular: without a jitter the stars disagree and the mesh collapses.
    row, column = np.divmod(np.arange(400), 20)
    mesh = build_surface(board(np.column_stack([column, row]).astype(float)))
    assert len(mesh.faces) == 2 * 19 * 19
    assert euler_number(mesh.faces) == 1


def test_build_surface_of_a_bent_square_grid_has_no_holes():
    angle, height = np.meshgrid(np.linspace(0, 2, 24), np.linspace(0, 2, 24))
    points = np.stack([np.cos(angle), np.sin(angle), height], -1).reshape(-1, 3)
    normals = points * [1, 1, 0]
    mesh = build_surface(skin_from_points(points, normals))
    assert len(mesh.faces) == 2 * 23 * 23
    assert euler_number(mesh.faces) == 1


def test_build_surface_of_a_sphere_is_closed(sphere):
    vertices, faces = sphere
    mesh = build_surface(skin_from_points(vertices, vertices))
    assert euler_number(mesh.faces) == 2
    assert boundary_loops(mesh.faces) == []
    assert canonical(mesh.faces) == canonical(faces)


def test_build_surface_faces_turn_with_the_normals(sphere):
    vertices, _ = sphere
    mesh = build_surface(skin_from_points(vertices, vertices))
    middle = vertices[mesh.faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", face_normals(vertices, mesh.faces), middle) > 0).all()


def dense_beside_coarse(gap: float) -> np.ndarray:
    """Taxels 2.5 mm apart, and after a gap [m] others 10 mm apart."""
    grid = np.stack(np.meshgrid(np.arange(21), np.arange(17)), -1).reshape(-1, 2) * 2.5e-3
    wide = np.stack(np.meshgrid(np.arange(6), np.arange(5)), -1).reshape(-1, 2) * 1e-2
    return np.concatenate([grid, wide + [50e-3 + gap, 0.0]])


@pytest.mark.parametrize("method", ["consensus", "fast"])
def test_a_coarser_area_belongs_to_the_sheet_and_a_gap_stays_one(method):
    joined = build_surface(board(dense_beside_coarse(8e-3)), method=method)
    assert joined.n_patches == 1
    assert joined.left_out() == ""
    assert joined.taxel_areas.sum() == pytest.approx(0.108 * 0.04)
    apart = build_surface(board(dense_beside_coarse(20e-3)), method=method)
    np.testing.assert_array_equal(apart.taxel_patches, np.repeat([0, 1], [21 * 17, 30]))


def test_stray_taxels_make_no_coarse_area_and_are_named(hexagons):
    alone = build_surface(board(hexagons))
    strays = hexagons.max(axis=0) + 6 * alone.skin.spacing * np.array([[1, 1], [1, 3], [3, 1]])
    with_strays = build_surface(board(np.concatenate([hexagons, strays])))
    np.testing.assert_array_equal(with_strays.faces, alone.faces)
    n = len(hexagons)
    assert f"3 taxels are in no triangle: channels {n}, {n + 1}, {n + 2}" in with_strays.left_out()


def test_build_surface_keeps_patches_apart_and_numbers_them_by_size(hexagons):
    small = hexagons[:40] + [0.0, -0.2]
    mesh = build_surface(board(np.concatenate([small, hexagons])))
    assert mesh.n_patches == 2
    np.testing.assert_array_equal(mesh.taxel_patches, np.repeat([1, 0], [40, len(hexagons)]))


def test_build_surface_keeps_a_real_hole(hexagons):
    middle = hexagons.mean(axis=0)
    ring = hexagons[np.linalg.norm(hexagons - middle, axis=1) > 0.017]
    assert euler_number(build_surface(board(ring)).faces) == 0


def test_build_surface_merges_coincident_taxels(hexagons):
    doubled = np.concatenate([hexagons, hexagons[[3, 70]] + 1e-6])
    mesh = build_surface(board(doubled))
    np.testing.assert_array_equal(mesh.representative[-2:], [3, 70])
    assert (mesh.taxel_patches == 0).all()
    # Both share one vertex's area, so that no area counts twice.
    assert mesh.taxel_areas.sum() == pytest.approx(
        face_areas(mesh.vertices, mesh.faces).sum(), rel=1e-12
    )


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]),
    shift=st.sampled_from([0.0, 1e3]),
)
def test_build_surface_is_manifold_and_free_of_scale_and_order(seed, scale, shift):
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(60, 3)) * [1, 1, 0.05]
    mesh = build_surface(board(points))
    check_surface(mesh.faces)
    boundary_loops(mesh.faces)
    order = rng.permutation(60)
    moved = build_surface(board((points[order] + shift) * scale))
    assert len(moved.faces) == pytest.approx(len(mesh.faces), abs=3)
    check_surface(moved.faces)


def test_icub_is_meshed_whole(prepared, icub):
    patches, used = 0, 0
    for part in icub.parts:
        mesh = prepared(part).mesh
        patches += mesh.n_patches
        used += int((mesh.taxel_patches >= 0).sum())
        holes = [len(boundary_loops(mesh.patch_faces(k))) - 1 for k in range(mesh.n_patches)]
        assert sum(holes) == (1 if part == "torso" else 0), part
    assert (used, patches) == (4326, 23)


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.repeat([[0, 0], [1.0, 1]], 2, axis=0)])
def test_build_surface_refuses_fewer_than_three_points(points):
    with pytest.raises(InvalidMeshError, match=r"\d distinct taxels"):
        build_surface(board(points))


def test_a_row_of_taxels_has_no_faces():
    mesh = build_surface(board(np.column_stack([np.arange(9.0), np.zeros(9)])))
    assert (len(mesh.vertices), len(mesh.faces)) == (9, 0)


def test_consensus_drops_slivers():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1e-3, 0]])
    assert len(consensus(points, np.eye(3)[[2, 2, 2]], np.array([[0, 1, 2]]), 0.02)) == 0


def test_consensus_takes_more_votes_before_shorter_edges():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1.2, 0], [0, 1, 0]])
    one, other = [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]
    faces = consensus(square, np.eye(3)[[2, 2, 2, 2]], np.array(one + one + other), 0.02)
    assert canonical(faces) == canonical(np.array(one))


def test_without_pinches_keeps_the_larger_fan():
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 5]])
    np.testing.assert_array_equal(without_pinches(faces), faces[:2])


def test_close_loop_of_a_square_hole_matches_its_area(square_grid):
    vertices, faces = square_grid(6)
    middle = np.linalg.norm(vertices[faces].mean(axis=1) - [0.5, 0.5, 0], axis=1)
    open_faces = faces[middle > 0.15]
    up = np.tile([0.0, 0, 1], (len(vertices), 1))
    filled = fill_holes(vertices, up, open_faces)
    assert face_areas(vertices, filled).sum() == pytest.approx(1.0, rel=1e-12)
    assert euler_number(filled) == 1
    check_surface(filled)


def test_close_loop_of_a_concave_hole_stays_inside():
    # An L-shaped hole: an ear cut across the corner would cover what is not hole.
    corners = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)
    points = np.column_stack([corners, np.zeros(6)])
    up = np.tile([0.0, 0, 1], (6, 1))
    faces = close_loop(points, up, np.arange(6)[::-1])
    assert face_areas(points, faces).sum() == pytest.approx(3.0, rel=1e-12)
    assert (face_normals(points, faces)[:, 2] > 0).all()


def test_faces_that_are_inside_out_are_turned(rng):
    foot = board(rng.uniform(size=(60, 2)))
    mesh = build_surface(foot)
    with pytest.warns(SkinWarning, match="inside out in patch 0"):
        turned = build_surface(foot, faces=mesh.faces[:, ::-1])
    a, b, c = np.moveaxis(foot.positions[turned.faces], 1, 0)
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), foot.normals[turned.faces[:, 0]])
    assert (outward > 0).mean() > 0.99
