"""What the meshing methods share, where they differ, and triangles of the user's own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skinmap.errors import InvalidArrayError, InvalidMeshError, UnknownNameError
from skinmap.geometry.topology import boundary_loops, check_surface, euler_number
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.skin import skin_from_points
from skinmap.surface.accurate import is_closed
from skinmap.surface.consensus_meshing import close_loop, take_in_turn
from skinmap.surface.surface_mesh import MESHING, build_surface
from skinmap.surface.taxel_cloud import NEIGHBOURS, Cloud, delaunay_stars


def canonical(faces: np.ndarray) -> set[tuple[int, ...]]:
    start = np.argmin(faces, axis=1)
    rolled = np.take_along_axis(faces, (start[:, None] + np.arange(3)) % 3, axis=1)
    return set(map(tuple, rolled.tolist()))


def wavy(n: int, rng: np.random.Generator):
    """A hexagonal lattice of n points on a wave, each off its place: no four on one circle."""
    side = int(np.sqrt(n))
    row, column = np.divmod(np.arange(side * side), side)
    x, y = column + 0.5 * (row % 2), row * np.sqrt(3) / 2
    points = np.column_stack([x, y, np.sin(0.4 * x)]) + rng.uniform(-0.12, 0.12, (len(x), 3))
    normals = np.column_stack([-0.4 * np.cos(0.4 * x), 0 * x, 1 + 0 * x])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def holes(mesh) -> int:
    return sum(len(boundary_loops(mesh.patch_faces(k))) - 1 for k in range(mesh.n_patches))


def test_fast_meshes_the_icub_whole_without_spurious_holes(icub):
    meshes = {part: build_surface(icub.skin(part), method="fast") for part in icub.parts}
    assert sum(int((mesh.taxel_patches >= 0).sum()) for mesh in meshes.values()) == 4326
    assert sum(mesh.n_patches for mesh in meshes.values()) == 23
    assert {part: holes(mesh) for part, mesh in meshes.items() if holes(mesh)} == {"torso": 1}


@pytest.mark.parametrize("part", ["left_arm", "left_forearm", "left_foot", "right_hand"])
def test_accurate_meshes_parts_of_the_icub_whole(icub, prepared, part):
    # All 13 take 10 s.
    skin = icub.skin(part)
    mesh = build_surface(skin, method="accurate", body=icub.mesh(skin.link))
    assert (mesh.taxel_patches >= 0).all()
    assert (mesh.n_patches, holes(mesh)) == (prepared(part).mesh.n_patches, 0)


def test_fast_agrees_with_consensus_on_tilings(tiling_12, hexagons):
    lattice = np.column_stack([hexagons, np.zeros(len(hexagons))])
    for points in (tiling_12, lattice):
        skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
        fast, usual = (build_surface(skin, method=name) for name in ("fast", "consensus"))
        assert len(fast.faces) == len(usual.faces)
        assert euler_number(fast.faces) == euler_number(usual.faces)
    assert canonical(fast.faces) == canonical(usual.faces)


@pytest.mark.parametrize("method", ["consensus", "fast"])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_renumbering_changes_no_triangle(method, seed):
    rng = np.random.default_rng(seed)
    # A square grid too, where only an order that is the points' own settles the diagonals.
    for points, normals in (wavy(100, rng), squares(8)):
        order = rng.permutation(len(points))
        one = build_surface(skin_from_points(points, normals), method=method)
        other = build_surface(skin_from_points(points[order], normals[order]), method=method)
        assert canonical(order[other.faces]) == canonical(one.faces)


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (1e6, 0.0), (1.0, 1e4), (1e-2, 30.0)])
def test_rotation_scale_and_offset_change_no_triangle(method, scale, offset, rng):
    points, normals = wavy(150, rng)
    turn = Rotation.random(rng=rng).as_matrix()
    moved = scale * points @ turn.T + offset
    one = build_surface(skin_from_points(points, normals), method=method, body=sheet(points))
    other = build_surface(
        skin_from_points(moved, normals @ turn.T), method=method, body=sheet(points, moved)
    )
    # The wrap is laid out along the axes of the frame, so diagonals that are close calls, at
    # most one in fifty, may fall otherwise. By the taxels alone none does.
    changed = len(canonical(one.faces) ^ canonical(other.faces))
    assert changed <= (len(one.faces) // 25 if method == "accurate" else 0)
    assert euler_number(other.faces) == 1


def squares(n: int):
    row, column = np.divmod(np.arange(n * n), n)
    points = np.column_stack([column, row, 0 * row]).astype(float)
    return points, np.tile([0.0, 0, 1], (n * n, 1))


def sheet(points: np.ndarray, moved: np.ndarray | None = None):
    """A body through the points of `wavy`: their Delaunay triangulation from above."""
    from scipy.spatial import Delaunay

    return (points if moved is None else moved), Delaunay(points[:, :2]).simplices.astype(np.int64)


def test_two_sides_of_a_thin_plate_are_never_joined():
    import trimesh

    n, thick = 8, 0.2
    row, column = np.divmod(np.arange(n * n), n)
    flat = np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(3) / 2, 0.0 * row])
    points = np.concatenate([flat + [0, 0, thick / 2], flat + [0.3, 0.2, -thick / 2]])
    normals = np.repeat([[0.0, 0, 1], [0, 0, -1]], n * n, axis=0)
    box = trimesh.creation.box(bounds=[[-1, -1, -thick / 2], [n + 1, n, thick / 2]])
    for method in MESHING:
        mesh = build_surface(
            skin_from_points(points, normals), method=method, body=(box.vertices, box.faces)
        )
        assert mesh.n_patches == 2
        # Two triangles a cell, and the notches of the zigzag at both ends of the rows.
        assert len(mesh.faces) == 2 * (2 * (n - 1) ** 2 + 2 * ((n - 2) // 2))
        side = np.arange(2 * n * n) // (n * n)
        assert (side[mesh.faces] == side[mesh.faces[:, :1]]).all()


def test_accurate_does_not_bridge_a_gap_that_the_stars_would():
    # A shelf that overhangs a floor: seen from above the rows are neighbours, but along the
    # body the way from one to the other goes in under the shelf and out again.
    n = 8
    row, column = np.divmod(np.arange(n * n), n)
    floor = np.column_stack([column, row, 0 * row]).astype(float)
    points = np.concatenate([floor, floor + [n, 0, 1.0]])
    skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
    side = np.arange(2 * n * n) // (n * n)
    joined = build_surface(skin).faces
    apart = build_surface(skin, method="accurate", body=shelf(n)).faces
    assert (side[joined] != side[joined[:, :1]]).any()
    assert (side[apart] == side[apart[:, :1]]).all()
    assert len(apart) == 2 * 2 * (n - 1) ** 2


def shelf(n: int) -> TriangleMesh:
    """A closed prism: floor at height 0 up to x = n + 2, shelf at height 1 from x = n - 0.5."""
    outline = [(-1, -1), (2 * n, -1), (2 * n, 1), (n - 0.5, 1), (n - 0.5, 0.6), (n + 2, 0.6),
               (n + 2, 0), (-1, 0)]  # fmt: skip
    k = len(outline)
    front = np.array([[x, -1.0, z] for x, z in outline])
    vertices = np.concatenate([front, front + [0, n + 1.0, 0]])
    here, after = np.arange(k), np.roll(np.arange(k), -1)
    lower = np.column_stack([here, after + k, after])
    upper = np.column_stack([here, here + k, after + k])
    towards = np.tile([0.0, -1, 0], (2 * k, 1))
    caps = [close_loop(vertices, towards, here[::-1]), close_loop(vertices, -towards, here + k)]
    body = TriangleMesh(vertices, np.concatenate([lower, upper, *caps]))
    assert is_closed(body)
    return body


def test_stars_of_few_neighbours_first_are_those_of_all_at_once(rng):
    from skinmap.surface import taxel_cloud as stars

    points, normals = wavy(200, rng)
    both = []
    for first in (stars.FIRST, NEIGHBOURS, 2):  # two settle no star: each goes the long way
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(stars, "FIRST", first)
            cloud = Cloud(points, normals)
            both.append(delaunay_stars(cloud, np.full(len(points), 2.5 / cloud.unit)))
    assert canonical(both[0]) == canonical(both[1]) == canonical(both[2])
    assert len(both[0]) == len(both[1]) == len(both[2])


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(*[st.integers(0, 12)] * 3), max_size=40))
def test_take_in_turn_is_one_after_the_other(rows):
    numbers = np.array(rows, np.int64).reshape(-1, 3)
    free, expected = set(range(13)), []
    for row in rows:
        expected.append(all(edge in free for edge in row))
        if expected[-1]:
            free -= set(row)
    np.testing.assert_array_equal(take_in_turn(numbers), np.array(expected, bool))


def test_limits_follow_the_spacing_and_can_be_set(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
    with pytest.raises(InvalidMeshError, match=r"within 0\.006 m"):
        build_surface(skin, max_edge=6e-3)  # below the pitch
    beside = np.concatenate([points, points[5:6] + [1e-3, 0, 0]])
    both = skin_from_points(beside, np.tile([0.0, 0, 1], (len(beside), 1)))
    assert build_surface(both).representative[-1] == len(points)
    assert build_surface(both, merge=2e-3).representative[-1] == 5
    with pytest.raises(InvalidMeshError, match="in a row"):
        build_surface(skin, least_altitude=0.01)
    with pytest.raises(InvalidArrayError, match="max_edge must be a length"):
        build_surface(skin, max_edge=-1.0)
    with pytest.raises(InvalidArrayError, match=r"max_edge of 12 m.*in millimetres"):
        build_surface(skin, max_edge=12.0)


def test_largest_hole_says_what_is_closed(hexagons):
    gap = np.linalg.norm(hexagons - hexagons.mean(axis=0), axis=1) > 0.017
    points = np.column_stack([hexagons[gap], np.zeros(gap.sum())])
    skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
    assert euler_number(build_surface(skin).faces) == 0
    assert euler_number(build_surface(skin, largest_hole=30).faces) == 1


def test_faces_of_the_users_own_are_taken_as_they_are(square_grid):
    vertices, faces = square_grid(4)
    two = np.concatenate([vertices, vertices + [2.0, 0, 0]])
    skin = skin_from_points(two, np.tile([0.0, 0, 1], (32, 1)))
    mesh = build_surface(skin, faces=np.concatenate([faces[[0, 9]] + 16, faces]))
    assert mesh.n_patches == 2
    np.testing.assert_array_equal(mesh.face_patches, np.repeat([1, 0], [2, len(faces)]))
    assert (mesh.taxel_patches == -1).sum() > 0  # taxels that no face uses


@pytest.mark.parametrize(("faces", "message"), [
    (np.zeros((0, 3), int), "no faces"),
    ([[0, 1, 2], [0, 1, 3]], "opposite ways"),
    ([[0, 1, 2], [1, 0, 3], [0, 1, 4]], r"edge \(0, 1\) lies in 3 faces"),
    ([[0, 1, 9]], "face 0 has index 9"),
    ([[0, 1, 2], [3, 3, 4]], "face 1 names a taxel twice"),
    ([[0, 1, 2], [0, 3, 4]], "meet in one vertex only at taxel 0"),
    ([[0.5, 1, 2]], "integers"),
])  # fmt: skip
def test_faces_that_are_no_manifold_are_named(faces, message, rng):
    skin = skin_from_points(rng.normal(size=(5, 3)), np.tile([0.0, 0, 1], (5, 1)))
    with pytest.raises(InvalidMeshError, match=message):
        build_surface(skin, faces=faces)


def test_methods_that_do_not_exist_and_bodies_that_are_missing_are_named(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
    with pytest.raises(UnknownNameError, match="consensus, fast, accurate"):
        build_surface(skin, method="poisson")
    with pytest.raises(InvalidMeshError, match="came without one"):
        build_surface(skin, method="accurate")
    with pytest.raises(InvalidMeshError, match="no faces"):
        build_surface(skin, method="accurate", body=(points, np.zeros((0, 3), int)))
    big = 1e6 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    with pytest.raises(InvalidMeshError, match="too large"):
        build_surface(skin, method="accurate", body=(big, [[0, 1, 2]]))


def test_check_surface_sees_what_the_mesh_of_a_method_promises(rng):
    points, normals = wavy(120, rng)
    for method in ("consensus", "fast"):
        mesh = build_surface(skin_from_points(points, normals), method=method)
        check_surface(mesh.faces)
        assert len(boundary_loops(mesh.faces)) == 1
