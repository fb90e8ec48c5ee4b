"""The whole recording on the time line from the start, and ways to the next touch."""

from __future__ import annotations

import contextlib
import threading
from contextlib import closing

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live import Moment
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import SourceEnded, StreamInfo
from skinmap.live.touched_taxels import touch_stretches
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.interaction.overlays import lane_columns
from viewer.playing.overview import fill_overview
from viewer.playing.player import LoopFeed, Player
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
    source = Playback(
        RecordedStream(StreamInfo("x", ("torso",), (240,), 50.0), times, values), speed=np.inf
    )
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


@pytest.fixture(scope="module")
def busy(tmp_path_factory):
    """Fifteen seconds of the torso, touched most of the time, with the marks of its touches."""
    robot = skinmap.load_robot("kaspar")
    path = tmp_path_factory.mktemp("busy") / "busy.mcap"
    made = skinmap.simulate(robot.skin("torso"), per_gesture=3, rng=1)
    skinmap.save_recordings(made, path, robot=robot)
    session = Session(robot, ("torso",), source=str(path))
    session.prepare()
    return session


def named(moment):
    """What a moment's touches are called, how surely, and where they are."""
    return sorted(
        (one.part, one.label, float(np.nan_to_num(one.confidence, nan=-1.0)), one.taxels.tolist())
        for one in moment.touches
    )


def test_names_at_any_time_are_those_of_a_play_from_the_beginning(busy):
    """To the bit, and after one jump as after many."""
    played = LoopFeed(busy.live())
    played.pace(1.0, halted=False, hurried=True)
    straight = {}
    with closing(played), contextlib.suppress(SourceEnded):
        while (moment := played.step(0.0, threading.Event())) is not None:
            straight[round(moment.time, 4)] = named(moment)
    assert sum(map(len, straight.values())) > 300
    with closing(LoopFeed(busy.live())) as feed:
        for wanted in np.random.default_rng(0).uniform(0.0, feed.duration, 12).tolist():
            moments, since = feed.lead(wanted, 3.0)
            assert moments[-1].time == pytest.approx(wanted, abs=0.011)
            for moment in moments:
                if moment.time >= since:
                    assert named(moment) == straight[round(moment.time, 4)]


def test_plots_have_what_was_before_after_every_jump():
    """Two hundred: wherever there are samples before, all ten seconds of them are plotted."""
    robot = skinmap.load_robot("kaspar")
    times = np.arange(400) / 10.0
    values = np.zeros((400, 240), np.uint8)
    values[100:110, :5] = 90
    info = StreamInfo("still", ("torso",), (240,), 10.0)
    loop = TouchLoop(robot, Playback(RecordedStream(info, times, values)))
    rng = np.random.default_rng(1)
    with Player(loop, paused=True) as player:
        assert player.wait(0, 10.0)
        player.remember(10.0)
        for wanted in rng.uniform(0.0, player.duration - 0.1, 200).tolist():
            player.seek(wanted)
            while abs(player.moment.time - wanted) > 0.051:
                assert player.wait(player.number, 10.0)
            now = player.moment.time
            found = [one.time for one in player.recall(now - 10.0, now)]
            assert found[-1] == now
            assert found[0] == pytest.approx(max(now - 10.0, 0.0), abs=0.11)
            assert np.diff(found).max(initial=0.1) < 0.11


def test_time_line_has_marks_and_names_of_all_touches_before_they_are_played(busy):
    with Player(busy.live(), paused=True) as player:
        assert player.wait(0, 10.0)
        thread = fill_overview(busy, player)
        assert thread is not None
        thread.join(60.0)
        rows = player.spans()
    marks = [row for row in rows if row[5]]
    found = [row for row in rows if not row[5]]
    assert len(marks) == 12
    assert all(row[3].endswith(", marked") for row in marks)
    assert {row[4] for row in rows} == {"torso"}
    assert max(row[0] for row in found) > 10.0
    assert sum(row[3] != "touch on torso" for row in found) >= 8, "names without playing"


def test_missing_samples_are_a_gap_on_the_time_line(tmp_path):
    robot = skinmap.load_robot("kaspar")
    times = np.concatenate([np.arange(100), np.arange(400, 500)]) / 50.0
    path = tmp_path / "gap.mcap"
    with closing(McapRecording(path, parts=["torso"], widths={"pressure": [240]}, rate=50.0)) as to:
        for time in times.tolist():
            to.add("pressure", time, np.zeros(240, np.uint8))
    session = Session(robot, ("torso",), source=str(path))
    session.prepare()
    with Player(session.live(), paused=True) as player:
        assert player.wait(0, 10.0)
        thread = fill_overview(session, player)
        assert thread is not None
        thread.join(60.0)
        assert [row[:2] + row[3:5] for row in player.spans()] == [
            [1.98, 8.0, "no samples for 6.0 s", ""]
        ]


def test_many_touches_are_drawn_in_as_many_bars_as_there_are_pixels():
    touches = tuple(
        (0.1 * k, 0.1 * k + 0.05, f"#0000{k % 7:02x}", "x", "ab"[k % 2], k % 3 == 0)
        for k in range(10_000)
    )
    rows = list(lane_columns(touches, ("a", "b"), (0.0, 1000.0), 500))
    assert {(lane, foot) for lane, foot, *_ in rows} == {
        ("a", 0.0), ("a", 0.45), ("b", 0.0), ("b", 0.45),
    }  # fmt: skip
    for *_, runs in rows:
        assert 0 < len(runs) <= 500
        assert all(0 <= a < b <= 500 for a, b, _ in runs)


def test_simulator_has_no_overview():
    robot = skinmap.load_robot("kaspar")
    session = Session(robot, ("torso",), source="sim")
    with Player(iter(())) as player:
        assert fill_overview(session, player) is None
