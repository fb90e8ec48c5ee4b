"""The whole recording on the time line from the start, and ways to the next touch."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.live import Moment
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.live.touched_taxels import touch_stretches
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.playing.overview import fill_overview
from viewer.playing.player import Player
from viewer.playing.recent_moments import Timeline
from viewer.view_options import Session


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("overview") / "one.mcap"
    words = ["record", "sim", "--robot", "kaspar", "--part", "torso", "--seconds", "8"]
    assert CliRunner().invoke(cli, [*words, "--speed", "inf", "-o", str(path)]).exit_code == 0
    return path


def test_stretches_are_the_presses_that_were_planted():
    robot = skinmap.load_robot("kaspar")
    skin = PreparedSkin(robot.skin("torso"))
    distance = np.linalg.norm(skin.skin.positions - skin.skin.positions[100], axis=1)
    times = np.arange(600) / 50.0
    values = np.zeros((600, 240), np.float32)
    presses = [(4.0, 5.0), (5.05, 5.5), (9.0, 9.4)]  # the first pause is none
    for began, ended in presses:
        values[np.ix_((times >= began) & (times < ended), np.argsort(distance)[:7])] = 120.0
    source = Playback(StreamInfo("x", ("torso",), (240,), 50.0), times, values, speed=np.inf)
    with_loop = TouchLoop(robot, source, skins={"torso": skin})
    found = [one for block in touch_stretches(with_loop) for one in block]
    assert [part for part, *_ in found] == ["torso", "torso"]
    np.testing.assert_allclose(
        [own for _, *own in found], [(4.0, 5.48), (9.0, 9.38)], rtol=0, atol=0.021
    )


def test_time_line_has_the_whole_recording_before_it_is_played(recording):
    robot = skinmap.load_robot("kaspar")
    session = Session(robot, ("torso",), source=str(recording))
    session.prepare()
    with Player(session.live(), paused=True) as player:
        assert player.wait(0, 10.0)
        thread = fill_overview(session, player)
        assert thread is not None
        thread.join(30.0)
        assert not thread.is_alive()
        spans = player.spans()
        assert len(spans) >= 2
        begun = sorted(span[0] for span in spans)
        assert begun[-1] > 3.0  # far ahead of what was played
        for want in [one for one in begun if one > player.position + 0.3][:2]:
            number = player.number
            assert player.next_touch(1)
            assert player.position == pytest.approx(want, abs=0.05)
            assert player.wait(number, 10.0)
        assert player.next_touch(-1)
        player.seek(0.0)
        assert not player.next_touch(-1)


def test_touch_that_is_played_takes_its_place_on_the_time_line():
    line = Timeline()
    line.fill([("torso", 1.0, 2.0), ("torso", 4.0, 5.0)])
    assert [span.label for span in line.spans()] == ["touch", "touch"]
    touch = NamedTouch("torso", np.array([3]), np.zeros(3), "poke", 0.9, identity=7)
    for time in (1.1, 1.5):
        line.see(Moment(time, {"torso": np.zeros(4)}, (touch,)))
    line.fill([("torso", 1.0, 2.0)])  # known by now
    assert [(span.label, span.began) for span in line.spans()] == [("poke", 1.0), ("touch", 4.0)]


def test_simulator_has_no_overview():
    robot = skinmap.load_robot("kaspar")
    session = Session(robot, ("torso",), source="sim")
    with Player(iter(())) as player:
        assert fill_overview(session, player) is None
