"""Laws of matching: one-to-one, the same with and without numba, whatever turns or numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from sklearn.metrics import adjusted_rand_score

from skinmap.errors import InvalidArrayError
from skinmap.neighbours.matching import Matcher, View, as_prototypes, match_costs, pairing
from skinmap.neighbours.offsets import (
    auto_radius,
    concatenate,
    geodesic_neighbourhoods,
    neighbourhoods,
)
from skinmap.neighbours.structures import assign, find_structures
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.prepared_skin import PreparedSkin

NOISE = 0.25e-3  # the documented limit is twice this
LATTICES = [
    ("triangle_12pad", None, 8e-3, 4),
    ("triangle_12pad", None, 8.8e-3, 4),
    ("triangle_10pad", None, 9.15e-3, 7),
]


def random_layout(seed: int, n: int = 40) -> np.ndarray:
    flat = np.random.default_rng(seed).uniform(0, 0.04, (n, 2))
    return np.column_stack([flat, np.zeros(n)])


@pytest.mark.parametrize(("name", "side", "radius", "count"), LATTICES)
def test_exact_tilings_have_the_known_number_of_structures(
    tiling, flat_hoods, name, side, radius, count
):
    found = find_structures(flat_hoods(tiling(name, side), radius), rotations=6)
    assert len(found.prototypes) == count
    assert (found.labels >= 0).all()


@pytest.mark.parametrize(("name", "side", "radius", "count"), LATTICES)
def test_noise_of_a_quarter_millimetre_changes_no_label(
    tiling, flat_hoods, name, side, radius, count
):
    points = tiling(name, side)
    quiet = find_structures(flat_hoods(points, radius), rotations=6)
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(scale=NOISE, size=points.shape) * [1, 1, 0]
        noisy = find_structures(flat_hoods(points + noise, radius), rotations=6)
        assert len(noisy.prototypes) == count
        assert adjusted_rand_score(quiet.labels, noisy.labels) == 1.0


def test_square_grid_has_one_structure_inside_and_two_at_the_border(flat_hoods):
    grid = np.stack(np.meshgrid(np.arange(9), np.arange(7)), -1).reshape(-1, 2) * 5e-3
    points = np.column_stack([grid, np.zeros(len(grid))])
    found = find_structures(flat_hoods(points, 8.5e-3), rotations=4)
    # Within 8.5 mm: 8 neighbours inside, 5 along an edge, 3 in a corner.
    assert found.counts.tolist() == [7 * 5, 2 * (7 + 5), 4]
    assert found.prototypes.filled.sum(axis=1).tolist() == [8, 5, 3]
    # Without rotation each of the four sides and corners differs from the others.
    assert len(find_structures(flat_hoods(points, 8.5e-3), rotations=1).prototypes) == 9


def test_11_pad_tiling_has_one_structure_per_slot_at_most_inside(tiling, flat_hoods):
    points = tiling("triangle_11pad", 43e-3)
    found = find_structures(flat_hoods(points, 9.2e-3), rotations=6)
    board = found.labels.reshape(-1, 11)
    inside = board[[r * 12 + k for r in range(1, 5) for k in range(2, 10)]]
    # Boards inside the sheet all have the same neighbours, up to the rotation.
    assert (inside == inside[0]).all()


@given(st.integers(0, 10_000), st.floats(0.3e-3, 6e-3), st.sampled_from([1, 4, 6]))
def test_pairing_is_one_to_one(seed, reach, rotations):
    points = random_layout(seed)
    up = np.tile([0.0, 0, 1], (len(points), 1))
    hoods = neighbourhoods(points, up, up[:, [0, 2, 1]], radius=8e-3)
    rows = np.arange(len(points))
    shapes = as_prototypes(hoods, rows[::7], tolerance=reach, rotations=rotations)
    ready = Matcher(shapes, hoods, reach=reach)
    seen = View(hoods)
    for s in range(len(shapes)):
        _, _, partner = pairing(seen, rows, ready, np.full(len(rows), s), rows % rotations)
        for row in partner:
            taken = row[row >= 0]
            assert len(set(taken)) == len(taken)


@given(st.integers(0, 10_000))
def test_a_neighbourhood_matches_itself_at_no_cost(seed):
    points = random_layout(seed)
    up = np.tile([0.0, 0, 1], (len(points), 1))
    hoods = neighbourhoods(points, up, up[:, [0, 2, 1]], radius=8e-3)
    rows = np.arange(len(points))
    shapes = as_prototypes(hoods, rows, tolerance=1.5e-3, rotations=6)
    cost, stray, turn = match_costs(
        View(hoods, compiled=False), rows, Matcher(shapes, hoods, reach=1.5e-3)
    )
    np.testing.assert_allclose(np.diag(cost), 0.0, atol=1e-20)
    np.testing.assert_allclose(np.diag(stray), 0.0, atol=1e-20)
    assert (np.diag(turn) == 0).all()


def test_compiled_matching_gives_the_same(tiling, flat_hoods, rng):
    pytest.importorskip("numba", reason="compiled matching needs numba")
    points = tiling("triangle_10pad") + rng.normal(scale=4e-4, size=(720, 3)) * [1, 1, 0]
    hoods = flat_hoods(points)
    rows = np.arange(0, len(points), 2)
    shapes = as_prototypes(hoods, rows[::9], tolerance=1.5e-3, rotations=6)
    ready = Matcher(shapes, hoods, reach=2e-3)
    plain = match_costs(View(hoods, compiled=False), rows, ready)
    quick = match_costs(View(hoods, compiled=True), rows, ready)
    assert np.isfinite(plain[0]).sum() > 1000
    for one, other in zip(plain, quick, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)  # sums in another order
    one = find_structures(hoods, rotations=6, compiled=False)
    other = find_structures(hoods, rotations=6, compiled=True)
    np.testing.assert_array_equal(one.labels, other.labels)
    np.testing.assert_array_equal(one.neighbours, other.neighbours)


def turned(points, normals, reference, angles):
    a, b = angles
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    turn = about_x @ about_z
    return points @ turn.T + [0.3, -0.2, 1.0], normals @ turn.T, reference @ turn.T


def test_structures_do_not_change_with_motion_numbers_or_scale(prepared):
    skin = prepared("right_arm").skin
    reference = np.tile([0.0, 0, 1], (len(skin), 1))
    given_ = (skin.positions, skin.normals, reference)
    found = find_structures(neighbourhoods(*given_, radius=8e-3), rotations=6)
    moved = neighbourhoods(*turned(*given_, (0.7, -1.9)), radius=8e-3)
    np.testing.assert_array_equal(find_structures(moved, rotations=6).labels, found.labels)
    order = np.random.default_rng(5).permutation(len(skin))
    shuffled = neighbourhoods(*(values[order] for values in given_), radius=8e-3)
    again = find_structures(shuffled, rotations=6)
    assert adjusted_rand_score(again.labels, found.labels[order]) == 1.0
    assert again.counts.tolist() == found.counts.tolist()
    large = neighbourhoods(4.0 * skin.positions, skin.normals, reference, radius=32e-3, band=3.2e-3)
    scaled = find_structures(large, tolerance=6e-3, rotations=6)
    np.testing.assert_array_equal(scaled.labels, found.labels)


def test_members_lie_within_reach_of_their_places(prepared):
    hoods = prepared("torso").hoods
    found = find_structures(hoods, rotations=6)
    shapes = found.prototypes
    for taxel in np.flatnonzero(found.labels >= 0):
        s, turn = found.labels[taxel], found.rotation[taxel] * np.pi / 3
        spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        places = shapes.offsets[s] @ spin
        filled = found.neighbours[taxel] >= 0
        assert (shapes.required[s] <= filled).all()
        at = [list(hoods.index[taxel]).index(k) for k in found.neighbours[taxel][filled]]
        gap = np.linalg.norm(hoods.offsets[taxel][at] - places[filled], axis=1)
        assert gap.max(initial=0.0) <= 1.5 * shapes.tolerance * (1 + 1e-9)


def test_leftovers_are_alone(tiling, flat_hoods):
    points = tiling("triangle_12pad")
    stranger = points[400] + [2.2e-3, 0.9e-3, 0]  # between two pads: like nothing else
    found = find_structures(flat_hoods(np.vstack([points, stranger])), rotations=6)
    assert len(points) in found.leftovers
    assert (found.counts[found.labels[found.leftovers]] == 1).all()


def test_assign_leaves_unknown_shapes_without_structure(tiling, flat_hoods):
    found = find_structures(flat_hoods(tiling("triangle_12pad")), rotations=6)
    dense = np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) * 3e-3
    other = assign(flat_hoods(np.column_stack([dense, np.zeros(25)])), found.prototypes)
    assert (other.labels == -1).all()
    assert len(other.leftovers) == 25


@pytest.mark.parametrize(
    ("name", "low", "high"),
    # The rings below and above: 7.64 and 10 mm, 8.02 and 10.26 mm.
    [("triangle_12pad", 7.64e-3, 10.0e-3), ("triangle_10pad", 8.0e-3, 10.3e-3)],
)
def test_auto_radius_lies_in_the_middle_of_the_gap(tiling, name, low, high):
    found = auto_radius([tiling(name)], near=8e-3)
    assert found == pytest.approx(0.5 * (low + high), abs=0.05e-3)  # a step and rounded rings


def test_auto_radius_of_scattered_points_is_the_one_asked_for():
    assert auto_radius([np.eye(3)], near=8e-3) == 8e-3
    with pytest.raises(InvalidArrayError, match="above 0"):
        auto_radius([np.eye(3)], near=0.0)


def folded_strip() -> tuple[SurfaceMesh, np.ndarray]:
    """Two sheets that meet at a right edge of 30 degrees: a grid bent along its middle row."""
    column, row = np.meshgrid(np.arange(9), np.arange(9))
    x, y = 3e-3 * (column.ravel() - 4.0), 3e-3 * row.ravel()
    lean = np.radians(15.0)
    points = np.column_stack([np.sin(lean) * x, y, -np.cos(lean) * np.abs(x)])
    side = np.sign(x)
    normals = np.column_stack([side * np.cos(lean), 0 * x, np.full(81, np.sin(lean))])
    normals[side == 0] = [0, 0, 1]
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + 1, corner + 10]),
            np.column_stack([corner, corner + 10, corner + 9]),
        ]
    )
    index = np.arange(81)
    skin = Skin("fold", "", index, np.zeros_like(index), points, normals)
    mesh = SurfaceMesh(skin, faces, index, np.zeros(len(faces), np.int64))
    return mesh, np.column_stack([x, y])


def test_geodesic_neighbours_go_round_a_fold():
    mesh, unfolded = folded_strip()
    reference = np.tile([0.0, 1, 0], (81, 1))
    along = geodesic_neighbourhoods(mesh, reference, radius=8e-3, band=0.0)
    straight = neighbourhoods(mesh.vertices, mesh.skin.normals, reference, radius=8e-3, band=0.0)
    gap = np.linalg.norm(unfolded[:, None] - unfolded, axis=2)
    expected = (gap <= 8e-3) & ~np.eye(81, dtype=bool)
    for taxel in range(81):
        near = along.index[taxel][along.filled[taxel]]
        assert set(near) == set(np.flatnonzero(expected[taxel]))
        length = np.linalg.norm(along.offsets[taxel], axis=1)[along.filled[taxel]]
        # A fold unrolls without strain: geodesics are the plane's straight lines.
        np.testing.assert_allclose(length, gap[taxel, near], rtol=1e-6)
    assert straight.filled.sum() > along.filled.sum()  # which cut across the fold


def test_geodesic_neighbourhoods_are_the_straight_ones_on_a_plane(tiling, flat_hoods):
    from skinmap.skin.skin import skin_from_points
    from skinmap.surface.surface_mesh import build_surface

    points = tiling("triangle_12pad")[:240]
    up = np.tile([0.0, 0, 1], (len(points), 1))
    mesh = build_surface(skin_from_points(points, up))
    along = geodesic_neighbourhoods(mesh, np.tile([0.0, 1, 0], (len(points), 1)), radius=8e-3)
    straight = flat_hoods(points)
    # But for pairs across a notch of the border, where the way along the skin is longer.
    same = (along.index[:, :, None] == straight.index[:, None, :]) & along.filled[:, :, None]
    assert same.any(axis=2)[along.filled].all()
    row, i, j = np.nonzero(same)
    gap = np.linalg.norm(along.offsets[row, i] - straight.offsets[row, j], axis=1)
    assert (gap < 1e-9).mean() > 0.99


def test_concatenate_refuses_different_radii(tiling, flat_hoods):
    points = tiling("triangle_12pad")[:24]
    with pytest.raises(InvalidArrayError, match="one radius"):
        concatenate([flat_hoods(points, 8e-3), flat_hoods(points, 9e-3)])


def test_real_parts_at_the_prototypes_radius(prepared):
    # Hard radius: 60, 82 and 175; the soft radius of the prototype: 49, 39 and 97 (r 8.6).
    for part, most in (("right_arm", 49), ("right_leg_upper", 39), ("torso", 97)):
        skin = prepared(part)
        from skinmap.neighbours.offsets import flat_map_directions

        hoods = neighbourhoods(
            skin.skin.positions, skin.skin.normals, flat_map_directions(skin.flat), radius=8.6e-3
        )
        plain = find_structures(hoods, rotations=1)
        assert len(plain.prototypes) <= most
        assert len(find_structures(hoods, rotations=6).prototypes) < len(plain.prototypes)


@pytest.mark.parametrize("pitch", [2e-3, 6.5e-3, 10.4e-3, 25e-3])
def test_structures_of_coarse_and_fine_skins_have_their_ring_of_neighbours(pitch):
    row, column = np.divmod(np.arange(144), 12)
    points = np.column_stack([column + 0.5 * (row % 2), np.sqrt(0.75) * row, 0.0 * row]) * pitch
    index = np.arange(144)
    skin = Skin("sheet", "", index, index // 12, points, np.tile([0.0, 0.0, 1.0], (144, 1)))
    prepared = PreparedSkin(skin)
    found = find_structures(prepared.flat, rotations=6)
    inner = (row > 1) & (row < 10) & (column > 1) & (column < 10)
    counts = (prepared.neighbourhoods().index[inner] >= 0).sum(axis=1)
    assert set(counts.tolist()) <= {6, 7}
    assert len(set(found.labels[inner].tolist())) == 1


@pytest.mark.parametrize("pitch", [7.5e-3, 8e-3, 9e-3])
def test_auto_radius_reaches_the_first_ring_of_an_irregular_grid(pitch, rng):
    grid = pitch * np.stack(np.meshgrid(range(12), range(12)), axis=-1).reshape(-1, 2)
    points = np.column_stack(
        [grid + rng.normal(scale=0.06 * pitch, size=grid.shape), 0 * grid[:, 0]]
    )
    radius = auto_radius([points], near=8e-3)
    nearest = cKDTree(points).query(points, 2)[0][:, 1]
    assert (nearest < radius).mean() > 0.85  # 0 of them before: below the first ring all is empty
