"""Keys and the time slider in the window, off screen."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
import pytest

from viewer.drawing.frame.camera import project
from viewer.interaction.controls import KEYS, help_lines
from viewer.layers import LAYERS


def test_slider_is_dragged_through_the_recording(window, hands):
    slider, player = window.controls.slider, window.player
    assert slider.shown
    x, y = slider.place(2.0)
    assert slider.seconds(x) == pytest.approx(2.0)
    hands.drag([slider.place(0.0), (x, y), (x, y + 60)])
    hands.wait_until(lambda: player.moment.time == pytest.approx(2.0, abs=0.03))
    window.turn()
    assert window.scene.moment is player.moment
    assert slider.position == pytest.approx(2.0, abs=0.03)  # a pixel is 8 ms
    assert window.scene.selection == {}


def test_keys_lead_the_recording(window, hands):
    player = window.player
    hands.key("Right")
    hands.wait_until(lambda: player.moment.time == pytest.approx(0.02))
    hands.key("Left")
    assert player.moment.time == 0.0
    hands.key("Up")
    hands.wait_until(lambda: player.moment.time == pytest.approx(1.0))
    hands.key("Home")
    hands.wait_until(lambda: player.moment.time == 0.0)
    hands.key("plus")
    assert player.speed == 2.0
    hands.key("minus")
    assert player.speed == 1.0
    hands.key("l")
    assert player.loop
    assert player.paused
    hands.key("space")
    assert not player.paused
    hands.wait_until(lambda: player.moment.time > 0.1)
    hands.key("space")
    assert player.paused


def test_keys_choose_layers_style_and_map(window, hands):
    scene = window.scene
    for number, name in enumerate(LAYERS[:9], start=1):
        hands.key(str(number))
        assert scene.layer.name == name
    hands.key("1")
    before = hands.picture()
    hands.key("d")
    assert scene.style == "discs"
    assert (hands.picture() != before).any()
    hands.key("d")
    assert scene.style == "surface"
    hands.key("Tab")
    assert scene.panel.part == "left_arm"
    assert not window.controls.following


def test_camera_presets_look_from_their_sides(window, hands):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()

    def towards():
        way = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
        return way / np.linalg.norm(way)

    seen = {}
    for name, side in {
        "f": "front",
        "b": "back",
        "bracketleft": "left",
        "bracketright": "right",
        "t": "top",
    }.items():
        hands.key(name)
        seen[side] = towards()
    level = {side: way[:2] / np.linalg.norm(way[:2]) for side, way in seen.items()}
    np.testing.assert_allclose(level["front"], -level["back"], atol=1e-9)
    np.testing.assert_allclose(level["left"], -level["right"], atol=1e-9)
    # Seen from above, left is a quarter turn counter-clockwise of front.
    np.testing.assert_allclose(level["left"], [-level["front"][1], level["front"][0]], atol=1e-9)
    assert seen["top"][2] > 0.98


def test_focus_brings_a_touch_close(window, hands, press):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()
    hands.key("r")
    hands.key("g")
    assert "nothing is touched" in window.controls.notice.text
    _, touch = press("torso", 100)
    window.scene.set_touches([touch])
    window.scene.update()
    hands.key("r")
    far = camera.GetDistance()
    hands.key("g")
    assert camera.GetDistance() < 0.8 * far, "chest and arm are half a metre wide"
    centre = window.scene.canvas.touch_view.targets[0].points.mean(axis=0)
    (place,) = project(window.scene.plotter.renderers[0], centre[None])
    width, height = window.scene.plotter.renderers[0].GetSize()
    assert abs(place[0] / width - 0.5) < 0.15
    assert abs(place[1] / height - 0.5) < 0.15
    window.scene.set_touches([])


def test_help_lists_every_key_and_goes_away(window, hands):
    text = "\n".join(help_lines())
    assert all(one.text in text for one in KEYS)
    names = [name for one in KEYS for name in one.actions]
    assert len(names) == len(set(names)), "no key stands for two things"
    methods = [method for one in KEYS for method, *_ in one.actions.values()]
    assert all(callable(attrgetter(method)(window.controls)) for method in methods)
    before = hands.picture()
    hands.key("h")
    assert window.controls.help_shown
    assert (hands.picture() != before).any()
    hands.key("h")
    assert not window.controls.help_shown
    assert np.array_equal(hands.picture(), before)


def test_help_is_whole_in_the_picture(window, hands):
    hands.key("h")
    box = window.controls._help
    size = [0.0, 0.0]
    box.actor.GetSize(box.renderer, size)
    assert size[0] <= box.renderer.GetSize()[0]
    assert size[1] <= box.renderer.GetSize()[1]
    hands.key("h")


def test_letters_follow_a_window_of_another_size(window, hands):
    taxels, places = hands.seen_taxels()
    hands.hover(*places[taxels[len(taxels) // 2]])
    controls, plain = window.controls, window.scene.plotter.window_size
    hands.key("h")

    def heights():
        box = controls.pointing._boxes["body"]
        texts = (box, controls._help, controls.notice, controls.slider._text)
        return [text.actor.GetTextProperty().GetFontSize() for text in texts]

    def all_inside(box) -> bool:
        size = [0.0, 0.0]
        box.actor.GetSize(box.renderer, size)
        left, bottom = box.actor.GetPosition()
        width, height = box.renderer.GetSize()
        return 0 <= left <= width - size[0] and 0 <= bottom <= height - size[1]

    before = heights()
    window.scene.plotter.window_size = (1600, 1200)  # twice as high as the scene was made
    for _ in range(2):  # the picture learns its size, then all that stands in it
        window.turn()
        controls.changed = True
    assert heights() == pytest.approx([2 * px for px in before], abs=1)  # whole pixels
    assert all_inside(controls._help)
    assert controls.slider.bar[2] == pytest.approx(0.9 * window.scene.font_px)
    window.scene.plotter.window_size = plain
    for _ in range(2):
        window.turn()
        controls.changed = True
    assert heights() == before
    assert all_inside(controls._help)
    hands.key("h")


def test_unknown_keys_do_nothing_and_q_closes(window, hands):
    hands.key("w")
    hands.key("F7")
    assert not window.controls.closed
    hands.key("q")
    assert window.controls.closed
    assert not window.turn(), "nothing is drawn any more"
