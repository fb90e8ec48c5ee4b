"""Contours are found once for body and flat map."""

from dataclasses import replace

import numpy as np
import pytest

from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.touches import touch_marks as kept_contours
from viewer.drawing.touches.touch_marks import Ground, KeptContours


@pytest.fixture
def pressed(prepared, press):
    """A layer with a touch that has a number, its ground, and how often a field was asked for."""
    layer = SkinLayer(prepared("torso").mesh)
    pressures, touch = press("torso", 100)
    layer.set_pressures(pressures)
    return layer, Ground(layer, layer.places), replace(touch, identity=7)


@pytest.fixture
def asked(monkeypatch):
    found = []
    field = kept_contours.touch_field
    monkeypatch.setattr(
        kept_contours, "touch_field", lambda *what: (found.append(what), field(*what))[1]
    )
    return found


def test_contour_is_found_with_each_sample(pressed, asked):
    layer, ground, touch = pressed
    kept = KeptContours()
    for _ in range(10):
        kept.forget()
        kept.of(ground, layer, touch, [touch], 0.0)
    assert len(asked) == 10


def test_contour_for_two_surfaces_takes_one_field(pressed, asked):
    layer, ground, touch = pressed
    kept = KeptContours()
    one = kept.of(ground, layer, touch, [touch], 0.0)
    two = kept.of(Ground(layer, layer.places), layer, touch, [touch], 0.0)
    assert len(asked) == 1
    np.testing.assert_array_equal(one, two)
