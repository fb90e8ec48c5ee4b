"""Pointing, choosing, lasso and traces in a real browser, beside what the window does."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from viewer import Layers
from viewer.interaction.mouse import inside
from viewer.interaction.pointing import describe, lines
from viewer.web.server import WebServer

PLACE = """(taxel) => {
  const number = skinmap.header.parts[0].taxels[0] + taxel;
  return skinmap.pointer.ofMap(number).slice(0, 2);
}"""


@pytest.fixture(scope="module")
def shown(open_desk, start) -> Iterator:
    """The touch in the middle of the chest, for all tests here."""
    server: WebServer = start()
    made = open_desk(server.url)
    made.wait()
    made.step()
    made.wait(".label")
    made.page.select_option("#map-part", "torso")
    made.until("skinmap.flat.ready && skinmap.flat.part.name === 'torso'")
    yield made
    assert made.faults == []
    made.context.close()


@pytest.fixture
def tab(shown):
    shown.page.keyboard.press("c")
    shown.page.mouse.move(2, 2)
    return shown


def on_map(tab, taxel: int) -> list[float]:
    return tab.page.evaluate(PLACE, taxel)


def chosen(tab) -> list[int]:
    """Dense rows on the chest, which is the first part."""
    return tab.page.evaluate("[...skinmap.chosen.numbers].sort((a, b) => a - b)")


@pytest.mark.parametrize("layer", ["pressure", "distortion", "binary"])
def test_the_box_at_a_taxel_says_what_the_window_s_says(tab, moments, prepared, layer):
    tab.page.select_option("#layer", layer)
    tab.until(f"skinmap.layer.name === '{layer}'")
    taxel = int(moments[1].touches[0].taxels[0])
    tab.page.mouse.move(*on_map(tab, taxel))
    tab.wait("#hover:has-text('structure'):not(:has-text('being found'))")
    layers = Layers({part: prepared(part) for part in ("torso", "left_arm")})
    expected = lines(describe(layers, "torso", taxel, moments[1], shown=layer))
    said = tab.page.locator("#hover").inner_text().split("\n")
    assert [line.replace("-0.00", "0.00") for line in expected] == said
    assert tab.page.locator("#hover-ring").is_visible()
    tab.page.mouse.move(2, 2)
    tab.wait("#hover", state="hidden")


def test_clicks_choose_taxel_module_and_patch(tab, icub, prepared):
    skin, taxel = icub.skin("torso"), 100
    x, y = on_map(tab, taxel)
    tab.page.mouse.click(x, y)
    assert chosen(tab) == [taxel]
    with tab.held("Shift"):
        tab.page.mouse.click(x, y)
    module = np.flatnonzero(skin.modules == skin.modules[taxel]).tolist()
    assert chosen(tab) == module
    with tab.held("Control"):
        tab.page.mouse.click(x, y)
    patches = prepared("torso").patches
    assert chosen(tab) == np.flatnonzero(patches == patches[taxel]).tolist()
    tab.page.mouse.click(x, y)
    other = int(np.flatnonzero(skin.modules != skin.modules[taxel])[0])
    with tab.held("Shift", "Control"):  # both: its module beside what is chosen
        tab.page.mouse.click(*on_map(tab, other))
    added = np.flatnonzero(skin.modules == skin.modules[other]).tolist()
    assert chosen(tab) == sorted([taxel, *added])
    box = tab.page.locator("#picture").bounding_box()
    tab.page.mouse.click(box["x"] + 3, box["y"] + box["height"] / 3)  # beside the robot
    assert chosen(tab) == []
    assert tab.page.locator("#pick").is_hidden()


def test_a_lasso_chooses_what_it_encloses_and_shift_adds(tab):
    box = tab.page.locator("#flat").bounding_box()

    def draw(shares) -> list[tuple[float, float]]:
        corners = [(box["x"] + u * box["width"], box["y"] + v * box["height"]) for u, v in shares]
        tab.page.mouse.move(*corners[0])
        tab.page.mouse.down()
        for corner in corners[1:]:
            tab.page.mouse.move(*corner)
        tab.page.mouse.up()
        return corners

    count = tab.page.evaluate("skinmap.header.parts[0].taxels[1]")
    places = np.array([on_map(tab, taxel) for taxel in range(count)])
    left = draw([(0.01, 0.01), (0.5, 0.02), (0.45, 0.6), (0.01, 0.5)])
    within = np.flatnonzero(inside(left, places)).tolist()
    assert len(within) > 50
    # The mouse is told in whole pixels: taxels on the line itself may be on either side of it.
    assert len(np.setxor1d(chosen(tab), within)) <= 3
    assert f"{len(chosen(tab))} taxels chosen" in tab.page.locator("#chosen-count").inner_text()
    with tab.held("Shift"):
        right = draw([(0.55, 0.5), (0.99, 0.5), (0.99, 0.99), (0.55, 0.99)])
    both = np.flatnonzero(inside(left, places) | inside(right, places))
    assert len(np.setxor1d(chosen(tab), both)) <= 6
    assert len(both) > len(within) + 50


def test_traces_of_chosen_taxels_show_what_was_felt(tab, moments, icub):
    touch = moments[1].touches[0]
    tab.page.mouse.click(*on_map(tab, int(touch.taxels[0])))
    tab.wait("#traces")
    channel = icub.skin("torso").channels[touch.taxels[0]]
    assert tab.page.locator("#traces h2").inner_text() == "torso, counts by channel"
    assert tab.page.locator("#traces li").all_inner_texts() == [str(channel)]
    tab.until("() => skinmap.traces.told.times.length > 1")
    rest, felt = tab.page.evaluate("() => skinmap.traces.told.lines[0].slice(-2)")
    assert rest == 0
    assert felt == pytest.approx(200, abs=0.01)
    tints = tab.page.evaluate(
        """() => {
          const canvas = document.querySelector("#traces canvas");
          const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
          let count = 0; // pixels of the first trace's blue, #0b3d91
          for (let k = 0; k < data.length; k += 4) {
            count += data[k + 3] > 128 && data[k + 2] > data[k] + 60;
          }
          return count;
        }"""
    )
    assert tints > 20
    tab.page.keyboard.press("c")
    tab.wait("#traces", state="hidden")


def test_traces_of_a_module_are_their_mean_and_largest(tab):
    with tab.held("Shift"):
        tab.page.mouse.click(*on_map(tab, 100))
    tab.wait("#traces")
    names = tab.page.locator("#traces li").all_inner_texts()
    assert names == ["mean", f"largest of {len(chosen(tab))} taxels"]
