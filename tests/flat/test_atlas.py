from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from skinmap.flat.atlas import (
    MAX_ARRANGED,
    Laid,
    arrange,
    clearance,
    limb_frame,
    outline,
    turn_upright,
    upright,
)
from skinmap.flat.flat_map import flatten
from skinmap.geometry.topology import half_edges
from skinmap.geometry.triangles import cross_2d, signed_areas
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.prepared_skin import PreparedSkin

SEVERAL = ["left_arm", "right_arm", "left_forearm", "left_leg_upper", "right_leg_upper"]
seeds = st.integers(0, 2**32 - 1)


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation (3, 3)."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def sheet(columns: int, rows: int, corner: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Plane vertices (n, 2) of a grid of pitch 1 from a corner, and its faces."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    start = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.column_stack([start, start + 1, start + columns])
    upper = np.column_stack([start + 1, start + columns + 1, start + columns])
    return np.column_stack([column, row]) + np.array(corner), np.concatenate([lower, upper])


def bent(flat: np.ndarray, radius: float) -> np.ndarray:
    """Plane points (n, 2) wound round a cylinder along y."""
    angle = flat[:, 0] / radius
    return np.column_stack([radius * np.sin(angle), flat[:, 1], radius * np.cos(angle)])


PLAN = [sheet(8, 9, (0, 0)), sheet(4, 6, (10.0, 1.0)), sheet(5, 4, (-1.0, 11.5))]


def three_patches() -> SurfaceMesh:
    """An asymmetric skin of three patches on a cylinder, with its mesh."""
    points = [bent(flat, 9.0) for flat, _ in PLAN]
    vertices = np.concatenate(points)
    normals = vertices * [1, 0, 1] / 9.0
    start = np.cumsum([0, *map(len, points)])
    faces = np.concatenate([face + at for (_, face), at in zip(PLAN, start, strict=False)])
    patch = np.repeat(np.arange(3), [len(face) for _, face in PLAN])
    return mesh_of(skin_from_points(vertices, normals), faces, patch)


def mesh_of(skin: Skin, faces: np.ndarray, patch: np.ndarray) -> SurfaceMesh:
    return SurfaceMesh(skin, faces, np.arange(len(skin)), patch)


def border_distance(one, other) -> float:
    """Smallest distance of two charts, by their borders' corners and sides."""
    return min(_corner_distance(one, other), _corner_distance(other, one))


def _corner_distance(one, other) -> float:
    directed = half_edges(other.faces)
    ends = other.uv[directed]
    way = ends[:, 1] - ends[:, 0]
    offset = one.uv[:, None] - ends[None, :, 0]
    share = np.clip((offset * way).sum(axis=2) / (way**2).sum(axis=1), 0, 1)
    return float(np.linalg.norm(offset - share[:, :, None] * way, axis=2).min())


def inside(points: np.ndarray, chart) -> np.ndarray:
    """Whether points lie in a triangle of a chart."""
    start = chart.uv[chart.faces]
    side = np.roll(start, -1, axis=1) - start
    return (cross_2d(side[None], points[:, None, None] - start[None]) > 0).all(axis=2).any(axis=1)


def body_distance(flat, one, other) -> float:
    a, b = flat.mesh.vertices[one.taxels], flat.mesh.vertices[other.taxels]
    return float(np.linalg.norm(a[:, None] - b[None], axis=2).min())


@pytest.mark.parametrize("part", SEVERAL)
def test_charts_keep_their_distance_and_no_more(prepared, part):
    flat = prepared(part).flat
    near = []
    for i, one in enumerate(flat.charts):
        for other in flat.charts[:i]:
            gap, body = border_distance(one, other), body_distance(flat, one, other)
            # Never closer than on the body, but for rounding; borders apart and nothing inside.
            assert gap >= body * (1 - 1e-9)
            assert not inside(one.uv, other).any()
            assert not inside(other.uv, one).any()
            near.append(gap / body)
    # As many gaps as it takes to join all charts are exactly as on the body.
    assert_allclose(np.sort(near)[: len(flat.charts) - 1], 1.0, atol=1e-6)


def test_arrange_recovers_a_plane_that_was_cut_into_patches():
    charts = [Laid(np.column_stack([flat, 0 * flat[:, 0]]), faces, flat) for flat, faces in PLAN]
    placed = np.concatenate(arrange(charts))
    planned = np.concatenate([flat for flat, _ in PLAN])
    centre = (planned.min(axis=0) + planned.max(axis=0)) / 2
    # Sliding ends where the gap is that on the body; a line between middles is not quite across
    # it, so half a per cent of the size (13) is left.
    assert_allclose(placed, planned - centre, atol=0.07)


def test_arrange_unrolls_a_cylinder():
    flat = flatten(three_patches())
    planned = np.concatenate([plan for plan, _ in PLAN])
    # The axis is a few degrees off the cylinder's: both are compared in the plan's direction.
    u, _, v = np.linalg.svd((planned - planned.mean(axis=0)).T @ (flat.uv - flat.uv.mean(axis=0)))
    turned = (flat.uv - flat.uv.mean(axis=0)) @ (u @ v).T
    assert abs((u @ v)[0, 0]) > 0.95
    # Charts keep their direction while they slide: a tenth of the gaps, which are 2.5 and 3 wide.
    assert_allclose(turned, planned - planned.mean(axis=0), atol=0.3)


@given(seeds)
@settings(max_examples=10, deadline=None)  # a crowded machine is no failure
def test_moving_and_renumbering_the_body_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    mesh = three_patches()
    R, shift = rotation(rng), rng.normal(size=3)
    order = rng.permutation(len(mesh.skin))
    rank = np.argsort(order)
    shuffle = rng.permutation(len(mesh.faces))
    moved = skin_from_points((mesh.vertices @ R.T + shift)[order], (mesh.skin.normals @ R.T)[order])
    other = mesh_of(moved, rank[mesh.faces][shuffle], mesh.face_patches[shuffle])
    # ARAP stops after ten steps, the sum of which rounds differently: 1e-9 of the size and less.
    assert_allclose(flatten(other).uv[rank], flatten(mesh).uv, atol=1e-6)


@given(seeds)
@settings(max_examples=10, deadline=None)  # a crowded machine is no failure
def test_a_mirror_image_has_the_mirror_image_as_its_map(seed):
    rng = np.random.default_rng(seed)
    mesh = three_patches()
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    M = np.eye(3) - 2 * np.outer(normal, normal)
    twin = Skin(
        "left_skin", "", mesh.skin.channels, mesh.skin.modules,
        mesh.vertices @ M, mesh.skin.normals @ M,
    )  # fmt: skip
    other = mesh_of(twin, mesh.faces[:, ::-1], mesh.face_patches)
    assert_allclose(flatten(other).uv, flatten(mesh).uv * [-1, 1], atol=1e-6)


@pytest.mark.parametrize("part", ["arm", "forearm", "leg_upper", "leg_lower", "hand", "foot"])
def test_left_and_right_of_the_icub_are_mirrored(prepared, part):
    left, right = prepared(f"left_{part}").flat, prepared(f"right_{part}").flat
    assert len(left.charts) == len(right.charts)
    one = np.array([chart.uv.mean(axis=0) for chart in left.charts])
    other = np.array([chart.uv.mean(axis=0) for chart in right.charts])
    # The thighs differ by a module, 10 taxels of 680: 25 mm of 300; all others by millimetres.
    assert_allclose(one, other * [-1, 1], atol=0.025 if part == "leg_upper" else 0.004)


@pytest.mark.parametrize("part", ["torso", "left_arm", "right_forearm", "left_leg_upper"])
def test_limbs_stand_upright(prepared, icub, part):
    flat = prepared(part).flat
    up = icub.body.poses({})[icub.part(part).link][2, :3]
    assert_allclose(flat.mesh.skin.up, up)
    assert limb_frame(flat.mesh.vertices, flat.mesh.faces, up)[0] @ up > 0.9
    for chart in flat.charts:
        height = flat.mesh.vertices[chart.taxels] @ up
        assert np.corrcoef(height, chart.uv[:, 1])[0, 1] > 0.8


def test_without_an_upward_direction_the_narrow_end_hangs_down(square_grid):
    vertices, faces = square_grid(9)
    cone = vertices * [1, 3, 1]
    cone[:, 0] = (cone[:, 0] - 0.5) * (0.3 + cone[:, 1])
    assert limb_frame(cone, faces)[0] @ [0, 1, 0] > 0.9
    assert limb_frame(cone * [1, -1, 1], faces[:, ::-1])[0] @ [0, 1, 0] < -0.9


def test_limb_frame_is_a_frame(prepared):
    mesh = prepared("left_arm").mesh
    frame = limb_frame(mesh.vertices, mesh.faces)
    assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)


def test_a_cap_across_the_limb_turns_by_the_side_that_the_limb_looks_to(square_grid):
    vertices, faces = square_grid(5)
    frame = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the limb along z, the cap in x, y
    turned = turn_upright(vertices[:, :2], vertices, frame)
    assert np.corrcoef(turned[:, 1], -vertices[:, 0])[0, 1] == pytest.approx(1.0)
    assert (signed_areas(turned, faces) > 0).all()


def test_upright_turns_the_height_up(rng):
    uv = rng.normal(size=(30, 2))
    angle = 2.0
    turned = uv @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert_allclose(upright(turned, uv[:, 1]), uv - uv.mean(axis=0), atol=1e-12)


def test_clearance_of_two_squares_is_exact():
    uv, faces = sheet(3, 3, (0, 0))
    square = outline(faces, uv)
    right, up = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    for direction in (right, up, -right):
        free = clearance(square, np.zeros(2), direction, square, np.zeros(2), 0.5)
        assert free == pytest.approx(2.5)
    # At 45 degrees the corner of one comes to the corner of the other: sqrt(8) and the gap.
    diagonal = clearance(square, np.zeros(2), (right + up) / np.sqrt(2), square, np.zeros(2), 0.5)
    assert diagonal == pytest.approx(np.sqrt(8) + 0.5)


def test_coarse_outlines_stay_clear_of_fine_ones(rng):
    angle = np.linspace(0, 2 * np.pi, 700, endpoint=False)
    radius = 1 + 0.1 * rng.uniform(size=700)
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    uv = np.concatenate([rim, [[0.0, 0.0]]])
    faces = np.column_stack([np.arange(700), (np.arange(700) + 1) % 700, np.full(700, 700)])
    vertices = np.column_stack([uv, np.zeros(701)])
    placed = arrange([Laid(vertices, faces, uv), Laid(vertices + [2.4, 0, 0], faces, uv)])
    distance = np.linalg.norm(placed[0][:, None] - placed[1][None], axis=2).min()
    assert distance >= np.linalg.norm(vertices[:, None] - (vertices + [2.4, 0, 0]), axis=2).min()


def test_many_charts_go_in_shelves():
    uv, faces = sheet(2, 2, (0, 0))
    charts = [
        Laid(np.column_stack([uv + 2.0 * k, 0 * uv[:, 0]]), faces, uv)
        for k in range(MAX_ARRANGED + 1)
    ]
    boxes = [(chart.min(axis=0), chart.max(axis=0)) for chart in arrange(charts)]
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:i]:
            assert (low > other_high).any() or (other_low > high).any()


@pytest.mark.parametrize("turn", [0.0, 20.0, 45.0])
def test_a_square_pad_lies_along_its_edges(turn):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    grid = np.mgrid[0:8, 0:8].reshape(2, -1).T @ np.array([[c, s], [-s, c]]) * 4e-3
    rows = np.arange(64)
    skin = Skin(
        "pad",
        "link",
        rows,
        rows,
        np.column_stack([grid, np.zeros(64)]),
        np.tile([0.0, 0.0, 1.0], (64, 1)),
    )
    (chart,) = flatten(PreparedSkin(skin).mesh).charts
    np.testing.assert_allclose(np.ptp(chart.uv, axis=0), 0.028, rtol=1e-3)


@pytest.mark.parametrize("turn", [0.0, 20.0, 45.0, 70.0])
def test_a_square_pad_lies_the_same_however_its_taxels_are_numbered(turn):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    grid = np.mgrid[0:8, 0:8].reshape(2, -1).T @ np.array([[c, s], [-s, c]]) * 4e-3
    places, up = np.column_stack([grid, np.zeros(64)]), np.tile([0.0, 0.0, 1.0], (64, 1))
    frames = []
    for seed in range(5):
        mesh = PreparedSkin(
            skin_from_points(places[np.random.default_rng(seed).permutation(64)], up)
        ).mesh
        frames.append(limb_frame(mesh.vertices, mesh.faces))
    np.testing.assert_allclose(frames, np.stack(5 * [frames[0]]), rtol=0, atol=1e-6)
