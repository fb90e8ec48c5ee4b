"""Two pages side by side in a real Chromium: one camera, layer and time, and the difference."""

from __future__ import annotations

import http.client
import time
from collections.abc import Callable, Iterator

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from viewer.view_options import Look, Session
from viewer.web.server import WebServer, served

PART = "torso"
DRAWN = "body[data-drawn]:not([data-drawn='0'])"
WIDE = {"width": 1400, "height": 600}


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> list[str]:
    made = []
    for seed in ("1", "2"):
        path = tmp_path_factory.mktemp("pair") / f"{seed}.npz"
        words = ["simulate", "icub", "--part", PART, "--per-gesture", "2", "--seed", seed]
        assert CliRunner().invoke(cli, [*words, "-o", str(path)]).exit_code == 0
        made.append(str(path))
    return made


@pytest.fixture
def pair(icub, prepared, opengl, sources) -> Iterator[Callable[..., WebServer]]:
    left, right = (
        Session(icub, (PART,), source=source, skins={PART: prepared(PART)}) for source in sources
    )
    with served(left, Look(links="skin"), other=right, later=0.5) as (server, _):
        yield server


def answer(server: WebServer, path: str, **headers: str) -> tuple[int, dict[str, str]]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", f"/{server.guard.token}/{path}", headers=headers)
    found = connection.getresponse()
    found.read()
    connection.close()
    return found.status, dict(found.getheaders())


def test_each_side_has_its_files_and_only_our_pages_frame_them(pair):
    for path in ("", "pair.css", "left/", "right/", "left/main.js", "right/scene.bin"):
        status, headers = answer(pair, path)
        assert status == 200, path
        assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]
    for path in ("main.js", "scene.bin", "middle/", "left/pair.css", "left/right/", "live"):
        assert answer(pair, path)[0] == 404, path
    assert answer(pair, "left/", Origin="http://127.0.0.1:1")[0] == 403
    connection = http.client.HTTPConnection("127.0.0.1", pair.port, timeout=20)
    connection.request("GET", "/left/main.js")
    assert connection.getresponse().status == 403, "no token"


def test_a_single_page_is_framed_by_none(server, get):
    _, _, headers = get(f"/{server.guard.token}/")
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert get(f"/{server.guard.token}/left/")[0] == 404


def agree(tab, frames, expression: str) -> None:
    """Wait until both sides hold the same: the clock's letter comes before the sample's values."""
    end = time.monotonic() + 60.0
    while True:
        left, right = (frames[side].evaluate(expression) for side in ("left", "right"))
        if left == right:
            return
        assert time.monotonic() < end, (expression, left, right)
        tab.page.wait_for_timeout(20)


def test_what_is_done_to_one_side_is_done_to_both(pair, open_tab):
    tab = open_tab(pair.url, viewport=WIDE)
    left, right = (tab.page.frame_locator(f"iframe[title='{side}']") for side in ("left", "right"))
    for side, name in ((left, "left: iCub, 1.npz"), (right, "right: iCub, 2.npz")):
        side.locator(DRAWN).wait_for(timeout=60_000)
        side.locator(f"#robot:has-text('{name}')").wait_for()
    left.locator("#play").click()
    right.locator("#play[aria-label='play']").wait_for()
    right.locator("#layer").select_option("difference")
    left.locator("#bar-title:has-text('difference')").wait_for()
    left.locator("#view").select_option("back")
    left.locator("#style").select_option("discs")
    frames = {frame.url.rsplit("/", 2)[1]: frame for frame in tab.page.frames[1:]}
    for control in ("#view", "#style"):
        agree(tab, frames, f"document.querySelector('{control}').value")
    assert frames["right"].evaluate("document.querySelector('#view').value") == "back"
    agree(tab, frames, "[...window.skinmap.camera.matrix]")
    left.locator("#time").fill("2")
    right.locator("#clock:has-text('2.50 /')").wait_for()  # it stands half a second later
    right.locator("#on").click()
    left.locator("#clock:has-text('2.02 /')").wait_for()
    right.locator("#clock:has-text('2.52 /')").wait_for()
    agree(tab, frames, "Array.from(window.skinmap.sample.arrays.values)")
    assert tab.faults == []
    tab.context.close()
