"""The shape of a contact does not depend on how it lies, and hardly on the taxels."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.skin.skin import skin_from_points
from skinmap.touch.contacts.contact_geometry import PAIRS, SIZE, contact_shape
from skinmap.touch.prepared_skin import PreparedSkin


def sheet(pitch):
    """A flat skin of 120 mm with taxels so far apart."""
    axis = np.arange(-60e-3, 60e-3 + 1e-9, pitch)
    x, y = np.meshgrid(axis, axis)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return PreparedSkin(skin_from_points(points, np.tile([0.0, 0.0, 1.0], (len(points), 1))))


def blobs(skin, *centres, wide=8e-3):
    """Pressures of round pieces."""
    found = np.zeros(len(skin))
    for centre in centres:
        away = np.linalg.norm(skin.skin.positions[:, :2] - centre, axis=1)
        found = np.maximum(found, 200.0 * np.clip(1.0 - (away / wide) ** 2, 0.0, None))
    return found


def ring(skin, radius=25e-3):
    """Pressures of the rim of a cup."""
    away = np.linalg.norm(skin.skin.positions[:, :2], axis=1)
    return 200.0 * np.clip(1.0 - ((away - radius) / 6e-3) ** 2, 0.0, None)


def far(one, other):
    return float(np.linalg.norm(one - other))


@pytest.fixture(scope="module")
def fine():
    return sheet(4e-3)


def test_nothing_has_no_shape_and_shares_sum_to_one(fine):
    assert not contact_shape(fine.geometry, np.zeros(len(fine))).any()
    found = contact_shape(fine.geometry, blobs(fine, (0.0, 0.0))) ** 2
    assert found.shape == (SIZE,)
    for first in (0, PAIRS):
        assert found[first : first + PAIRS].sum() == pytest.approx(1.0)


def test_a_touch_that_is_turned_mirrored_or_moved_has_the_same_shape(fine):
    one = contact_shape(fine.geometry, blobs(fine, (-0.02, 0.0), (0.02, 0.008)))
    for centres in (
        ((0.0, -0.02), (-0.008, 0.02)),
        ((0.02, 0.0), (-0.02, 0.008)),
        ((-0.012, 0.004), (0.028, 0.012)),
    ):
        same = far(contact_shape(fine.geometry, blobs(fine, *centres)), one)
        # Paths along a lattice are not the same in all directions.
        assert same < 0.25 * far(contact_shape(fine.geometry, ring(fine)), one)


def test_islands_that_lie_otherwise_have_another_shape(fine):
    coarse, broken = sheet(6e-3), np.random.default_rng(0).random(len(fine)) >= 0.2
    pair, cup = blobs(fine, (-0.025, 0.0), (0.025, 0.0)), ring(fine)
    between = far(contact_shape(fine.geometry, pair), contact_shape(fine.geometry, cup))
    pitch = far(contact_shape(fine.geometry, cup), contact_shape(coarse.geometry, ring(coarse)))
    dead = far(contact_shape(fine.geometry, cup), contact_shape(fine.geometry, cup * broken))
    # Neither another pitch nor a fifth of dead taxels is half as much as another thing.
    assert max(pitch, dead) < 0.5 * between


def test_pressures_of_another_skin_or_no_number_are_refused(fine):
    with pytest.raises(SkinMismatchError):
        contact_shape(fine.geometry, np.zeros(3))
    with pytest.raises(InvalidArrayError):
        contact_shape(fine.geometry, np.full(len(fine), np.nan))
