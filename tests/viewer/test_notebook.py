"""`skinmap.show` in a cell: what a notebook gets, and the frame in a real browser."""

from __future__ import annotations

import asyncio
import base64
import itertools
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import skinmap
from skinmap.errors import InvalidArrayError, MissingLibraryError, UnknownNameError
from skinmap.live.sources.simulated_source import SimulatedSource

pytest.importorskip("anywidget", reason="anywidget is not here: pip install 'skinmap[notebook]'")
from viewer.notebook import show

PART = "left_foot"
# A notebook's side of anywidget: a model, a place, and messages both ways.
HOST = """async ([esm, state]) => {
  window.sent = [];
  const heard = new Set();
  const model = {
    get: (name) => state[name],
    send: (content) => window.sent.push(content),
    on: (_, act) => heard.add(act),
    off: (_, act) => heard.delete(act),
  };
  window.deliver = (content, bytes) => {
    const plain = bytes && Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0));
    for (const act of heard) act(content, plain ? [new DataView(plain.buffer)] : []);
  };
  const cell = (await import(`data:text/javascript;base64,${btoa(esm)}`)).default;
  window.leave = cell.render({ model, el: document.body });
}"""


@pytest.fixture
def cell(open_desk):
    """Puts a widget into a page as a notebook does; the page and its frame."""
    tabs = []

    def put(widget):
        tab = open_desk("about:blank")
        tabs.append(tab)
        tab.page.evaluate(HOST, [widget._esm, {"content": widget.content, "height": widget.height}])
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


def test_a_saved_notebook_keeps_a_still(icub, opengl):
    widget = skinmap.show(icub.skin(PART))
    data, _ = widget._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in data
    assert base64.b64decode(data["image/png"]).startswith(b"\x89PNG")


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


def test_a_live_source_goes_on_in_a_cell(icub, opengl, cell):
    """Its samples come over the notebook's own messages, and the page's wishes go back."""
    events = asyncio.new_event_loop()
    thread = threading.Thread(target=events.run_forever, daemon=True)
    thread.start()
    outbox: list[tuple[dict, str | None]] = []

    async def make():
        widget = show(SimulatedSource(icub, parts=[PART], seed=2))
        widget.send = lambda content, buffers=None: outbox.append(
            (content, base64.b64encode(buffers[0]).decode() if buffers else None)
        )
        return widget

    widget = asyncio.run_coroutine_threadsafe(make(), events).result(60)
    tab, frame = cell(widget)

    def pump(until) -> None:
        for _ in range(3000):
            for content in tab.page.evaluate("() => window.sent.splice(0)"):
                events.call_soon_threadsafe(widget._handle_custom_msg, content, [])
            while outbox:
                tab.page.evaluate("(message) => window.deliver(...message)", list(outbox.pop(0)))
            if until():
                return
            tab.page.wait_for_timeout(10)
        raise AssertionError("nothing came")

    body = frame.locator("body")
    pump(lambda: int(body.get_attribute("data-drawn") or 0) > 20)
    frame.locator("#play").click()
    pump(lambda: frame.locator("#play").get_attribute("aria-label") == "play")
    tab.page.evaluate("() => window.leave()")
    for content in tab.page.evaluate("() => window.sent.splice(0)"):
        events.call_soon_threadsafe(widget._handle_custom_msg, content, [])
    events.call_soon_threadsafe(widget.end)
    events.call_soon_threadsafe(events.stop)
    thread.join(10)


def test_what_cannot_be_shown_is_said(icub, monkeypatch):
    with pytest.raises(UnknownNameError, match="thing to show of type 'int'"):
        show(3)
    source = SimulatedSource(icub, parts=[PART])
    with ThreadPoolExecutor(1) as plain:  # where no event loop runs
        asked = plain.submit(show, source)
    with pytest.raises(InvalidArrayError, match="skinmap view --web"):
        asked.result()
    source.close()
    from viewer import notebook

    notebook._kind.cache_clear()
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(MissingLibraryError, match=r"skinmap\[notebook\]"):
        notebook.widget("", None, 100)
    notebook._kind.cache_clear()


def test_skins_and_flat_maps_have_a_picture_of_their_own(icub, prepared):
    for thing, words in ((icub.skin(PART), "taxels"), (prepared(PART).flat, "patch")):
        html = thing._repr_html_()
        assert words in html
        assert html.count("<svg") == 1
        assert not any(word in html for word in itertools.chain(("nan", "<script")))
