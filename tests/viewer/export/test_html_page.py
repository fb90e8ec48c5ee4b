"""The page that holds everything itself: what is in it, and that nothing leaves it."""

from __future__ import annotations

import base64
import hashlib
import re
import zlib

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment
from tests.viewer.unpacking import unpack
from viewer import write_html
from viewer.results import LAYERS
from viewer.web.files import joined_scripts, page_files


@pytest.fixture
def played(at_rest, press) -> list[Moment]:
    """Three moments: at rest, a touch on the chest, the same further on; the second is shown."""
    still = {part: np.zeros(len(layer.skin)) for part, layer in at_rest.layers.items()}
    moments = [Moment(5.0, still)]
    for time, taxel in ((5.5, 100), (6.0, 120)):
        pressures, touch = press("torso", taxel)
        moments.append(Moment(time, {**still, "torso": pressures}, (touch,)))
    at_rest.show_moment(moments[1])
    return moments


def message(page: str, name: str) -> tuple[dict, dict]:
    found = re.search(rf'<script type="text/plain" id="{name}">(.*?)</script>', page, re.S)
    return unpack(zlib.decompress(base64.b64decode(found.group(1))))


def test_page_holds_all_layers_taxels_and_touches(at_rest, played, tmp_path):
    page = write_html(at_rest, tmp_path / "scene.html").read_text()
    header, arrays = message(page, "reel")
    n = sum(len(layer.skin) for layer in at_rest.layers.values())
    assert [layer["name"] for layer in header["layers"]] == list(LAYERS)
    (moment,) = header["moments"]
    for name in moment["values"].values():
        assert arrays[name].size == n
    np.testing.assert_allclose(
        arrays[moment["felt"]["pressure"]][:430], played[1].pressures["torso"], rtol=1e-6
    )
    assert [touch["text"] for touch in moment["touches"]] == ["poke 98 %"]
    _, scene = message(page, "scene")
    assert np.array_equal(scene["taxel.channels"][:430], at_rest.layers["torso"].skin.channels)


def test_page_keeps_layers_that_never_change_once(at_rest, played, tmp_path):
    page = write_html(at_rest, tmp_path / "scene.html", moments=played, now=1).read_text()
    header, _ = message(page, "reel")
    assert header["now"] == 1
    names = [moment["values"] for moment in header["moments"]]
    assert len({one["pressure"] for one in names}) == 3
    assert len({one["structures"] for one in names}) == 1


def test_neighbours_in_the_page_are_those_of_the_mesh(at_rest, played, tmp_path):
    page = write_html(at_rest, tmp_path / "scene.html").read_text()
    _, arrays = message(page, "reel")
    faces = at_rest.layers["torso"].mesh.faces
    starts, beside = arrays["beside.starts"], arrays["beside"]
    for taxel in (0, 100, 429):
        around = np.unique(faces[(faces == taxel).any(axis=1)])
        assert np.array_equal(beside[starts[taxel] : starts[taxel + 1]], around[around != taxel])


def test_page_allows_its_own_script_and_style_and_nothing_else(at_rest, tmp_path):
    page = write_html(at_rest, tmp_path / "scene.html").read_text()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    assert set(rules) == {"default-src", "script-src", "style-src", "base-uri", "form-action"}
    for tag, rule in (("script", "script-src"), ("style", "style-src")):
        (text,) = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.S)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'"
    # The only address is the name of SVG's namespace, which nobody is asked for.
    assert set(re.findall(r"https?://[^\"'` ]+", page)) <= {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<(script|img|link|iframe)[^>]*\b(src|href)=", page)


def test_joined_scripts_hold_each_script_once_and_import_nothing():
    text = joined_scripts()
    names = [name.removesuffix(".js") for name in page_files() if name.endswith(".js")]
    assert sorted(re.findall(r"^const \$(\w+) = \(\(\) => \{$", text, re.M)) == names
    assert not re.search(r"^\s*(import|export)\b", text, re.M)


def test_names_cannot_end_the_script(at_rest, tmp_path, monkeypatch):
    name = "</title></script><script>alert(1)</script>"
    monkeypatch.setattr(at_rest.robot, "name", name)
    page = write_html(at_rest, tmp_path / "scene.html").read_text()
    assert "<script>alert" not in page
    assert message(page, "scene")[0]["robot"] == name


def test_page_in_a_browser_plays_and_names_a_channel(at_rest, played, open_tab, tmp_path):
    path = write_html(at_rest, tmp_path / "scene.html", moments=played, now=1)
    tab = open_tab(path.as_uri())
    tab.wait(".label")
    page = tab.page
    assert page.inner_text(".label") == "poke 98 %"
    skin = at_rest.layers["torso"].skin
    x, y = page.evaluate(
        """() => {
          const { flat, arrays } = skinmap, { middle, half } = flat.frame();
          const uv = arrays["taxel.uv"].subarray(200, 202);
          const box = flat.canvas.getBoundingClientRect();
          return [0, 1].map((i) => (0.5 + (i ? -0.5 : 0.5) * (uv[i] - middle[i]) / half[i])
            * (i ? box.height : box.width));
        }"""
    )
    page.locator("#flat").click(position={"x": x, "y": y})
    tab.wait(f"#pick-about dt:text-is('channel') + dd:text-is('{skin.channels[100]}')")
    assert "200 counts" in page.inner_text("#pick-about")
    page.select_option("#layer", "patches")
    tab.wait("#bar-names li:has-text('torso 0')")
    page.locator("#back").click()
    tab.wait(".label", state="detached")
    page.locator("#play").click()
    tab.wait("#play[aria-label='play']")  # at its end it halts
    tab.wait(".label")
    picture = tab.pixels()
    body = (np.ptp(picture, axis=2) < 25) & (picture.mean(axis=2) > 60)
    body &= picture.mean(axis=2) < 200  # grey: neither paper nor ink
    assert body.mean() > 0.05
    assert (tab.requests, tab.faults) == ([path.as_uri()], [])
    tab.context.close()
