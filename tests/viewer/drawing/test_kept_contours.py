"""Contours are found once for body and flat map, and not more often than they are wished for."""

import math
from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from viewer.drawing.skin.skin_layer import build_layer
from viewer.drawing.touches import contour_cache as kept_contours
from viewer.drawing.touches.contour_cache import KeptContours
from viewer.drawing.touches.touch_marks import Ground


@pytest.fixture
def pressed(prepared, press):
    """A layer with a touch that has a number, its ground, and how often a field was asked for."""
    layer = build_layer(prepared("torso").mesh)
    pressures, touch = press("torso", 100)
    layer.set_pressures(pressures)
    return layer, Ground.of(layer, layer.places), replace(touch, identity=7)


@pytest.fixture
def asked(monkeypatch):
    found = []
    field = kept_contours.touch_field
    monkeypatch.setattr(
        kept_contours, "touch_field", lambda *what: (found.append(what), field(*what))[1]
    )
    return found


def test_contour_is_found_with_each_sample_unless_a_rate_is_given(pressed, asked):
    layer, ground, touch = pressed
    kept = KeptContours()
    for k in range(10):
        kept.begin(k / 50)
        kept.of(ground, layer, touch, [touch], 0.0)
    assert len(asked) == 10


@pytest.mark.parametrize(("rate", "times"), [(5.0, 10), (25.0, 50), (50.0, 100)])
def test_contour_is_found_as_often_as_the_rate_says(pressed, asked, rate, times):
    """100 samples at 50 Hz: two seconds, of the samples' own clock."""
    layer, ground, touch = pressed
    kept = KeptContours(rate)
    for k in range(100):
        kept.begin(k / 50)
        kept.of(ground, layer, touch, [touch], 0.0)
    assert len(asked) == times


def test_new_touch_and_led_back_recording_are_not_kept_waiting(pressed, asked, press):
    layer, ground, touch = pressed
    other = replace(press("torso", 300)[1], identity=8)
    kept = KeptContours(1.0)
    kept.begin(0.0)
    kept.of(ground, layer, touch, [touch], 0.0)
    kept.begin(0.02)
    kept.of(ground, layer, other, [touch, other], 0.0)
    assert len(asked) == 2
    kept.begin(0.01)
    kept.of(ground, layer, touch, [touch], 0.0)
    assert len(asked) == 3
    nameless = replace(touch, identity=-1)
    for k in range(3):
        kept.begin(0.1 + k / 50)
        kept.of(ground, layer, nameless, [nameless], 0.0)
    assert len(asked) == 6, "what has no number may be another touch each time"


def test_contour_for_two_surfaces_takes_one_field(pressed, asked):
    layer, ground, touch = pressed
    kept = KeptContours()
    kept.begin(0.0)
    one = kept.of(ground, layer, touch, [touch], 0.0)
    two = kept.of(Ground.of(layer, layer.places), layer, touch, [touch], 0.0)
    assert len(asked) == 1
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan])
def test_rate_must_be_above_nothing(rate):
    with pytest.raises(InvalidArrayError, match="more than 0 times"):
        KeptContours(rate)
