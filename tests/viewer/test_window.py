"""The window's logic off screen: events go through VTK's interactor, pictures are drawn."""

from __future__ import annotations

import json
from operator import attrgetter

import numpy as np
import pytest

from skinmap.live.moment import Moment
from viewer.display import has_display
from viewer.drawing.camera import project
from viewer.interaction.keys import KEYS, help_lines
from viewer.layers import LAYERS
from viewer.playing.player import Player

RATE = 50.0
COUNT = 200


@pytest.fixture(scope="module")
def moments(icub):
    """Four seconds on the chest: a press that wanders, one taxel further with each sample."""
    n = {part: len(icub.skin(part)) for part in ("torso", "left_arm")}
    made = []
    for k in range(COUNT):
        pressures = {part: np.zeros(count) for part, count in n.items()}
        pressures["torso"][k] = 200.0
        made.append(Moment(k / RATE, pressures))
    return made


@pytest.fixture(scope="module")
def drawn(opengl, icub, prepared):
    """One scene for all windows of this file; each window lets go of it again."""
    from viewer.drawing.lazy_maps import LazyMaps
    from viewer.layers import Layers
    from viewer.scene import Scene

    skins = {part: prepared(part) for part in ("torso", "left_arm")}
    made = Scene(
        icub,
        {part: skin.mesh for part, skin in skins.items()},
        LazyMaps(skins),
        links=("chest", "l_upper_arm"),
        window_size=(800, 600),
        data=Layers(skins),
    )
    yield made
    made.close()


@pytest.fixture
def window(drawn, moments, tmp_path):
    from viewer.window import Window

    player = Player(moments, paused=True)
    made = Window(drawn, player, folder=tmp_path)
    drawn.set_layer("pressure")
    drawn.set_style("surface")
    drawn.show_flat_map("torso")
    drawn.look(drawn.front.azimuth)
    made.controls.pointing.clear()
    player.start()
    wait_until(made, lambda: player.moment is not None)
    made.turn()
    yield made
    made.controls.files.end_movie()
    made.controls.pointing.leave()
    made.controls.pointing.clear()
    made.events.close()
    made.controls.remove()
    player.close()


def wait_until(window, condition) -> None:
    for _ in range(2000):
        if condition():
            return
        window.player.wait(window.player.number, 0.01)
    raise AssertionError("nothing happened")


def mouse(window, event, x, y, *, shift=False, control=False) -> None:
    window.interactor.SetEventInformation(round(x), round(y), int(control), int(shift))
    window.interactor.InvokeEvent(event)


def key(window, name) -> None:
    window.interactor.SetKeySym(name)
    window.interactor.InvokeEvent("KeyPressEvent")
    window.turn()


def hover(window, x, y) -> None:
    mouse(window, "MouseMoveEvent", x, y)
    window.controls.pointing.hurry()
    window.turn()


def drag(window, places, **keys) -> None:
    mouse(window, "MouseMoveEvent", *places[0])
    mouse(window, "LeftButtonPressEvent", *places[0], **keys)
    for place in places[1:]:
        mouse(window, "MouseMoveEvent", *place, **keys)
    mouse(window, "LeftButtonReleaseEvent", *places[-1], **keys)
    window.turn()


def click(window, x, y, **keys) -> None:
    drag(window, [(x, y)], **keys)


def seen_taxels(window, part="torso"):
    """Taxels in full view of the camera, and where they are in the window (n, 2) [px]."""
    scene = window.scene
    target = window.controls.pointing._target(part)
    renderer = scene.plotter.renderers[0]
    places = project(renderer, target.positions)
    way = np.array(renderer.GetActiveCamera().GetPosition()) - target.positions
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    facing = np.einsum("ij,ij->i", target.normals, way) > 0.6
    open_ = [
        not window.controls.pointing._hidden(p, n)
        for p, n in zip(target.positions, target.normals, strict=True)
    ]
    return np.flatnonzero(facing & np.array(open_)), places


def map_places(window):
    """Taxel of each vertex of the flat map shown, and its place in the window (k, 2) [px]."""
    panel = window.scene.panel
    targets = window.controls.pointing._map_targets(panel.part)
    uv = np.column_stack([targets.uv, np.zeros(len(targets.uv))])
    return targets.taxels, project(panel.renderer, uv) + np.array(panel.renderer.GetOrigin())


def picture(window):
    window.scene.canvas.cache.forget()
    return window.scene.frame()


def test_pointing_at_the_body_names_that_very_taxel(window):
    taxels, places = seen_taxels(window)
    assert len(taxels) > 100
    # The nearest taxel to the pixel is meant; neighbours are 7 pixels apart, pixels are whole.
    for taxel in taxels[::10]:
        pick = window.controls.pointing.pick(*np.round(places[taxel]))
        assert pick is not None
        near = np.linalg.norm(places[pick.taxel] - places[taxel])
        assert (pick.part, pick.where) == ("torso", "body")
        assert pick.taxel == taxel or near < 1.5


def test_pointing_at_the_map_names_that_very_taxel(window):
    taxels, places = map_places(window)
    for row in range(0, len(taxels), 9):
        pick = window.controls.pointing.pick(*places[row])
        assert (pick.part, pick.taxel, pick.where) == ("torso", taxels[row], "map")


def test_pointing_beside_the_skin_names_nothing(window):
    assert window.controls.pointing.pick(2, 300) is None
    panel = window.scene.panel.renderer
    x, y = panel.GetOrigin()
    assert window.controls.pointing.pick(x + 2, y + 2) is None


def test_box_tells_all_that_is_known_of_a_taxel(window, icub, prepared):
    taxels, places = seen_taxels(window)
    taxel = int(taxels[len(taxels) // 2])
    before = picture(window)
    hover(window, *places[taxel])
    pointing = window.controls.pointing
    skin = icub.skin("torso")
    taxel = pointing.pointed.taxel
    text = "\n".join(pointing.lines(pointing.pointed))
    assert f"torso, channel {skin.channels[taxel]}" in text
    assert f"module {skin.modules[taxel]}" in text
    x, y, z = 1e3 * skin.positions[taxel]
    assert f"position {x:.1f} {y:.1f} {z:.1f} mm" in text
    assert "normal " in text
    assert "structure " in text
    assert "pressure " in text
    faces = prepared("torso").mesh.faces
    around = set(skin.channels[faces[(faces == taxel).any(axis=1)].ravel()]) - {
        skin.channels[taxel]
    }
    told = text.split("neighbours ")[1].split("\n")[0].split()
    assert {int(word) for word in told} == around
    assert (picture(window) != before).any()
    hover(window, 2, 300)
    assert pointing.pointed is None
    assert np.array_equal(picture(window), before), "the box goes away without a trace"


def test_hovering_is_looked_at_no_more_often_than_its_pace(window, monkeypatch):
    pointing = window.controls.pointing
    looks = []
    monkeypatch.setattr(pointing, "pick", lambda x, y: looks.append((x, y)))
    monkeypatch.setattr(pointing._pace, "clock", lambda: 100.0)
    for k in range(50):
        mouse(window, "MouseMoveEvent", 100 + k, 300)
        window.turn()
    assert looks == [(100.0, 300.0)]


def test_click_chooses_taxel_module_and_patch_on_body_and_map(window, icub, prepared):
    taxels, places = seen_taxels(window)
    taxel = int(taxels[len(taxels) // 3])
    scene, skin = window.scene, icub.skin("torso")
    click(window, *places[taxel])
    (chosen,) = scene.selection["torso"]
    click(window, *places[taxel], shift=True)
    module = np.flatnonzero(skin.modules == skin.modules[chosen])
    assert np.array_equal(scene.selection["torso"], module)
    click(window, *places[taxel], control=True)
    assert set(module) < set(scene.selection["torso"])
    owners, on_map = map_places(window)
    click(window, *on_map[10])
    assert scene.selection["torso"].tolist() == [owners[10]]
    click(window, 2, 300)
    assert scene.selection == {}


def test_keys_choose_what_is_pointed_at(window, icub):
    owners, on_map = map_places(window)
    skin = icub.skin("torso")
    key(window, "m")
    assert "point at a taxel" in window.controls.notice.text
    hover(window, *on_map[40])
    key(window, "m")
    assert np.array_equal(
        window.scene.selection["torso"], np.flatnonzero(skin.modules == skin.modules[owners[40]])
    )
    key(window, "p")
    assert owners[40] in window.scene.selection["torso"]
    key(window, "c")
    assert window.scene.selection == {}


def test_lasso_on_the_map_chooses_what_it_encloses(window):
    owners, places = map_places(window)
    low, high = places.min(axis=0), places.max(axis=0)
    middle = (low + high) / 2
    corners = [
        low - 3,
        (middle[0], low[1] - 3),
        (middle[0], high[1] + 3),
        (low[0] - 3, high[1] + 3),
    ]
    wanted = np.unique(owners[places[:, 0] < np.round(middle[0])])
    camera = window.scene.plotter.renderers[0].GetActiveCamera().GetPosition()
    drag(window, corners)
    chosen = window.scene.selection["torso"]
    # Corners fall on whole pixels: taxels on the line itself may be on either side of it.
    assert len(np.setxor1d(chosen, wanted)) <= 2
    assert len(chosen) > 50
    assert window.scene.plotter.renderers[0].GetActiveCamera().GetPosition() == camera
    right = [
        (middle[0], low[1] - 3),
        high + 3 - (0, high[1] - low[1] + 6),
        high + 3,
        (middle[0], high[1] + 3),
    ]
    drag(window, right, shift=True)
    assert len(window.scene.selection["torso"]) >= len(np.unique(owners)) - 2


def test_dragging_the_body_turns_the_camera_and_chooses_nothing(window):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()
    before = camera.GetPosition()
    drag(window, [(200, 300), (230, 300), (260, 310)])
    assert camera.GetPosition() != before
    assert window.scene.framing.mode == "free"
    assert window.scene.selection == {}
    led = camera.GetPosition()
    window.turn()
    assert camera.GetPosition() == led
    key(window, "r")
    assert camera.GetPosition() != led
    key(window, "a")
    assert window.scene.framing.mode == "auto"


def test_slider_is_dragged_through_the_recording(window):
    slider, player = window.controls.slider, window.player
    assert slider.shown
    x, y = slider.place(2.0)
    assert slider.seconds(x) == pytest.approx(2.0)
    drag(window, [slider.place(0.0), (x, y), (x, y + 60)])
    wait_until(window, lambda: player.moment.time == pytest.approx(2.0, abs=0.03))
    window.turn()
    assert window.scene.moment is player.moment
    assert slider.position == pytest.approx(2.0, abs=0.03)  # a pixel is 8 ms
    assert window.scene.selection == {}


def test_keys_lead_the_recording(window):
    player = window.player
    key(window, "Right")
    wait_until(window, lambda: player.moment.time == pytest.approx(0.02))
    key(window, "Left")
    assert player.moment.time == 0.0
    key(window, "Up")
    wait_until(window, lambda: player.moment.time == pytest.approx(1.0))
    key(window, "Home")
    wait_until(window, lambda: player.moment.time == 0.0)
    key(window, "plus")
    assert player.speed == 2.0
    key(window, "minus")
    assert player.speed == 1.0
    key(window, "l")
    assert player.loop
    assert player.paused
    key(window, "space")
    assert not player.paused
    wait_until(window, lambda: player.moment.time > 0.1)
    key(window, "space")
    assert player.paused


def test_keys_choose_layers_style_and_map(window):
    scene = window.scene
    for number, name in enumerate(LAYERS, start=1):
        key(window, str(number))
        assert scene.layer.name == name
    key(window, "1")
    before = picture(window)
    key(window, "d")
    assert scene.style == "discs"
    assert (picture(window) != before).any()
    key(window, "d")
    assert scene.style == "surface"
    key(window, "Tab")
    assert scene.panel.part == "left_arm"
    assert not window.controls.following


def test_camera_presets_look_from_their_sides(window):
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
        key(window, name)
        seen[side] = towards()
    level = {side: way[:2] / np.linalg.norm(way[:2]) for side, way in seen.items()}
    np.testing.assert_allclose(level["front"], -level["back"], atol=1e-9)
    np.testing.assert_allclose(level["left"], -level["right"], atol=1e-9)
    # Seen from above, left is a quarter turn counter-clockwise of front.
    np.testing.assert_allclose(level["left"], [-level["front"][1], level["front"][0]], atol=1e-9)
    assert seen["top"][2] > 0.98


def test_focus_brings_a_touch_close(window, press):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()
    key(window, "r")
    key(window, "g")
    assert "nothing is touched" in window.controls.notice.text
    _, touch = press("torso", 100)
    window.scene.set_touches([touch])
    window.scene.update()
    key(window, "r")
    far = camera.GetDistance()
    key(window, "g")
    assert camera.GetDistance() < 0.8 * far, "chest and arm are half a metre wide"
    centre = window.scene.canvas.touch_view.targets[0].points.mean(axis=0)
    (place,) = project(window.scene.plotter.renderers[0], centre[None])
    width, height = window.scene.plotter.renderers[0].GetSize()
    assert abs(place[0] / width - 0.5) < 0.15
    assert abs(place[1] / height - 0.5) < 0.15
    window.scene.set_touches([])


def test_help_lists_every_key_and_goes_away(window):
    text = "\n".join(help_lines())
    assert all(one.text in text for one in KEYS)
    names = [name for one in KEYS for name in one.names]
    assert len(names) == len(set(names)), "no key stands for two things"
    assert all(not one.names or callable(attrgetter(one.action)(window.controls)) for one in KEYS)
    before = picture(window)
    key(window, "h")
    assert window.controls.help_shown
    assert (picture(window) != before).any()
    key(window, "h")
    assert not window.controls.help_shown
    assert np.array_equal(picture(window), before)


def test_help_is_whole_in_the_picture(window):
    key(window, "h")
    box = window.controls._help
    size = [0.0, 0.0]
    box.actor.GetSize(box.renderer, size)
    assert size[0] <= box.renderer.GetSize()[0]
    assert size[1] <= box.renderer.GetSize()[1]
    key(window, "h")


def test_letters_follow_a_window_of_another_size(window):
    taxels, places = seen_taxels(window)
    hover(window, *places[taxels[len(taxels) // 2]])
    controls, plain = window.controls, window.scene.plotter.window_size
    key(window, "h")

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
    key(window, "h")


def test_unknown_keys_do_nothing_and_q_closes(window):
    key(window, "w")
    key(window, "F7")
    assert not window.controls.closed
    key(window, "q")
    assert window.controls.closed
    assert not window.turn(), "nothing is drawn any more"


def test_view_is_saved_and_loaded(window, tmp_path):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()
    key(window, "4")
    key(window, "d")
    drag(window, [(200, 300), (260, 320)])
    window.controls.pointing.selection.replace("torso", [5, 6])
    window.controls.pointing.refresh()
    saved = camera.GetPosition()
    key(window, "v")
    content = json.loads((tmp_path / "skinmap-view.json").read_text())
    assert (content["layer"], content["style"]) == ("structures", "discs")
    for name in ("1", "d", "r", "c"):
        key(window, name)
    assert camera.GetPosition() != saved
    key(window, "V")
    np.testing.assert_allclose(camera.GetPosition(), saved, rtol=1e-12)
    assert (window.scene.layer.name, window.scene.style) == ("structures", "discs")
    assert window.scene.selection["torso"].tolist() == [5, 6]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"robot": "Baxter"}, "saved of 'Baxter'"),
        ({"layer": "heat"}, "no layer 'heat'"),
        ({"selection": {"torso": [100000]}}, "names taxel 100000"),
        ({"selection": {"wing": [0]}}, "no part in this scene 'wing'"),
    ],
)
def test_view_of_something_else_is_told_and_changes_nothing(window, tmp_path, change, match):
    key(window, "v")
    path = tmp_path / "skinmap-view.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    key(window, "2")
    key(window, "V")
    assert match in window.controls.notice.text
    assert window.scene.layer.name == "raw"
    assert not window.controls.closed


def test_files_are_written_from_the_keyboard(window, tmp_path):
    for name in ("s", "x", "e", "o"):
        key(window, name)
    for _ in range(200):
        window.turn()
        if window.controls.files.recording.count >= 2:
            break
        window.player.wait(window.player.number, 0.02)
    key(window, "o")
    made = {path.suffix for path in tmp_path.iterdir()}
    assert {".png", ".glb", ".html"} <= made
    assert {".mp4", ".gif"} & made
    assert all(path.stat().st_size > 1000 for path in tmp_path.iterdir())


def test_folder_that_is_gone_ends_no_session(window, tmp_path):
    window.controls.files.folder = tmp_path / "gone"
    for name in ("s", "x", "e", "o"):
        key(window, name)
        assert "no folder" in window.controls.notice.text
    assert not window.controls.closed


@pytest.mark.skipif(not has_display(), reason="no display: a window cannot be opened")
def test_play_shows_moments_until_closed(icub, prepared, moments):
    from viewer.scene import Scene
    from viewer.window import play

    torso = prepared("torso")
    scene = Scene(
        icub, {"torso": torso.mesh}, {"torso": torso.flat}, links=["chest"],
        window_size=(400, 300), off_screen=False,
    )  # fmt: skip

    def played():
        yield from (Moment(m.time, {"torso": m.pressures["torso"]}) for m in moments[:6])
        scene.plotter.iren.interactor.ExitCallback()  # as the window's own close button does
        yield Moment(1.0, {"torso": moments[0].pressures["torso"]})

    assert play(scene, played()) >= 1


def test_picture_that_comes_too_late_is_held_back_and_then_marked(window, monkeypatch):
    """Each picture takes 150 ms of a clock that stands still otherwise."""
    player, scene = window.player, window.scene
    now = [player._outlet.clock()]
    monkeypatch.setattr(player._outlet, "clock", lambda: now[0])
    cache, status = scene.canvas.cache, scene.canvas.status
    draw, present, presented = cache.draw, cache.present, []

    def slow(**how):
        drawn = draw(**how)
        now[0] += 0.15
        return drawn

    monkeypatch.setattr(cache, "draw", slow)
    monkeypatch.setattr(cache, "present", lambda: (presented.append(cache.held), present()))
    for count in range(4):
        pressures = {p: np.full(len(one.skin), 10.0 + count) for p, one in scene.layers.items()}
        player._outlet.show(Moment(100.0 + count, pressures), fresh=True)
        monkeypatch.setattr(player, "_paused", False)
        window.turn()
        monkeypatch.setattr(player, "_paused", True)
        assert len(presented) == max(0, count - 1)
    assert "late: shown after 150 ms" in " ".join(status.texts)
    assert (window.punctual.held, window.punctual.late) == (2, 2)
    monkeypatch.setattr(cache, "draw", draw)
    window.turn()  # halted: nothing is late
    window.turn()
    assert "late" not in " ".join(status.texts)
