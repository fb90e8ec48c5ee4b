"""Keys, help, camera and saved views in a real browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from viewer.drawing.frame.camera import preset
from viewer.interaction.controls import KEYS, MOUSE
from viewer.interaction.view_file import SavedView, load_view

PAGE_NAMES = {
    "space": " ",
    "bracketleft": "[",
    "bracketright": "]",
    "plus": "+",
    "minus": "-",
    "comma": ",",
    "period": ".",
}
# What a page leaves to the browser or has no file for, and what it cannot do as the window does.
NOT_HERE = {"s", "q", "Tab", "a"}


@pytest.fixture(scope="module")
def shown(open_desk, start) -> Iterator:
    made = open_desk(start().url, accept_downloads=True)
    made.wait()
    yield made
    assert made.faults == []
    made.context.close()


@pytest.fixture
def tab(shown):
    for key in ("Home", "c", "1", "r", "Escape"):
        shown.page.keyboard.press(key)
    shown.until("skinmap.layer.name === 'pressure'")
    return shown


def test_help_lists_the_window_s_keys_in_its_words(tab):
    tab.page.keyboard.press("h")
    tab.wait("#help")
    listed = dict(
        tab.page.eval_on_selector_all(
            "#help dt", "all => all.map(one => [one.textContent, one.nextSibling.textContent])"
        )
    )
    known = tab.page.evaluate("skinmap.controls.keyNames()")
    for key in KEYS:
        # The first name of each action: the page has no others.
        firsts = {action: name for name, action in reversed(key.actions.items())}
        here = [PAGE_NAMES.get(name, name) for name in firsts.values() if name not in NOT_HERE]
        assert all(name in known or f"Arrow{name}" in known for name in here), key
        if here and key.shown != "1 to 9":
            assert listed[key.shown] == key.text
    assert listed["map"] == dict(MOUSE)["map"]
    box, stage = (tab.page.locator(name).bounding_box() for name in ("#help", "#stage"))
    assert box["y"] >= stage["y"]
    assert box["y"] + box["height"] <= stage["y"] + stage["height"]
    tab.page.keyboard.press("h")
    tab.wait("#help", state="hidden")


def test_keys_lead_the_recording(tab):
    page = tab.page
    page.keyboard.press("ArrowRight")
    tab.wait(".label")
    page.keyboard.press("ArrowLeft")
    tab.wait(".label", state="detached")
    page.keyboard.press("ArrowUp")  # the touch is a second later
    tab.wait(".label")
    page.keyboard.press("Home")
    tab.wait(".label", state="detached")
    page.keyboard.press("+")
    tab.wait("#notice:text-is('speed 2')")
    page.keyboard.press("-")
    tab.wait("#notice:text-is('speed 1')")
    page.keyboard.press("l")
    tab.wait("#loop:checked")
    page.keyboard.press("l")
    tab.wait("#loop:not(:checked)")


def test_keys_choose_layer_style_and_map(tab):
    page = tab.page
    page.keyboard.press("4")
    tab.until("skinmap.layer.name === 'structures'")
    page.keyboard.press("d")
    assert page.locator("#style").input_value() == "discs"
    page.keyboard.press("d")
    before = page.locator("#map-about").inner_text()
    page.keyboard.press("n")
    assert page.locator("#map-about").inner_text() != before
    page.keyboard.press("n")
    assert page.locator("#map-about").inner_text() == before


def test_presets_look_from_where_the_window_s_do(tab):
    from viewer.drawing.frame.camera import View

    first = View(*tab.page.evaluate("skinmap.header.front"))
    for key, name in {"f": "front", "b": "back", "[": "left", "]": "right", "t": "top"}.items():
        tab.page.keyboard.press(key)
        np.testing.assert_allclose(
            tab.page.evaluate("skinmap.camera.direction"),
            preset(name, first).direction,
            atol=1e-12,  # the same angles in double precision
        )
        assert tab.page.locator("#view").input_value() == name


def test_focus_brings_the_touch_to_the_middle_and_close(tab):
    tab.page.keyboard.press("g")
    assert tab.page.locator("#notice").inner_text() == "nothing is touched"
    tab.step()
    tab.wait(".label")
    far = tab.page.evaluate("skinmap.camera.distance")
    tab.page.keyboard.press("g")
    assert tab.page.evaluate("skinmap.camera.distance") < 0.8 * far
    x, y = tab.page.evaluate(
        """() => {
          const { picture, camera, header, sample } = skinmap;
          const { part, centre: [x, y, z] } = sample.header.touches[0];
          const m = picture.model(header.parts.find(({ name }) => name === part).link);
          const at = (i) => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i];
          return camera.project([0, 1, 2].map(at));
        }"""
    )
    assert (x, y) == pytest.approx((0.5, 0.5), abs=1e-6)  # poses are in single precision


def test_a_saved_view_is_a_file_of_the_window_s_and_comes_back(tab, tmp_path):
    page = tab.page
    for key in ("4", "d", "t"):
        page.keyboard.press(key)
    tab.until("skinmap.layer.name === 'structures'")
    page.evaluate("skinmap.enclose([5, 6, 7], false)")
    at = page.evaluate("[...skinmap.camera.matrix]")
    with page.expect_download() as download:
        page.keyboard.press("v")
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    view = load_view(path)
    assert (path.name, view.robot, view.layer) == ("skinmap-view.json", "iCub", "structures")
    assert (view.style, view.selection) == ("discs", {"torso": (5, 6, 7)})
    for key in ("1", "d", "r", "c"):
        page.keyboard.press(key)
    tab.until("skinmap.layer.name === 'pressure'")
    page.keyboard.press("V")
    tab.until("skinmap.layer.name === 'structures'")
    np.testing.assert_allclose(
        page.evaluate("[...skinmap.camera.matrix]"), at, atol=1e-6
    )  # matrices in single precision
    assert page.evaluate("[skinmap.picture.style, ...skinmap.chosen.numbers]") == ["discs", 5, 6, 7]
    page.keyboard.press("d")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("{", "no saved view: not JSON text"),
        ({"format": "x"}, 'no saved view: "format": "skinmap-view" expected'),
        ({"version": 9}, "view of version 9; this Skinmap reads version 1"),
        ({"robot": "Baxter"}, "the view was saved of 'Baxter', this robot is 'iCub'"),
        ({"layer": "heat"}, "no layer 'heat'"),
        ({"selection": {"torso": [100000]}}, "the view's selection names taxel 100000"),
        ({"selection": {"wing": [0]}}, "no part in this scene 'wing'"),
        ({"camera": {"position": [1, 2]}}, "damaged view: camera"),
    ],
)
def test_a_view_of_something_else_is_told_and_changes_nothing(tab, tmp_path, change, message):
    page = tab.page
    page.keyboard.press("2")
    tab.until("skinmap.layer.name === 'raw'")
    content = change
    if isinstance(change, dict):
        saved = page.evaluate("skinmap.controls.view()")
        content = json.dumps(saved | {"layer": "binary"} | change)
    path = Path(tmp_path / "view.json")
    path.write_text(content)
    with page.expect_file_chooser() as chooser:
        page.click("#view-load")
    chooser.value.set_files(path)
    tab.wait(f"#notice:has-text({json.dumps(message)})")
    assert "\n" not in page.locator("#notice").inner_text()
    assert page.evaluate("skinmap.layer.name") == "raw"


def test_a_page_begins_with_the_view_it_is_given(open_desk, start):
    view = SavedView(
        "iCub", (1.0, 0.5, 0.4), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0), 22.0,
        layer="distortion", style="discs", part="left_arm", selection={"left_arm": (3, 4)},
    )  # fmt: skip
    tab = open_desk(start(view=view).url)
    tab.until("skinmap.layer.name === 'distortion'")
    said = tab.page.evaluate("skinmap.controls.view()")
    assert (said["style"], said["part"]) == ("discs", "left_arm")
    assert said["selection"] == {"left_arm": [3, 4]}
    np.testing.assert_allclose(said["camera"]["position"], view.position, atol=1e-9)
    assert tab.faults == []
    tab.context.close()
