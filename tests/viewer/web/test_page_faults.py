"""What an open page does when something goes wrong, and that its colours are the shader's."""

from __future__ import annotations

import gzip
import http.client
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.io.robots.manifest import load_robot
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.touch.prepared_skin import PreparedSkin
from viewer import Player, serve

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "robot"
FRAMES = 30
TOKEN = "a-token-of-the-tests-own"
PICTURES = (Path(__file__).parent / "compare_pictures.js").read_text()


@pytest.fixture
def desk(open_desk, start) -> Iterator:
    made = open_desk(start().url)
    made.wait()
    yield made
    assert made.faults == []
    made.context.close()


@pytest.mark.parametrize("style", ["surface", "discs"])
def test_scripts_and_the_card_colour_alike(desk, style):
    desk.page.select_option("#style", style)
    for seed in range(3):
        found = desk.page.evaluate(PICTURES, seed + 1)
        assert found["skin"] > 2000
        assert found["beyond"] > 20
        assert found["black"] == 0
        # A value that lies between two rows of the table may be rounded either way, by the card's
        # own precision: a handful of pixels, and by one row.
        assert found["apart"] <= 0.002 * found["skin"]
        assert found["worst"] <= 12


def test_no_frame_has_a_black_pixel(open_desk, icub, start, rng):
    """A press that wanders: each frame is looked at as it is drawn."""
    skin = icub.skin("torso")
    moments, rest = [], np.zeros(len(icub.skin("left_arm")))
    for k in range(FRAMES):
        gap = np.linalg.norm(skin.positions - skin.positions[rng.integers(len(skin))], axis=1)
        pressed = np.where(gap < 0.015, 255.0, 0.0)
        moments.append(Moment(k / 50, {"torso": pressed, "left_arm": rest}))
    tab = open_desk(start(moments=moments).url)
    tab.wait()
    tab.page.evaluate(
        """() => {
          window.seen = window.black = 0;
          const { rest } = skinmap.picture, draw = rest.draw.bind(rest);
          rest.draw = (...given) => {
            draw(...given);
            window.seen += 1;
            window.black += rest.cells.some((cell) => (cell & 0xffffff) === 0);
          };
        }"""
    )
    # The page itself says when a sample is drawn: nothing is asked for again and again meanwhile,
    # and a slow machine has all the time that a test has.
    tab.page.evaluate(
        """async (steps) => {
          const { link } = skinmap, drawn = link.drawn.bind(link);
          let told = () => {};
          link.drawn = (received) => {
            drawn(received);
            told(received);
          };
          for (let k = 0; k < steps; k += 1) {
            const before = skinmap.received;
            const shown = new Promise((done) => {
              told = (received) => received > before && done();
            });
            document.getElementById("on").click();
            await shown;
          }
        }""",
        FRAMES - 2,
    )
    # A first step may bring the skin at rest again, of which nothing is drawn anew.
    assert tab.page.evaluate("() => window.seen") >= FRAMES - 3
    assert tab.page.evaluate("() => window.black") == 0
    assert tab.faults == []
    tab.context.close()


def test_a_lost_picture_is_said_and_comes_back(desk):
    before = desk.pixels()
    desk.page.evaluate(
        "() => (window.card = skinmap.picture.gl.getExtension('WEBGL_lose_context')).loseContext()"
    )
    desk.until("() => document.getElementById('status').textContent.includes('graphics card')")
    desk.page.evaluate("() => window.card.restoreContext()")
    desk.until("() => !skinmap.lost && skinmap.picture.kept !== null")
    desk.page.wait_for_timeout(600)  # until edges are smoothed
    assert np.abs(desk.pixels() - before).mean() < 1.0
    desk.step()
    desk.wait(".label")


def test_one_click_plays_an_ended_recording_again(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    tab.page.select_option("#speed", "16")
    tab.page.click("#play")
    tab.until("() => skinmap.controls.state.ended")
    assert tab.page.get_attribute("#play", "aria-label") == "play"
    tab.page.select_option("#speed", "1")  # at 16 times it may end again before anybody looks
    tab.page.click("#play")
    tab.until("() => !skinmap.controls.state.ended || skinmap.controls.state.position < 0.5")
    tab.context.close()


def test_all_pages_show_the_same_player(open_desk, start):
    url = start().url
    one, other = open_desk(url), open_desk(url)
    one.wait()
    other.wait()
    one.page.click("#play")
    other.until("() => !skinmap.controls.state.paused")
    for tab in (one, other):
        tab.context.close()


def test_a_page_finds_a_server_with_the_same_token_and_is_told_of_another(
    open_desk, icub, prepared, moments, opengl
):
    skins = {"torso": prepared("torso")}

    def begin(port: int, token: str):
        player = Player(list(moments), paused=True)
        return serve(icub, skins, player, port=port, token=token, links=("chest",)), player

    server, player = begin(0, TOKEN)
    tab = open_desk(server.url)
    tab.wait()
    for token, said in ((TOKEN, ""), (TOKEN + "-other", "started anew: open the address")):
        server.stop()
        player.close()
        tab.until("() => document.getElementById('status').textContent.includes('not connected')")
        server, player = begin(server.port, token)
        if said:
            tab.wait(f"#status:has-text('{said}')")
        else:
            tab.until("() => !document.getElementById('status').textContent.includes('connected')")
    server.stop()
    player.close()
    tab.context.close()


def test_a_token_that_can_be_guessed_is_refused(icub, prepared, moments, opengl):
    with pytest.raises(InvalidArrayError, match="16 to 128"):
        serve(icub, {"torso": prepared("torso")}, Player(list(moments)), port=0, token="short")


def test_an_address_without_its_last_slash_leads_to_the_page(server, get):
    status, content, headers = get(f"/{server.guard.token}")
    assert (status, content, headers["Location"]) == (308, b"", f"/{server.guard.token}/")


def test_scene_and_scripts_go_compressed(server):
    for name in ("scene.bin", "main.js"):
        sizes = {}
        for kind in ("gzip", "identity"):
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
            connection.request(
                "GET", f"/{server.guard.token}/{name}", headers={"Accept-Encoding": kind}
            )
            answer = connection.getresponse()
            content = answer.read()
            assert answer.getheader("Content-Encoding") == ("gzip" if kind == "gzip" else None)
            sizes[kind] = len(content), gzip.decompress(content) if kind == "gzip" else content
            connection.close()
        assert sizes["gzip"][1] == sizes["identity"][1]
        assert sizes["gzip"][0] < 0.8 * sizes["identity"][0]


def test_marks_of_hidden_parts_are_hidden(desk):
    desk.step()
    desk.wait(".label")
    count = "() => skinmap.picture.touches.segments.length"
    assert desk.page.evaluate(count) > 0
    desk.page.select_option("#part", "left_arm")
    assert desk.page.evaluate(count) == 0
    desk.page.select_option("#part", "")
    assert desk.page.evaluate(count) > 0


def test_the_camera_is_led_by_keys_and_touches_are_announced(desk):
    desk.page.locator("#picture").focus()
    for keys, name in (
        ("Shift+ArrowLeft", "azimuth"),
        ("Shift+ArrowUp", "elevation"),
        ("z", "zoom"),
    ):
        before = desk.page.evaluate(f"() => skinmap.camera.{name}")
        desk.page.keyboard.press(keys)
        assert desk.page.evaluate(f"() => skinmap.camera.{name}") != before
    desk.step()
    desk.until("() => document.getElementById('said').textContent === 'caress on torso'")
    assert desk.page.get_attribute("#said", "aria-live") == "polite"


def test_the_dark_is_dark_and_touches_stand_on_the_time_line(open_desk, start):
    tab = open_desk(start().url, color_scheme="dark")
    tab.wait()
    picture = tab.pixels()
    assert np.median(picture[:40, -40:]) < 60
    tab.step()
    tab.until("() => skinmap.controls.timeline.spans.length === 1")
    tab.page.select_option("#plot", "area")
    tab.wait("#traces")
    assert "area, mm²" in tab.page.locator("#traces").inner_text()
    tab.page.set_viewport_size({"width": 390, "height": 800})
    sizes = tab.page.eval_on_selector_all(
        "button, select, input",
        """all => all.filter((one) => one.offsetParent)
          .map((one) => [one.id, one.offsetWidth, one.offsetHeight])""",
    )
    assert [one for one in sizes if min(one[1:]) < 32] == []
    tab.context.close()


def test_the_notes_of_a_small_page_leave_its_heading_free(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    tab.page.set_viewport_size({"width": 390, "height": 844})
    said = tab.page.evaluate(
        """() => {
          const parts = [...Array(13).keys()].map((k) => ({name: `left_leg_lower_${k}`}));
          const { words } = skinmap.controls;
          words.live = true;
          words.showNotes(parts.slice(2), parts, true);
          const [bar, head] = ["bar", "heading"].map((id) => document.getElementById(id));
          return [document.getElementById("bar-missing").textContent,
            bar.getBoundingClientRect().top - head.getBoundingClientRect().bottom];
        }"""
    )
    assert said[0].startswith("grey: not in this source: 11 parts")
    assert said[1] >= 0, "the legend begins below the heading"
    tab.context.close()


def test_the_legend_of_half_a_window_leaves_status_and_names_free(open_desk, start):
    """One of two pages side by side: a long legend in a low picture, and a touch on its side."""
    tab = open_desk(start().url)
    tab.wait()
    tab.page.set_viewport_size({"width": 699, "height": 657})
    status, bar, label = tab.page.evaluate(
        """() => {
          const missing = document.getElementById("bar-missing"), stage = skinmap.stage;
          missing.innerHTML = "<span>grey</span>".repeat(6);
          document.getElementById("status").textContent = "ended";
          const { offsetTop: top } = document.getElementById("bar");
          const { clientWidth: width, clientHeight: height } = stage;
          const touch = {key: "one", text: "unknown", colour: "#1f6fd0", at: [250, 120]};
          skinmap.labels.show([touch], {width, height, taken: top - 12});
          return ["#status", "#bar", ".label"].map((id) => {
            const box = document.querySelector(id).getBoundingClientRect(), { left, right } = box;
            return { left, right, top: box.top, bottom: box.bottom };
          });
        }"""
    )
    assert bar["top"] >= status["bottom"]
    assert label["left"] >= bar["right"] or label["bottom"] <= bar["top"]
    tab.context.close()


def test_names_that_are_code_are_text_in_the_page(open_desk, opengl, tmp_path):
    code = "<img src=x onerror=window.harmed=1>"
    for path in EXAMPLE.iterdir():
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".toml":
            head, mark, rest = text.partition("[[part]]")
            text = head + mark + rest.replace('name = "', f'name = "{code}', 1)
        (tmp_path / path.name).write_text(text, encoding="utf-8")
    robot = load_robot(tmp_path / "robot.toml")
    part = robot.parts[0]
    skin = robot.skin(part)
    touch = NamedTouch(part, np.arange(3), skin.positions[0], code, 0.9, identity=1)
    pressures = np.zeros(len(skin))
    pressures[:3] = 200.0
    player = Player([Moment(0.0, {part: pressures}, (touch,))], paused=True)
    server = serve(robot, {part: PreparedSkin(skin)}, player, port=0)
    tab = open_desk(server.url)
    try:
        tab.wait()
        tab.wait(".label")
        shown = tab.page.inner_text("body")
        assert shown.count(code) >= 2, "the part and the touch, letter by letter"
        assert tab.page.evaluate("() => [window.harmed, document.images.length]") == [None, 0]
    finally:
        tab.context.close()
        server.stop()
        player.close()
