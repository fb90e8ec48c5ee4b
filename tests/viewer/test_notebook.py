"""`skinmap.show` in a cell: what a notebook gets, and the frame in a real browser."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest

import skinmap
from skinmap.errors import InvalidArrayError, UnknownNameError
from viewer.picture import show_in_cell as show

PART = "left_foot"


@pytest.fixture
def cell(open_desk):
    """Puts what is shown into a page as a notebook does; the page and its frame."""
    tabs = []

    def put(made):
        tab = open_desk("about:blank")
        tabs.append(tab)
        tab.page.set_content(made._repr_html_())
        return tab, tab.page.frame_locator("iframe")

    yield put
    for tab in tabs:
        assert tab.faults == []
        tab.context.close()


def drawn(frame) -> None:
    frame.locator("body[data-drawn]:not([data-drawn='0'])").wait_for(timeout=60_000)


def test_a_skin_stands_in_a_cell(icub, opengl, cell):
    widget = skinmap.show(icub.skin(PART))
    tab, frame = cell(widget)
    drawn(frame)
    assert frame.locator("#count").inner_text() == f"{len(icub.skin(PART))} taxels"
    assert frame.locator("#layer").input_value() == "pressure"
    picture = tab.page.screenshot()
    assert len(np.unique(np.frombuffer(picture, np.uint8))) > 100


def test_a_flat_map_shows_its_distortion(prepared, opengl, cell):
    _, frame = cell(skinmap.show(prepared(PART).flat))
    drawn(frame)
    assert frame.locator("#layer").input_value() == "distortion"
    assert "% of length" in frame.locator("#bar-unit").inner_text()


def test_where_no_page_can_stand_is_a_still(icub, opengl):
    assert skinmap.show(icub.skin(PART))._repr_png_().startswith(b"\x89PNG")


def test_a_recording_plays_in_a_cell(icub, tmp_path, opengl, cell):
    from click.testing import CliRunner

    from skinmap.cli.main import cli

    path = tmp_path / "t.npz"
    words = ["simulate", "icub", "--part", PART, "--per-gesture", "1", "-o", str(path)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    _, frame = cell(show(path))
    drawn(frame)
    before = frame.locator("#clock").inner_text()
    frame.locator("#play").click()
    for _ in range(600):
        if frame.locator("#clock").inner_text() != before:
            return
        time.sleep(0.05)
    raise AssertionError("it does not play")


def test_a_source_is_watched_and_played_in_a_cell(icub, opengl):
    made = show("sim:seed=2", parts=[PART])
    assert 'id="reel"' in made.content
    assert made.still.startswith(b"\x89PNG")


def test_a_recording_is_of_the_robot_it_names(tmp_path, opengl):
    from skinmap.io.recordings.touch_files import save_recordings

    path, kaspar = tmp_path / "touches.npz", skinmap.load_robot("kaspar")
    recording = skinmap.simulate(kaspar.skin("torso"), per_gesture=1, gestures=["poke"], rng=0)
    save_recordings([recording], path, robot=kaspar)
    assert show(path, seconds=0.5).still.startswith(b"\x89PNG")
    short, long = (show("sim", parts=[PART], seconds=s).content for s in (0.5, 1.5))
    assert len(short) < len(long)
    for thing, parts in ((path, None), ("sim", [PART]), (kaspar.skin("torso"), None)):
        written = skinmap.show(thing, path=tmp_path / "x.html", seconds=0.5, parts=parts)
        assert 'id="reel"' in written.read_text(encoding="utf-8")


def test_a_robot_is_shown_by_its_name(opengl):
    assert show("kaspar", parts=["torso"]).still.startswith(b"\x89PNG")


def test_what_cannot_be_shown_is_said():
    with pytest.raises(UnknownNameError, match="thing to show of type 'int'"):
        show(3)
    with pytest.raises(InvalidArrayError, match="moments are of a robot"):
        skinmap.show(skinmap.load_robot("kaspar").skin("torso"), [])


def test_skins_and_flat_maps_have_a_picture_of_their_own(icub, prepared):
    for thing, words in ((icub.skin(PART), "taxels"), (prepared(PART).flat, "patch")):
        html = thing._repr_html_()
        assert words in html
        assert html.count("<svg") == 1
        assert not any(word in html for word in itertools.chain(("nan", "<script")))
