from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import SkinMismatchError
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.contact_geometry import FEATURES, contact_geometry
from skinmap.touch.contacts import find_contacts, measure_skin, pool_event, pressed


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
    active, label = find_contacts(plate, disc(plate, 26, 1e-3) + 2 * disc(plate, 136, 1e-3))
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
