"""The page in a real Chromium without a screen: what people see, and what leaves the machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from skinmap.live.contacts.contact_motion import Motion
from skinmap.live.contacts.named_touch import Moment
from skinmap.touch.images.contact_image import paper_images, taxel_grid
from viewer.colours import class_colour
from viewer.web.server import WebServer


@pytest.fixture
def tab(open_tab, start) -> Iterator:
    made = open_tab(start().url)
    made.wait()
    yield made
    assert made.faults == []
    made.context.close()


def test_the_robot_is_seen(tab):
    picture = tab.pixels()
    height, width, _ = picture.shape
    robot = picture[height // 4 : 3 * height // 4, width // 3 : 2 * width // 3]
    background = np.array([0xF7, 0xF8, 0xFA])
    differs = np.abs(robot - background).max(axis=-1) > 24
    assert differs.mean() > 0.3
    sheet = np.abs(robot - [0xF4, 0xF2, 0xEC]).max(axis=-1) < 24  # pressure 0, a little shaded
    assert sheet.mean() > 0.02


def test_a_played_touch_is_named_coloured_and_listed(tab):
    before = tab.pixels()
    assert tab.page.locator(".label").count() == 0
    tab.step()
    tab.wait(".label")
    assert tab.page.locator(".label").inner_text() == "caress 90 %"
    assert "caress 90 %" in tab.page.locator("#touch-list").inner_text()
    assert "torso" in tab.page.locator("#map-about").inner_text()

    def warm(picture: np.ndarray) -> int:
        """Pixels as red as pressures are from a half upwards; the colour bar stands at the left."""
        r, g, b = picture[:, picture.shape[1] // 3 :].transpose(2, 0, 1)
        return int(((r > 1.6 * g) & (r > 1.6 * b)).sum())

    assert warm(before) == 0
    assert warm(tab.pixels()) > 20


def test_the_page_has_the_contact_image_that_classifiers_see(tab, prepared, moments):
    image = tab.page.locator("#contact-image")
    assert not image.is_visible()
    tab.step()
    tab.wait(".label")
    assert image.is_visible()
    shape = image.evaluate("(canvas) => [canvas.height, canvas.width]")
    grey = image.evaluate("""(canvas) => {
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return Array.from(data.filter((_, k) => k % 4 === 0));
    }""")
    grid = taxel_grid(prepared("torso").flat)
    wanted = paper_images(grid, moments[1].pressures["torso"][None], size=shape)[0]
    # Weights in steps of 1/255, of three taxels.
    np.testing.assert_allclose(np.reshape(grey, shape), wanted, atol=3)
    assert wanted.max() > 200
    tab.page.select_option("#layer", "patches")
    image.wait_for(state="hidden")


def test_a_click_on_the_flat_map_shows_the_channel(tab, icub):
    flat = tab.page.locator("#flat")
    number = 100  # on the chest, which is the first part
    x, y = tab.page.evaluate(
        """(number) => {
          const { flat, arrays } = skinmap, uv = arrays["taxel.uv"];
          return flat.at(uv[2 * number], uv[2 * number + 1])
            .map((place) => (place * flat.canvas.clientWidth) / flat.canvas.width);
        }""",
        number,
    )
    flat.click(position={"x": x, "y": y})
    channel = int(icub.skin("torso").channels[number])
    tab.wait(f"#pick-about dt:text-is('channel') + dd:text-is('{channel}')")
    assert "module" in tab.page.locator("#pick-about").inner_text()


def test_a_click_on_the_body_picks_the_taxel_under_it(tab, icub):
    """Each taxel that the page finds at its own place is the one that stands there."""
    hits = tab.page.evaluate(
        """() => {
          const { picture, camera, arrays, header } = skinmap, points = arrays["taxel.points"];
          const found = [];
          for (let k = 0; k < header.parts[0].taxels[1]; k += 7) {
            const m = picture.model(header.parts[0].link), p = [0, 1, 2].map((r) => m[12 + r]
              + m[r] * points[3 * k] + m[4 + r] * points[3 * k + 1] + m[8 + r] * points[3 * k + 2]);
            const [x, y] = camera.project(p), { width, height } = picture.canvas;
            found.push([k, picture.taxelAt(x * width, y * height, camera)]);
          }
          return found;
        }"""
    )
    seen = [(asked, got) for asked, got in hits if got >= 0]
    right = sum(asked == got for asked, got in seen)
    # Taxels on the far side are covered by others; none of those in view is taken for another.
    assert right > 20
    assert right >= 0.9 * len(seen)


def test_layers_and_styles_change_the_picture(tab):
    surface = tab.pixels()
    tab.page.select_option("#style", "discs")
    tab.page.select_option("#layer", "patches")
    tab.wait("#bar-names li:has-text('torso 0')")
    patches = tab.pixels()
    assert (np.abs(patches - surface).max(axis=-1) > 40).mean() > 0.01


def test_no_request_leaves_the_machine(tab, start):
    tab.step()
    tab.wait(".label")
    tab.page.keyboard.press("h")
    tab.wait("#help")
    assert len(tab.requests) > 5
    for url in tab.requests:
        assert url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:")), url
    # The page's own policy holds it back even where a script would ask.
    blocked = tab.page.evaluate(
        """() => fetch("http://127.0.0.1:1/").then(() => "sent", () => "refused")"""
    )
    assert blocked == "refused"
    tab.faults.clear()  # the refusal above is told on the console


def test_a_wrong_token_shows_a_line_and_no_robot(open_tab, server):
    tab = open_tab(f"http://127.0.0.1:{server.port}/wrong/")
    assert tab.answer.status == 403
    assert "token" in tab.page.locator("body").inner_text()
    tab.context.close()


def test_another_page_of_the_browser_cannot_read_or_connect(open_tab, server, start):
    """Even with the token: a page of another port of this machine."""
    other = start()
    tab = open_tab(other.url, bypass_csp=True)
    tab.wait()
    outcome = tab.page.evaluate(
        """async (url) => {
          const read = await fetch(url + "scene.bin").then((a) => a.text(), () => "refused");
          const socket = new WebSocket(url.replace("http", "ws") + "live");
          const opened = await new Promise((done) => {
            socket.onopen = () => done("open");
            socket.onclose = () => done("refused");
          });
          return [read, opened];
        }""",
        server.url,
    )
    assert outcome == ["refused", "refused"]
    tab.context.close()


def test_two_tabs_show_the_same_and_closing_one_in_mid_update_leaves_the_other(open_tab, start):
    server: WebServer = start()
    one, two = open_tab(server.url), open_tab(server.url)
    one.wait()
    two.wait()
    one.step()
    one.context.close()  # without waiting for what the step brings
    two.wait(".label")
    assert two.page.locator(".label").inner_text() == "caress 90 %"
    assert two.faults == []
    two.context.close()


def test_a_server_that_stops_is_told_in_the_page(open_tab, start):
    server = start()
    tab = open_tab(server.url)
    tab.wait()
    server.stop()
    tab.wait("#status.warn")
    assert "not connected" in tab.page.locator("#status").inner_text()
    tab.context.close()


@pytest.mark.parametrize("style", ["surface", "discs"])
def test_a_resting_picture_is_the_same_with_and_without_the_graphics_card(tab, style):
    """A sample is drawn pixel by pixel in software, and by the card's own program elsewhere."""
    tab.page.select_option("#style", style)
    tab.step()
    tab.wait(".label")
    gap, red, skin, hidden = tab.page.evaluate(
        """() => {
          clearTimeout(skinmap.still);
          const { picture, camera } = skinmap, { canvas, rest, gl } = picture;
          const { width, height } = canvas;
          const codes = new Uint8Array(picture.codes).fill(200), values = picture.values.slice();
          for (let k = 0; k < values.length; k += 2) [values[k], values[k + 1]] = [200, 1];
          picture.touches.set([]);
          picture.keep(camera, true);
          picture.setValues(codes, values);
          picture.draw(camera, true, false);
          const one = rest.paper.getImageData(0, 0, width, height).data;
          picture.software = false;
          picture.keptSmooth = true; // only the way of drawing samples is to differ
          picture.draw(camera, true, false);
          const other = new Uint8Array(4 * width * height);
          gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, other);
          let gap = 0, red = 0;
          for (let p = 0; p < width * height; p++) { // the card's rows begin below
            const a = 4 * p, b = 4 * ((height - 1 - Math.floor(p / width)) * width + (p % width));
            for (let i = 0; i < 3; i++) gap = Math.max(gap, Math.abs(one[a + i] - other[b + i]));
            red += one[a] > 1.6 * one[a + 1] && one[a] > 1.6 * one[a + 2];
          }
          return [gap, red, rest.pixels.length, rest.canvas.hidden];
        }"""
    )
    assert hidden
    assert skin > 1000
    assert red > 0.9 * skin  # 200 of 254 is a red, on all the skin that is seen
    # Shares and shades are rounded; one takes the table's nearest row, the other between two.
    assert gap <= 6


PLACES = """(points) => {
  const { picture, camera, header } = skinmap, m = picture.model(header.parts[0].link);
  const { clientWidth, clientHeight } = picture.canvas;
  return points.map((p) => camera.project([0, 1, 2].map((r) => m[12 + r] + m[r] * p[0]
    + m[4 + r] * p[1] + m[8 + r] * p[2]))).map(([x, y]) => [x * clientWidth, y * clientHeight]);
}"""


def test_a_moving_touch_draws_its_trace_and_an_arrow(open_tab, start, icub, moments):
    """What a touch that moves adds to the picture of the same one at rest lies along both."""
    chest, touch = icub.skin("torso"), moments[-1].touches[0]
    normal = chest.normals[int(np.argmin(((chest.positions - touch.centre) ** 2).sum(axis=1)))]
    up = chest.up - (chest.up @ normal) * normal
    up /= np.linalg.norm(up)
    side = np.cross(up, normal)
    trail = touch.centre - np.linspace(0.06, 0.0, 30)[:, None] * up
    rest = replace(touch, normal=normal, path=touch.centre[None])
    motion = Motion(0.2 * up, 0.02, 0.2, 0.0, "up", 0.06)  # its arrow is 60 mm long
    shown = (rest, rest, replace(rest, path=trail, motion=motion, confidence=0.8))
    pressed = moments[-1].pressures
    tab = open_tab(
        start(moments=[Moment(float(k), pressed, (one,)) for k, one in enumerate(shown)]).url
    )
    tab.wait()
    tab.step()
    tab.wait(".label:text-is('caress 90 %')")
    before = tab.pixels()
    tab.step()
    tab.wait(".label:text-is('caress 80 %')")
    tab.until("() => document.querySelector('#touch-list').innerText.includes('up 200 mm/s')")
    tint = np.array([int(class_colour("caress")[k : k + 2], 16) for k in (1, 3, 5)])

    def tinted(picture: np.ndarray) -> np.ndarray:
        return np.abs(picture - tint).max(axis=-1) < 48

    added = tinted(tab.pixels()) & ~tinted(before)
    height, width = added.shape

    def drawn(points: np.ndarray) -> np.ndarray:
        """Whether something was drawn within three pixels of places on the chest."""
        places = tab.page.evaluate(PLACES, points.tolist())
        rows = np.clip(np.round(places).astype(int), 3, [width - 4, height - 4])
        return np.array([added[y - 3 : y + 4, x - 3 : x + 4].any() for x, y in rows.tolist()])

    along = touch.centre + np.linspace(0.025, 0.05, 8)[:, None] * up + 4e-3 * normal
    assert drawn(along).mean() > 0.7  # the arrow
    assert drawn(trail[:15] + 3e-3 * normal).mean() > 0.7
    aside = np.vstack([trail[:15], along]) + np.sign(side[0]) * 0.05 * side
    assert drawn(aside).mean() < 0.1  # the control
    assert tab.faults == []
    tab.context.close()
