from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.contacts import skin_geometry as contacts
from skinmap.touch.contacts.contact_geometry import FEATURES, contact_geometry, skin_plane
from skinmap.touch.contacts.skin_geometry import find_contacts, measure_skin, pool_event, pressed


@pytest.fixture(scope="module")
def plate(hexagons):
    """Geometry of a flat skin of 168 taxels, pitch 6.5 mm."""
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
    return measure_skin(build_surface(skin))


def named(values: np.ndarray) -> dict[str, float]:
    return dict(zip(FEATURES, values.tolist(), strict=True))


def disc(geometry, centre: int, radius: float) -> np.ndarray:
    points = geometry.mesh.vertices
    near = np.linalg.norm(points - points[centre], axis=1) <= radius
    return np.where(near, 100.0, 0.0)


def test_untouched_skin_is_all_zero(plate):
    assert not contact_geometry(plate, np.zeros(len(plate))).any()


def test_one_taxel_is_one_contact_of_its_area(plate):
    found = named(contact_geometry(plate, disc(plate, 80, 0.0)))
    # A hexagonal cell of pitch 6.5 mm: sqrt(3) / 2 * 6.5^2 = 36.6 mm2.
    assert found["active_area_mm2"] == pytest.approx(np.sqrt(3) / 2 * 6.5**2, rel=1e-9)
    assert (found["contacts"], found["length_mm"], found["largest_share"]) == (1, 0, 1)
    assert (found["peak"], found["mean"]) == (100, 100)


def test_two_discs_are_two_contacts_at_their_distance(plate):
    load = disc(plate, 26, 7e-3) + disc(plate, 136, 7e-3)
    found = named(contact_geometry(plate, load))
    straight = np.linalg.norm(plate.mesh.vertices[26] - plate.mesh.vertices[136])
    assert found["contacts"] == 2
    assert found["effective_contacts"] == pytest.approx(2.0)
    # Paths over two rings of a lattice are up to 4 % longer than the straight line.
    assert found["contact_distance_mm"] == pytest.approx(1e3 * straight, rel=0.04)
    assert found["largest_share"] == pytest.approx(0.5)


def test_lengths_of_a_row_are_its_standard_deviation(plate):
    load = np.zeros(len(plate))
    load[62:69] = 100.0  # a row inside the plate
    found = named(contact_geometry(plate, load))
    assert found["length_mm"] == pytest.approx(6.5 * np.arange(7).std(), rel=1e-6)
    # Paths are kept in single precision: 39 mm * sqrt(6e-8) is 0.01 mm.
    assert found["width_mm"] == pytest.approx(0.0, abs=0.01)
    assert found["extent_length_mm"] == pytest.approx(6 * 6.5 + 6.5 * np.sqrt(np.sqrt(3) / 2))


def test_contact_geometry_does_not_depend_on_the_order_of_taxels(plate, rng):
    order = rng.permutation(len(plate))
    skin = plate.mesh.skin
    other = measure_skin(
        build_surface(skin_from_points(skin.positions[order], skin.normals[order]))
    )
    load = disc(plate, 80, 15e-3) * rng.uniform(0.5, 2.0, len(plate))
    one = contact_geometry(plate, load)
    np.testing.assert_allclose(contact_geometry(other, load[order]), one, rtol=1e-9)


def test_contacts_are_numbered_by_load(plate):
    found = find_contacts(plate, disc(plate, 26, 1e-3) + 2 * disc(plate, 136, 1e-3))
    active, label = found.active, found.number
    assert active.sum() == 2
    assert (label[136], label[26]) == (0, 1)


def test_find_contacts_refuses_another_skin(plate):
    with pytest.raises(SkinMismatchError, match="3 pressures for the 168 taxels"):
        find_contacts(plate, np.zeros(3))


def test_pool_event_is_the_mean_while_pressed():
    samples = np.array([[0, 20], [0, 200], [0, 220], [0, 30]], np.uint8)
    np.testing.assert_array_equal(pressed(samples), samples[1:3])
    np.testing.assert_allclose(pool_event(samples), [0, 210])


def test_pool_event_without_contact_is_zero():
    np.testing.assert_array_equal(pool_event(np.full((4, 3), 5, np.uint8)), np.zeros(3))
    np.testing.assert_array_equal(pool_event(np.zeros((0, 3), np.uint8)), np.zeros(3))


def flat(points2d):
    points = np.column_stack([points2d, np.zeros(len(points2d))])
    return measure_skin(
        build_surface(skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1))))
    )


def hertz(geometry, radius: float, stretch: float = 1.0) -> np.ndarray:
    """Pressures of a round (or oval) contact in the middle of a plate."""
    points = geometry.mesh.vertices[:, :2]
    away = (points - points.mean(axis=0)) / [stretch, 1.0]
    return 200.0 * np.sqrt(np.clip(1 - (away**2).sum(axis=1) / radius**2, 0, None))


@pytest.mark.parametrize("radius", [16e-3, 25e-3])
def test_hertz_contact_has_its_closed_form_on_any_lattice(hexagons, radius):
    """The load p0 sqrt(1 - (r / R)^2) has a standard deviation of R / sqrt 5 along each axis."""
    square = 4e-3 * np.argwhere(np.ones((22, 22)))
    for geometry in (flat(hexagons), flat(square)):
        found = named(contact_geometry(geometry, hertz(geometry, radius)))
        # A lattice of 6.5 mm sums a disc of 16 mm from 19 points: 10 %.
        assert found["length_mm"] == pytest.approx(1e3 * radius / np.sqrt(5), rel=0.1)
        assert found["width_mm"] == pytest.approx(1e3 * radius / np.sqrt(5), rel=0.1)
        # Half of the peak is passed at R sqrt(3) / 2.
        assert found["core_area_mm2"] == pytest.approx(0.75e6 * np.pi * radius**2, rel=0.2)
        # The share of the load inside r is 1 - (1 - (r / R)^2)^(3/2): half of it at 0.608 R.
        assert found["radius_50_mm"] == pytest.approx(608 * radius, abs=3.3)  # half a pitch
        assert (found["summits"], found["contacts"], found["border_share"]) == (1, 1, 0)


def test_lengths_and_widths_of_an_oval(hexagons):
    geometry = flat(hexagons)
    found = named(contact_geometry(geometry, hertz(geometry, 13e-3, 2.0)))
    assert found["length_mm"] / found["width_mm"] == pytest.approx(2.0, rel=0.1)


def test_lengths_on_a_bent_skin_are_those_of_the_flat_one(hexagons):
    """A plate rolled round a limb of 40 mm keeps the lengths along it."""
    flat_plate = flat(hexagons)
    angle = hexagons[:, 0] / 40e-3
    radial = np.column_stack([np.sin(angle), np.zeros(len(angle)), np.cos(angle)])
    points = 40e-3 * radial + np.column_stack([0 * angle, hexagons[:, 1], 0 * angle])
    bent = measure_skin(build_surface(skin_from_points(points, radial)))
    load = hertz(flat_plate, 13e-3, 2.0)
    one, other = (named(contact_geometry(geometry, load)) for geometry in (flat_plate, bent))
    for name in ("length_mm", "width_mm", "extent_length_mm", "active_area_mm2"):
        # Chords of 13 mm on this bend are 0.5 % shorter than their arcs.
        assert other[name] == pytest.approx(one[name], rel=0.01), name


def test_skin_plane_keeps_distances_on_a_plate(plate):
    index = np.flatnonzero(disc(plate, 80, 20e-3))
    plane = skin_plane(plate, index, np.ones(len(index)))
    points = plate.mesh.vertices[index]
    flat_distances = np.linalg.norm(plane[:, None] - plane[None], axis=2)
    true = np.linalg.norm(points[:, None] - points[None], axis=2)
    # Paths over two rings of a hexagonal lattice are up to 4 % longer than straight lines.
    assert np.abs(flat_distances - true).max() <= 0.04 * true.max()


def test_areas_at_the_edge_count_in_full(plate):
    border = plate.areas[plate.border]
    np.testing.assert_allclose(border, np.sqrt(3) / 2 * 6.5e-3**2, rtol=1e-9)
    assert plate.mesh.taxel_areas[plate.border].max() < border.min()


def test_a_contact_goes_on_across_a_gap_between_patches(hexagons):
    """Two plates 18 mm apart: one finger over both is one contact, and two for grouping."""
    # Measured from the last taxels of one to the first of the other; zigzag edges add 3 mm.
    far = hexagons.copy()
    far[:, 0] += np.ptp(hexagons[:, 0]) + 18e-3
    geometry = flat(np.concatenate([hexagons, far]))
    assert geometry.mesh.n_patches == 2
    points = geometry.mesh.vertices
    middle = np.ptp(hexagons[:, 0]) + 9e-3
    finger = np.abs(points[:, 1] - 0.039) < 9e-3
    finger &= np.abs(points[:, 0] - middle) < 30e-3
    found = named(contact_geometry(geometry, np.where(finger, 100.0, 0.0)))
    assert found["contacts"] == 1
    assert found["largest_share"] == 1.0


def test_a_touch_on_the_coarser_area_is_one_contact_of_its_size():
    """Taxels 2.5 mm apart beside others 10 mm apart: areas and paths are those of the plane."""
    dense = np.stack(np.meshgrid(np.arange(21), np.arange(17)), -1).reshape(-1, 2) * 2.5e-3
    coarse = np.stack(np.meshgrid(np.arange(6), np.arange(5)), -1).reshape(-1, 2) * 1e-2
    geometry = flat(np.concatenate([dense, coarse + [58e-3, 0.0]]))
    pressed = np.linalg.norm(geometry.mesh.vertices[:, :2] - [88e-3, 20e-3], axis=1) < 15e-3
    (found,) = find_contacts(geometry, np.where(pressed, 200.0, 0.0))
    assert (len(found.taxels), found.area) == (9, pytest.approx(9e-4, rel=0.02))
    np.testing.assert_allclose(geometry.areas[[-3, -1]], 1e-4, rtol=1e-9)
    way = geometry.distances(np.array([len(dense)]), np.array([len(geometry) - 1]))[0, 0]
    assert np.hypot(50e-3, 40e-3) <= way < 1.04 * np.hypot(50e-3, 40e-3)


def test_contact_geometry_is_finite_where_everything_is_pressed(prepared):
    for part in ("left_arm", "torso"):
        geometry = prepared(part).geometry
        for counts in (13.0, 255.0, 1e300):
            values = contact_geometry(geometry, np.full(len(geometry), counts))
            assert np.isfinite(values).all()
            assert values[0] > 0


def test_contact_geometry_refuses_nan_and_infinity(plate):
    for bad in (np.nan, np.inf):
        load = disc(plate, 80, 7e-3)
        load[5] = bad
        with pytest.raises(InvalidArrayError, match="NaN or infinity, first at taxel 5"):
            contact_geometry(plate, load)


def test_distances_of_large_skins_are_the_same_without_a_table(plate, monkeypatch, rng):
    rows, columns = rng.integers(0, 168, 5), rng.integers(0, 168, 7)
    kept = plate.distances(rows, columns)
    monkeypatch.setattr(contacts, "DENSE", 10)
    # Single precision of 80 mm.
    np.testing.assert_allclose(plate.distances(rows, columns), kept, atol=1e-8)
