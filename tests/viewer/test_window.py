"""The window off screen: its camera, saved views, files and end; `interaction` has the rest."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinmap.display import has_display
from skinmap.live.contacts.named_touch import Moment


def test_dragging_the_body_turns_the_camera_and_chooses_nothing(window, hands):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()
    before = camera.GetPosition()
    hands.drag([(200, 300), (230, 300), (260, 310)])
    assert camera.GetPosition() != before
    assert window.scene.framing.mode == "free"
    assert window.scene.selection == {}
    led = camera.GetPosition()
    window.turn()
    assert camera.GetPosition() == led
    hands.key("r")
    assert camera.GetPosition() != led
    hands.key("a")
    assert window.scene.framing.mode == "auto"


def test_view_is_saved_and_loaded(window, hands, tmp_path):
    camera = window.scene.plotter.renderers[0].GetActiveCamera()
    hands.key("4")
    hands.key("d")
    hands.drag([(200, 300), (260, 320)])
    window.controls.pointing.selection.replace("torso", [5, 6])
    window.controls.pointing.refresh()
    saved = camera.GetPosition()
    hands.key("v")
    content = json.loads((tmp_path / "skinmap-view.json").read_text())
    assert (content["layer"], content["style"]) == ("structures", "discs")
    for name in ("1", "d", "r", "c"):
        hands.key(name)
    assert camera.GetPosition() != saved
    hands.key("V")
    np.testing.assert_allclose(camera.GetPosition(), saved, rtol=1e-12)
    assert (window.scene.layer.name, window.scene.style) == ("structures", "discs")
    assert window.scene.selection["torso"].tolist() == [5, 6]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"robot": "Baxter"}, "saved of 'Baxter'"),
        ({"layer": "heat"}, "no layer 'heat'"),
        ({"selection": {"torso": [100000]}}, "not 100000 to 100000"),
        ({"selection": {"wing": [0]}}, "no part in this scene 'wing'"),
    ],
)
def test_view_of_something_else_is_told_and_changes_nothing(window, hands, tmp_path, change, match):
    hands.key("v")
    path = tmp_path / "skinmap-view.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    hands.key("2")
    hands.key("V")
    assert match in window.controls.notice.text
    assert window.scene.layer.name == "raw"
    assert not window.controls.closed


def test_pictures_are_written_from_the_keyboard(window, hands, tmp_path):
    hands.key("s")
    hands.key("s")
    assert len(list(tmp_path.glob("skinmap-*.png"))) == 2
    assert all(path.stat().st_size > 1000 for path in tmp_path.iterdir())


def test_folder_that_is_gone_ends_no_session(window, hands, tmp_path):
    window.controls.folder = tmp_path / "gone"
    hands.key("s")
    assert "no folder" in window.controls.notice.text
    assert not window.controls.closed


@pytest.mark.skipif(not has_display(), reason="no display: a window cannot be opened")
def test_play_shows_moments_until_closed(icub, prepared, wandering):
    from viewer import Scene, play

    torso = prepared("torso")
    scene = Scene(
        icub, {"torso": torso.mesh}, {"torso": torso.flat}, links=["chest"],
        window_size=(400, 300), off_screen=False,
    )  # fmt: skip

    def played():
        yield from (Moment(m.time, {"torso": m.pressures["torso"]}) for m in wandering[:6])
        scene.plotter.iren.interactor.ExitCallback()  # as the window's own close button does
        yield Moment(1.0, {"torso": wandering[0].pressures["torso"]})

    assert play(scene, played()) >= 1


def test_picture_that_comes_too_late_is_held_back_and_then_marked(window, monkeypatch):
    """Each picture takes 150 ms of a clock that stands still otherwise."""
    player, scene = window.player, window.scene
    now = [player.clock()]
    monkeypatch.setattr(player, "clock", lambda: now[0])
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
        player.show(Moment(100.0 + count, pressures), fresh=True)
        monkeypatch.setattr(player, "paused", False)
        window.turn()
        monkeypatch.setattr(player, "paused", True)
        assert len(presented) == max(0, count - 1)
    assert "late: shown after 150 ms" in " ".join(status.texts)
    assert (window.punctual.held, window.punctual.late) == (2, 2)
    monkeypatch.setattr(cache, "draw", draw)
    window.turn()  # halted: nothing is late
    window.turn()
    assert "late" not in " ".join(status.texts)
