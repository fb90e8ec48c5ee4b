"""Choosing taxels: modules, patches, lassos. No picture, no VTK."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewer.interaction.mouse import Lasso, Mouse, Pace, Selection, inside, reached

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])


def test_selection_replaces_adds_and_lets_go():
    chosen = Selection()
    chosen.replace("arm", [3, 1, 3])
    assert chosen["arm"].tolist() == [1, 3]
    chosen.toggle("leg", [5])
    assert (chosen.count, set(chosen)) == (3, {"arm", "leg"})
    chosen.toggle("arm", [1])
    assert chosen.taxels("arm").tolist() == [3]
    chosen.toggle("arm", [1, 3])
    assert chosen.taxels("arm").tolist() == [1, 3], "not all were chosen: they are added"
    chosen.replace("leg", [2])
    assert dict(chosen).keys() == {"leg"}
    chosen.clear()
    assert chosen.count == 0
    assert chosen.taxels("leg").tolist() == []


def test_one_click_reaches_a_taxel_its_module_or_its_patch(prepared):
    mesh = prepared("left_arm").mesh
    skin, taxel = mesh.skin, 100
    assert reached(mesh, taxel, "taxel").tolist() == [taxel]
    module = reached(mesh, taxel, "module")
    assert taxel in module
    assert set(skin.modules[module]) == {skin.modules[taxel]}
    assert len(module) == (skin.modules == skin.modules[taxel]).sum()
    patch = reached(mesh, taxel, "patch")
    assert set(module) <= set(patch)
    # Every triangle lies in one patch: none has corners inside and outside.
    corners = np.isin(mesh.faces, patch).sum(axis=1)
    assert set(corners.tolist()) <= {0, 3}


def test_lasso_holds_what_lies_inside_and_nothing_else():
    points = np.array([[2.0, 2.0], [5.0, 2.0], [-1.0, 1.0], [2.0, 9.0], [np.nan, 1.0]])
    assert inside(SQUARE, points).tolist() == [True, False, False, False, False]
    star = np.array([[0, 3], [4, 3], [0.7, 0], [2, 5], [3.3, 0]], float)
    assert inside(star, [[2.0, 2.0]]).tolist() == [False], "even-odd: the middle of a star is out"
    assert inside(star, [[2.0, 4.0]]).tolist() == [True]


@given(
    st.lists(st.tuples(st.floats(0.05, 1.0), st.floats(-1, 1), st.floats(-1, 1)), min_size=1),
    st.integers(0, 7),
)
def test_lasso_of_any_corner_order_agrees_with_the_disc_it_follows(points, start):
    """A many-sided polygon and the circle around it agree but for the sliver between them."""
    angle = np.arange(64) * 2 * np.pi / 64
    circle = np.roll(np.column_stack([np.cos(angle), np.sin(angle)]), start, axis=0)
    places = np.array([[x, y] for _, x, y in points])
    radius = np.hypot(*places.T)
    sure = (radius < np.cos(np.pi / 64) - 1e-9) | (radius > 1.0 + 1e-9)
    assert np.array_equal(inside(circle, places)[sure], (radius < 1.0)[sure])
    assert np.array_equal(inside(circle[::-1], places)[sure], (radius < 1.0)[sure])


def test_lasso_adds_no_corner_where_the_mouse_hardly_moved():
    lasso = Lasso(0, 0)
    assert not lasso.to(1, 0)
    assert lasso.to(10, 0)
    assert not lasso.drawn
    lasso.to(10, 10)
    assert lasso.drawn
    assert lasso.holds([[8.0, 3.0], [2.0, 8.0]]).tolist() == [True, False]


class Told:
    """Notes what the mouse tells."""

    def __init__(self) -> None:
        self.calls: list[tuple] = []

    def over_slider(self, x, y):
        return y < 10

    def over_lanes(self, x, y):
        return 10 <= y < 20

    def over_map(self, x, y):
        return x > 500

    def __getattr__(self, name):
        return lambda *words, **named: self.calls.append((name, *words, *named.items()))

    def names(self) -> list[str]:
        return [call[0] for call in self.calls if call != ("trace", None)]


def test_mouse_slides_draws_lassos_clicks_and_points():
    told = Told()
    mouse = Mouse(told)
    assert mouse.press(50, 5)
    assert mouse.move(60, 200), "the handle is held wherever the mouse goes"
    assert mouse.release(60, 200)
    assert told.names() == ["slide", "slide"]
    told.calls.clear()
    assert mouse.press(50, 15)
    assert mouse.move(80, 15), "the lanes are moved"
    mouse.release(80, 15)
    mouse.press(90, 15)
    mouse.release(90, 15)
    assert told.calls[0] == ("pan", 30)
    assert told.names() == ["pan", "slide"], "a click goes there"
    told.calls.clear()
    assert mouse.press(600, 100)
    for x, y in ((620, 100), (620, 120), (600, 120)):
        assert mouse.move(x, y)
    mouse.release(590, 110, shift=True)
    assert told.names() == ["trace", "trace", "trace", "enclose"]
    assert ("add", True) in told.calls[-1]
    told.calls.clear()
    assert not mouse.press(100, 100), "the camera hears of it"
    assert not mouse.move(150, 100)
    mouse.release(150, 100)
    assert told.names() == [], "a drag on the body turns the camera and chooses nothing"
    mouse.move(151, 100)
    assert told.names() == ["point"]


@pytest.mark.parametrize(
    ("shift", "control", "reach", "add"),
    [
        (False, False, "taxel", False),
        (True, False, "module", False),
        (False, True, "patch", False),
        (True, True, "module", True),
    ],
)
def test_click_with_keys_reaches_further(shift, control, reach, add):
    for x in (100, 600):  # on the body and on the map
        told = Told()
        mouse = Mouse(told)
        mouse.press(x, 100)
        mouse.move(x + 1, 100)
        mouse.release(x + 1, 101, shift=shift, control=control)
        assert told.calls[-1] == ("click", x + 1, 101, reach, ("add", add))


def test_pace_lets_through_one_in_a_period():
    now = [0.0]
    pace = Pace(0.1, lambda: now[0])
    seen = []
    for k in range(100):
        now[0] = k * 0.01
        seen.append(pace.due())
    # Every tenth of a second of one second, give or take the rounding of hundredths.
    assert 9 <= sum(seen) <= 10
