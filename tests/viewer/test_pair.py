"""Layers and windows of two scenes that stand side by side."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment
from viewer.layers import Layers, Pair

PART = "torso"


def seen(layers: Layers, pressures: np.ndarray, touches=()) -> Moment:
    moment = Moment(0.0, {PART: pressures}, touches=tuple(touches))
    layers.observe(moment)
    return moment


@pytest.fixture
def two(prepared) -> tuple[Layers, Layers]:
    return Layers({PART: prepared(PART)}), Layers({PART: prepared(PART)}, ranges={"raw": (0, 90)})


def test_the_layer_difference_is_right_less_left_on_both_sides(two, prepared):
    left, right = two
    n = len(prepared(PART))
    alone = left.get("difference")
    assert "--beside" in alone.missing
    assert np.isnan(alone.values(PART, None)).all()
    Pair(left, right)
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 256, (2, n)).astype(float)
    now = seen(left, a)
    assert np.isnan(left.get("difference").values(PART, now)).all(), "nothing seen at the right"
    seen(right, b)
    for side in (left, right):
        assert np.array_equal(side.get("difference").values(PART, now), b - a)


def test_both_sides_have_one_scale(two):
    left, right = two
    assert right.get("raw").limits == (0, 90)
    Pair(left, right)
    assert left.get("raw").limits == right.get("raw").limits == (0.0, 255.0)
    assert left.get("health").limits == right.get("health").limits


def test_skins_that_differ_have_no_difference(prepared, icub):
    left, right = Layers({PART: prepared(PART)}), Layers({"left_arm": prepared("left_arm")})
    pair = Pair(left, right)
    assert pair.parts == ()
    layer = left.get("difference")
    assert layer.missing == "no skin in common"
    assert np.isnan(layer.values(PART, seen(left, np.ones(len(prepared(PART)))))).all()


def test_windows_follow_each_other(icub, prepared, wandering, opengl):
    from viewer import Player, Scene
    from viewer.window import Mirror, Window

    windows = []
    for first in (20, 120):
        skin = prepared(PART)
        scene = Scene(
            icub, {PART: skin.mesh}, {PART: skin.flat}, links=["chest"], window_size=(320, 240)
        )
        moments = [Moment(m.time, {PART: m.pressures[PART]}) for m in wandering[first:]]
        windows.append(Window(scene, Player(moments, paused=True)))
    left, right = windows
    Pair(left.scene.data, right.scene.data)
    mirror = Mirror(left, right)
    for window in windows:
        window.scene.show_moment(next(iter(window.player._feed._moments)))
        window.scene.update()
    mirror.turn()
    right.scene.set_layer("difference")
    right.scene.set_style("discs")
    left.scene.look(77.0)
    left.scene.update(360.0)
    mirror.turn()
    assert (left.scene.layer.name, left.scene.style) == ("difference", "discs")
    mirror.turn()
    assert right.scene.plotter.camera.position == left.scene.plotter.camera.position
    shown = left.scene.layer.values(PART, left.scene.moment)
    assert (shown[20], shown[120]) == (-200.0, 200.0)
    right.scene.plotter.camera.azimuth += 30.0
    mirror.turn()
    assert left.scene.plotter.camera.position == right.scene.plotter.camera.position
    for window in windows:
        window.close()
