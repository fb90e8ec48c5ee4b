"""Sheets drawn as one look like sheets drawn one by one, and are chosen where most parts change."""

import numpy as np
import pytest

from viewer.drawing.skin import skin_view as joined

PARTS = ("torso", "left_arm")
CALM = 3


@pytest.fixture(autouse=True)
def soon_calm(monkeypatch):
    monkeypatch.setattr(joined, "CALM", CALM)


@pytest.fixture
def two_will_do(at_rest, monkeypatch):
    """The scene of two parts, for which joining is worth it here."""
    monkeypatch.setattr(joined, "LEAST", 2)
    yield at_rest
    calm(at_rest)


def calm(scene):
    """Pictures in which no part changes."""
    for _ in range(CALM + 1):
        scene.canvas.changed = True
        scene.refresh()
    assert not scene.canvas.joined.on


def press(scene, seed):
    rng = np.random.default_rng(seed)
    for part in PARTS:
        scene.set_pressures(part, rng.uniform(0.0, 255.0, len(scene.layers[part].skin)))


def pictures(scene):
    """From two sides, and with another pose in between."""
    found = []
    for turn, bend in ((0.0, 0.0), (40.0, 0.0), (40.0, 0.3)):
        scene.look(scene.front.azimuth + turn)
        scene.set_pose({"l_shoulder_roll": 0.5 + bend})
        press(scene, int(turn) + 7)
        found.append(scene.frame().astype(int))
    return np.array(found)


def test_joined_sheets_look_like_single_ones(at_rest, monkeypatch):
    single = pictures(at_rest)
    assert not at_rest.canvas.joined.on
    monkeypatch.setattr(joined, "LEAST", 2)
    together = pictures(at_rest)
    assert at_rest.canvas.joined.on
    # Single floats of places in two frames: an edge may fall to the pixel beside it.
    apart = (np.abs(single - together).max(axis=3) > 2).mean()
    assert apart < 2e-4
    at_rest.set_pose({})
    calm(at_rest)


def test_joined_pictures_are_those_drawn_anew(two_will_do):
    scene = two_will_do
    for seed in range(4):
        press(scene, seed)
        shown = scene.frame()
        assert scene.canvas.joined.on
        scene.canvas.cache.forget()
        np.testing.assert_array_equal(shown, scene.frame())


def test_sheets_part_again_when_few_change_or_discs_are_shown(two_will_do):
    scene = two_will_do
    press(scene, 1)
    scene.refresh()
    assert scene.canvas.joined.on
    scene.set_style("discs")
    scene.refresh()
    assert not scene.canvas.joined.on
    scene.set_style("surface")
    press(scene, 2)
    scene.refresh()
    assert scene.canvas.joined.on
    calm(scene)


def test_change_of_ways_shows_no_coarse_picture(two_will_do):
    scene = two_will_do
    press(scene, 3)
    scene.refresh()
    scene.look(scene.front.azimuth)
    calm(scene)
    press(scene, 4)
    scene.refresh()
    assert scene.canvas.joined.on
    assert not scene.canvas.cache.renderers[0].quick
    shown = scene.frame()
    scene.canvas.cache.forget()
    np.testing.assert_array_equal(shown, scene.frame())
