"""The viewer as a library: its page's Python works as written, and it loads only what it shows."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.live.contacts.named_touch import Moment

PAGE = Path(__file__).parents[2] / "docs" / "viewer.md"
BLOCKS = [
    block
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    if "scene" in block  # what a notebook's cell shows is tried in test_notebook.py
]


@pytest.mark.parametrize("block", BLOCKS)
def test_python_of_the_page_works_as_written(opengl, tmp_path, monkeypatch, block):
    monkeypatch.chdir(tmp_path)
    sizes = {"torso": 430, "left_arm": 350}
    known = {"moment": Moment(0.5, {part: np.linspace(0, 255, n) for part, n in sizes.items()})}
    exec(compile(block, str(PAGE), "exec"), known)
    known["scene"].close()
    written = re.findall(r'screenshot\("(.*?)"\)', block)
    assert written
    assert all((tmp_path / name).stat().st_size > 10_000 for name in written)


def test_scene_of_one_part_prepares_no_other_and_reads_no_other_link(opengl, monkeypatch):
    import skinmap
    from skinmap.touch.prepared_skin import PreparedSkin
    from viewer import Scene

    robot = skinmap.load_robot("icub")
    loaded, read, prepared = [], [], []
    skin_of, mesh_of, init = robot.skin, robot.body.mesh, PreparedSkin.__init__
    monkeypatch.setattr(robot, "skin", lambda part: loaded.append(part) or skin_of(part))
    monkeypatch.setattr(robot.body, "mesh", lambda link: read.append(link) or mesh_of(link))

    def watched(self, skin, *args, **options):
        prepared.append(skin.part)
        init(self, skin, *args, **options)

    monkeypatch.setattr(PreparedSkin, "__init__", watched)
    scene = Scene.load(robot, ["left_hand"], links="skin", window_size=(320, 240))
    scene.frame()
    scene.close()
    assert set(loaded) == {"left_hand"}
    assert prepared == ["left_hand"]
    assert set(read) == {"l_hand"}


def test_what_does_not_exist_is_answered_with_what_does(opengl, tmp_path):
    from viewer import Scene

    with pytest.raises(UnknownNameError, match=r"'chest'.*torso"):
        Scene.load("icub", ["chest"])
    with pytest.raises(UnknownNameError, match=r"layer 'heat'.*pressure.*health"):
        Scene.load("icub", ["left_hand"], links=(), layer="heat")
    with pytest.raises(SkinMismatchError, match=r"3 .*left_hand"):
        Scene.load("icub", ["left_hand"], links=(), healths={"left_hand": ["ok"] * 3})


def test_a_moment_made_by_hand_shows_its_contacts(monkeypatch):
    import skinmap
    from skinmap.report.touch_figures import moment_figure
    from skinmap.touch.prepared_skin import PreparedSkin

    robot = skinmap.load_robot("kaspar")
    skin = robot.skin("left_hand")
    pressures = np.where(np.arange(len(skin)) < 3, 200.0, 0.0)
    shown = []
    monkeypatch.setattr("viewer.picture.write_files", lambda session, *_: shown.append(session))
    skinmap.show(robot, Moment(0.0, {"left_hand": pressures}), path="hand.png")
    (moment,) = shown[0].moments(None)
    felt = np.concatenate([touch.taxels for touch in moment.touches])
    assert sorted(felt) == [0, 1, 2]
    prepared = {"left_hand": PreparedSkin(skin)}
    figure = moment_figure(Moment(0.0, {"left_hand": pressures}, skins=prepared))
    texts = [text.get_text() for axis in figure.axes for text in axis.texts]
    (title,) = [text for text in texts if text.startswith("left_hand at")]
    assert title.endswith(", ".join(["touch"] * len(moment.touches)))
    assert "no touch" not in title
