"""glTF and the self-contained page: what is in them, and that nothing leaves them."""

from __future__ import annotations

import base64
import json
import re

import numpy as np
import pytest

from skinmap.errors import OutputError
from skinmap.geometry.rigid import transform_points
from skinmap.live.moment import Moment


@pytest.fixture
def touched(at_rest, press):
    """The small scene with one named touch on the chest."""
    pressures, touch = press("torso", 100)
    still = np.zeros(len(at_rest.layers["left_arm"].skin))
    at_rest.show_moment(Moment(1.0, {"torso": pressures, "left_arm": still}, (touch,)))
    at_rest.update()
    return at_rest


def array(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def data_of(page: str) -> dict:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    return json.loads(found.group(1))


def test_gltf_holds_links_and_taxels_at_their_places_and_colours(touched, tmp_path):
    import trimesh

    from viewer.export.gltf import T_GLTF_WORLD, write_gltf

    path = write_gltf(touched, tmp_path / "scene.glb")
    scene = trimesh.load(path)
    assert set(scene.geometry) == {"chest", "l_upper_arm", "skin torso", "skin left_arm"}
    skin = touched.layers["torso"].skin
    placed = scene.geometry["skin torso"].copy()
    placed.apply_transform(scene.graph["skin torso"][0])
    pose = T_GLTF_WORLD @ touched.poses[skin.link]
    centres = np.asarray(placed.vertices).reshape(len(skin), 6, 3).mean(axis=1)
    away = np.linalg.norm(centres - transform_points(pose, skin.positions), axis=1)
    assert away.max() < 2.1e-3, "discs float 2 mm above their taxels, in single floats"
    colours = scene.geometry["skin torso"].visual.vertex_colors.reshape(len(skin), 6, 4)
    wanted = touched.layer.colours(touched.layer.values("torso", touched.moment))
    assert np.array_equal(colours[:, 0, :3], wanted)
    assert len(np.unique(wanted, axis=0)) > 3


def test_page_holds_all_layers_taxels_and_touches(touched, tmp_path):
    from viewer.export.html_page import write_html

    page = write_html(touched, tmp_path / "scene.html").read_text()
    data = data_of(page)
    n = sum(len(layer.skin) for layer in touched.layers.values())
    assert [layer["name"] for layer in data["layers"]] == list(touched.data.names)
    channels = array(data["taxels"]["channel"], "<i4")
    assert len(channels) == n
    assert np.array_equal(channels[:430], touched.layers["torso"].skin.channels)
    for layer in data["layers"]:
        assert len(array(layer["colours"], "u1")) == 3 * n
        assert len(array(layer["values"], "<f4")) == n
    pressures = array(data["layers"][0]["values"], "<f4")
    np.testing.assert_allclose(pressures[:430], touched.moment.pressures["torso"], rtol=1e-6)
    assert [touch["text"] for touch in data["touches"]] == ["poke 98 %"]
    faces = array(data["discs"]["faces"], "<u4")
    assert faces.max() == 6 * n - 1
    assert {taxel for taxel, _, _ in data["parts"]["left_arm"]["uv"]} <= set(range(430, n))


def test_page_asks_nobody_for_anything(touched, tmp_path):
    from viewer.export.html_page import write_html

    page = write_html(touched, tmp_path / "scene.html").read_text()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    assert "default-src 'none'" in policy
    # The only address is the name of SVG's namespace, which nobody is asked for.
    assert set(re.findall(r"https?://[^\"' ]+", page)) <= {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<(script|img|link|iframe)[^>]*\b(src|href)=", page)
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|import)\b *\(", page)


def test_names_cannot_end_the_script(touched, tmp_path, monkeypatch):
    from viewer.export.html_page import write_html

    monkeypatch.setattr(touched.robot, "name", "</script><script>alert(1)</script>")
    page = write_html(touched, tmp_path / "scene.html").read_text()
    assert "<script>alert" not in page
    assert "alert(1)" in data_of(page)["title"]


def test_exports_into_no_folder_are_refused(touched, tmp_path):
    from viewer.export.gltf import write_gltf
    from viewer.export.html_page import write_html

    for write, name in ((write_gltf, "a.glb"), (write_html, "a.html")):
        with pytest.raises(OutputError, match="cannot write"):
            write(touched, tmp_path / "no" / name)


def test_page_in_a_browser_shows_robot_touch_and_channel(touched, tmp_path):
    """A real headless Chromium: something is drawn, nothing is asked for, a taxel is named."""
    from pathlib import Path

    chromium = Path("/usr/bin/chromium")
    if not chromium.exists():
        pytest.skip("no chromium here")
    from playwright.sync_api import sync_playwright

    from viewer.export.html_page import write_html

    path = write_html(touched, tmp_path / "scene.html")
    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=str(chromium),
            args=["--no-sandbox", "--disable-quic", "--disable-background-networking",
                  "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
        )  # fmt: skip
        page = browser.new_page(viewport={"width": 900, "height": 600})
        asked, faults = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(path.as_uri())
        page.wait_for_selector(".label")
        assert page.inner_text(".label") == "poke 98 %"
        data = data_of(path.read_text())
        place = page.evaluate(
            "() => project(matrix(), D.touches[0].place)"  # where the touch is in the picture
        )
        page.mouse.move(place[0], place[1])
        page.wait_for_function("document.getElementById('tip').style.display === 'block'")
        told = page.inner_text("#tip")
        skin = touched.layers["torso"].skin
        near = np.argsort(np.linalg.norm(skin.positions - skin.positions[100], axis=1))[:7]
        assert int(re.search(r"torso, channel (\d+)", told).group(1)) in skin.channels[near]
        picture = page.screenshot(clip={"x": 0, "y": 0, "width": 600, "height": 600})
        browser.close()
    import imageio.v3 as iio

    seen = iio.imread(picture)[..., :3].astype(int)
    # Grey body, neither paper nor ink.
    body = (np.ptp(seen, axis=2) < 25) & (seen.mean(axis=2) > 60) & (seen.mean(axis=2) < 200)
    assert body.mean() > 0.05
    assert (asked, faults) == ([path.as_uri()], [])
    assert data["layer"] == "pressure"
