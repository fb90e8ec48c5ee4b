from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinmap.geometry.proximity import closest_on_mesh
from skinmap.live.contacts.sample_contacts import (
    Components,
    Cutter,
    basins,
    centre_of_pressure,
    closest_on_faces,
    measure,
)
from skinmap.live.robot_skin import JoinedSkin
from skinmap.skin.skin import skin_from_points
from skinmap.touch.contacts.skin_geometry import connected
from skinmap.touch.prepared_skin import PreparedSkin


@pytest.fixture(scope="module")
def two_parts(prepared) -> JoinedSkin:
    return JoinedSkin({part: prepared(part) for part in ("left_arm", "left_foot")})


def flat_skin(points, part="sheet") -> PreparedSkin:
    points = np.asarray(points, float)
    return PreparedSkin(
        skin_from_points(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), part=part)
    )


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.9))
def test_components_agree_with_those_of_whole_recordings(two_parts, seed, share):
    """Two ways: the padded table here, links and FastSV in `skinmap.touch`, part by part."""
    active = np.random.default_rng(seed).random(len(two_parts)) < share
    index = np.flatnonzero(active)
    label = Components(two_parts).label(index)
    for part, rows in two_parts.slices.items():
        own = (index >= rows.start) & (index < rows.stop)
        geometry = two_parts.skins[part].geometry
        theirs = connected(geometry.links, active[rows], index[own] - rows.start)
        # The same partition: each pair of labels occurs as often as each label alone.
        both = np.unique(np.column_stack([label[own], theirs]), axis=0)
        assert len(both) == len(np.unique(theirs)) == len(np.unique(label[own]))


def test_contacts_never_cross_a_gap_nor_reach_unplaced_taxels(hexagons):
    near = np.column_stack([hexagons, np.zeros(len(hexagons))])
    far = near + [0.0, hexagons[:, 1].max() + 0.02, 0.0]
    alone = [[0.2, 0.2, 0.0]]
    skin = JoinedSkin({"sheet": flat_skin(np.concatenate([near, far, alone]))})
    label = Components(skin).label(np.arange(len(skin)))
    n = len(near)
    assert len(np.unique(label)) == 3
    assert len(np.unique(label[:n])) == len(np.unique(label[n : 2 * n])) == 1
    assert len(np.unique(skin.patch_of)) == 3


def test_basins_climb_to_the_highest_neighbour(two_parts):
    rows = two_parts.slices["left_foot"]
    index = np.arange(rows.start, rows.stop)
    points = two_parts.positions[index]
    summits = [10, 200]
    pressures = sum(
        100.0 * np.exp(-((np.linalg.norm(points - points[k], axis=1) / 0.01) ** 2)) for k in summits
    )
    inside = np.flatnonzero(pressures > 1.0)
    components = Components(two_parts)
    found = basins(components.local(index[inside]), pressures[inside])
    assert set(inside[found]) == set(summits)
    nearest = np.linalg.norm(points[inside, None] - points[summits], axis=2).argmin(axis=1)
    # Where both are equally far the valley may fall on either side.
    assert np.mean(inside[found] == np.array(summits)[nearest]) > 0.9


@given(st.integers(0, 2**32 - 1))
def test_closest_point_agrees_with_libigl(seed):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(9, 3))
    faces = rng.integers(0, 9, (6, 3))
    faces = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    if len(faces) == 0:
        return
    point = rng.normal(size=(4, 3))
    _, foot = closest_on_faces(point, vertices, faces, np.tile(np.arange(len(faces)), (4, 1)))
    distance, _, _ = closest_on_mesh(point, vertices, faces)
    # Random triangles may be slivers: half of the digits of a squared distance.
    np.testing.assert_allclose(np.linalg.norm(foot - point, axis=1), distance, atol=1e-6)


def test_closest_point_of_a_triangle_without_size_is_its_corner():
    vertices = np.array([[1.0, 2.0, 3.0]])
    face, foot = closest_on_faces(
        np.zeros((1, 3)), vertices, np.zeros((1, 3), np.int64), np.zeros((1, 2), np.int64)
    )
    assert face == [0]
    np.testing.assert_array_equal(foot, vertices)


def test_centre_of_pressure_lies_on_the_surface_mesh(prepared):
    """Of a hand round the arm the mean lies inside the arm; its centre does not."""
    arm = prepared("left_forearm")
    points = arm.skin.positions
    for taxel in range(0, len(points), 16):
        away = np.linalg.norm(points - points[taxel], axis=1)
        pressures = np.where(away < 0.025, 100.0, 0.0)
        centre = centre_of_pressure(arm, pressures)
        gap, _, _ = closest_on_mesh(centre[None], arm.mesh.vertices, arm.mesh.faces)
        assert gap[0] < 1e-9
        assert np.linalg.norm(centre - points[taxel]) < 0.025


def test_measures_of_a_flat_press_have_closed_forms(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    skin = JoinedSkin({"sheet": flat_skin(points)})
    middle = 80
    index = np.flatnonzero(np.linalg.norm(points - points[middle], axis=1) < 7e-3)
    assert len(index) == 7
    pressures = np.where(index == middle, 100.0, 50.0)
    found = measure(skin, index, np.zeros(7, np.int64), 1, pressures)
    np.testing.assert_allclose(found.centre[0], points[middle], atol=1e-12)
    np.testing.assert_allclose(found.normal[0], [0.0, 0.0, 1.0], atol=1e-12)
    # A taxel of a hexagonal lattice stands for sqrt(3) / 2 pitch^2.
    np.testing.assert_allclose(found.area[0], 7 * np.sqrt(0.75) * 6.5e-3**2, rtol=1e-9)
    # The middle one's neighbours read half as much: it is covered whole, each of them by a fifth.
    np.testing.assert_allclose(found.area_least[0], found.area[0] * (1 + 6 / 5) / 7, rtol=1e-9)
    assert found.peak[0] == 100.0
    assert found.load[0] == 400.0


def test_numbering_of_parts_does_not_change_measures(prepared):
    one = JoinedSkin({part: prepared(part) for part in ("left_foot", "left_hand")})
    other = JoinedSkin({part: prepared(part) for part in ("left_hand", "left_foot")})
    rows = np.array([3, 4, 5])
    label = np.zeros(3, np.int64)
    pressures = np.array([20.0, 30.0, 40.0])
    first = measure(one, one.starts[0] + rows, label, 1, pressures)
    second = measure(other, other.starts[1] + rows, label, 1, pressures)
    np.testing.assert_array_equal(first.centre, second.centre)
    np.testing.assert_array_equal(first.area, second.area)


def test_summits_are_as_far_apart_as_the_skin_between_them():
    """Round a limb as long as its arc, along it and on flat skin as straight."""
    count, radius = 24, 9e-3
    angle, height = np.meshgrid(np.arange(count) * 2 * np.pi / count, np.arange(0.0, 0.03, 3e-3))
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1).reshape(-1, 3)
    points = radius * normals + np.array([0.0, 0.0, 1.0]) * height.reshape(-1, 1)
    joined = JoinedSkin({"limb": PreparedSkin(skin_from_points(points, normals, part="limb"))})
    cutter = Cutter(joined, Components(joined))
    round_it = cutter._along_skin(np.arange(1, count // 2 + 1), 0)
    np.testing.assert_allclose(
        round_it, radius * 2 * np.pi / count * np.arange(1, count // 2 + 1), rtol=1e-9
    )
    np.testing.assert_allclose(cutter._along_skin(np.array([count, 5 * count]), 0), [3e-3, 15e-3])
    sheet = JoinedSkin({"sheet": flat_skin([[0, 0, 0], [0.02, 0, 0], [0, 0.02, 0]])})
    flat = Cutter(sheet, Components(sheet))
    np.testing.assert_allclose(flat._along_skin(np.array([1, 2]), 0), [0.02, 0.02])
