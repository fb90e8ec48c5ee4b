"""The page of `skinmap label --web`: its keys are the terminal's; other pages are refused."""

from __future__ import annotations

import json
import urllib.error
import urllib.request

import numpy as np
import pytest

import skinmap
from skinmap.io.recordings.marks import Marks
from skinmap.io.recordings.recorded_stream import MarkedTouch, RecordedStream, StreamInfo
from viewer.labelling import LabelServer

PART = "left_hand"


@pytest.fixture
def server():
    """Two pokes in a hundred samples of a hand."""
    robot = skinmap.load_robot("kaspar")
    values = np.zeros((100, len(robot.skin(PART))), np.uint8)
    values[10:30, :9] = 90
    values[18:22, :9] = 20
    values[60:70, 40:50] = 200
    marks = Marks((MarkedTouch(PART, 0, "rub", 10, 29), MarkedTouch(PART, 1, "rub", 60, 69)))
    track = RecordedStream(
        StreamInfo("t", (PART,), (values.shape[1],), 50.0), np.arange(100) / 50.0, values
    )
    with LabelServer(marks, track, robot, "t.mcap") as made:
        yield made


def press(server, key, rest="", **headers):
    body = json.dumps({"key": key, "rest": rest}).encode()
    request = urllib.request.Request(f"{server.url}press", body, headers)
    with urllib.request.urlopen(request, timeout=10) as answer:
        return json.load(answer)


def test_keys_change_the_touches_and_write_ends(server):
    assert press(server, "look")["shown"].startswith("1/2 left_hand 0.20 to 0.58 s (20 samples)")
    told = press(server, "s")
    assert [one[1] for one in told["touches"]] == pytest.approx([0.2, 0.36, 1.2])
    assert press(server, "n", "jab")["touches"][0][3] == "jab"
    assert press(server, "n", "a\x00b")["error"].startswith("a label without control characters")
    assert len(press(server, "d")["touches"]) == 2
    assert not server.done.is_set()
    press(server, "w")
    assert server.done.is_set()
    assert server.written
    assert [one.label for one in server.editor.marks.touches] == ["jab", "rub"]


def test_picture_shows_the_taxels_that_were_touched(server):
    press(server, "")
    peak = np.array(press(server, "look")["picture"]["peak"])
    assert np.flatnonzero(peak > 0.5).tolist() == list(range(40, 50))


@pytest.mark.parametrize(
    ("token", "headers"),
    [("", {"Origin": "http://elsewhere"}), ("x" * 32, {}), ("", {"Host": "evil"})],
)
def test_other_pages_are_refused(server, token, headers):
    url = server.url.replace(server.guard.token, token or server.guard.token)
    request = urllib.request.Request(f"{url}press", b"{}", headers)
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(request, timeout=10)
    assert len(server.editor.marks) == 2


@pytest.mark.parametrize("body", [b"", b"no json", b"[]", b'{"rest": 1}', b"x" * 5000])
def test_requests_that_are_none_change_nothing(server, body):
    request = urllib.request.Request(f"{server.url}press", body)
    with pytest.raises(urllib.error.HTTPError, match="400"):
        urllib.request.urlopen(request, timeout=10)
    assert len(server.editor.marks) == 2


def test_the_page_names_splits_and_writes(server, open_tab):
    tab = open_tab(server.url, viewport={"width": 1250, "height": 900})
    tab.wait('#shown:has-text("1/2")')
    tab.page.fill("#word", "jab")
    tab.page.click("text=Name (Enter)")
    tab.wait('#shown:has-text("2/2")')
    tab.page.click("text=Back")
    tab.wait('#shown:has-text("1/2")')
    tab.page.keyboard.press("s")
    tab.wait('#shown:has-text("1/3")')
    tab.page.click("text=Write")
    tab.wait('#error:has-text("written")')
    assert server.written
    assert [one.label for one in server.editor.marks.touches] == ["jab", "jab", "rub"]
    assert not tab.faults
