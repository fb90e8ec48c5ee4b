from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    SkinMismatchError,
    UnknownNameError,
)
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live import open_source
from skinmap.live.sources.open_source import sources
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import Source, StreamInfo, blocks
from skinmap.touch.recording import Recording, save_recordings


def recording(part: str, samples: int, width: int, rate: float = 50.0) -> Recording:
    pressures = np.full((samples, width), 1 + len(part), np.uint8)
    return Recording(part, np.arange(samples) / rate, pressures, np.full(samples, -1), ())


@pytest.fixture
def saved(tmp_path):
    def save(*recordings: Recording):
        path = tmp_path / "touches.npz"
        save_recordings(list(recordings), path)
        return path

    return save


def played(source: Source) -> np.ndarray:
    return np.concatenate([block.values for block in blocks(source)])


def test_recording_plays_all_parts_together_and_rests_the_short_one(saved):
    source = open_source(saved(recording("a", 5, 2), recording("bb", 9, 3)), speed=np.inf)
    assert (source.info.parts, source.info.widths, source.info.rate) == (("a", "bb"), (2, 3), 50.0)
    values = played(source)
    assert values.dtype == np.uint8
    assert (values[:, source.info.part_slice("bb")] == 3).all()
    assert (values[:5, :2] == 2).all()
    assert not values[5:, :2].any()


def test_recording_of_chosen_parts(saved):
    path = saved(recording("a", 5, 2), recording("bb", 9, 3))
    source = open_source(path, parts=["bb"], speed=np.inf)
    assert source.info.parts == ("bb",)
    with pytest.raises(UnknownNameError, match=r"no part in .* 'c'; the parts are: a, bb"):
        open_source(path, parts=["c"])


def test_recording_knows_the_robots_skin(saved, icub):
    source = open_source(saved(recording("left_hand", 3, 48)), robot=icub)
    assert set(source.info.fingerprints) == {"left_hand"}
    with pytest.raises(SkinMismatchError, match="47 channels for 'left_hand'; its 48 taxels"):
        open_source(saved(recording("left_hand", 3, 47)), robot=icub)


def test_recording_of_several_rates_is_refused(saved):
    path = saved(recording("a", 5, 2), recording("bb", 9, 3, rate=100.0))
    with pytest.raises(SkinMismatchError, match="sampled at other times"):
        open_source(path)
    assert open_source(path, parts=["bb"]).info.rate == pytest.approx(100.0)


def test_empty_recording_is_refused(saved):
    with pytest.raises(DataFormatError, match="no recording in it"):
        open_source(saved())


def test_open_source_says_what_there_is(tmp_path):
    with pytest.raises(
        UnknownNameError,
        match=r"no source 'simm'; did you mean 'sim'\? The sources are: sim, lsl, mujoco, "
        r"zenoh, zmq",
    ):
        open_source("simm")
    with pytest.raises(MissingFileError, match=r"no file 'touches\.npz'"):
        open_source("touches.npz")
    with pytest.raises(MissingFileError, match="no file"):
        open_source(tmp_path / "nothing")
    with pytest.raises(InvalidArrayError, match=r"raw, seed=N and gestures.*not 'sim:fast'"):
        open_source("sim:fast")


def test_open_source_simulates_touches_in_time():
    open_source("sim:time,poke").close()
    source = open_source("sim:stroke,tap", robot="kaspar", parts=["left_hand"], speed=np.inf)
    while len(source.truth) < 8:
        assert len(source.read(30.0).times)
    source.close()
    assert {one.label for one in source.truth} == {"stroke", "tap"}


def test_open_source_finds_plug_ins(monkeypatch):
    asked = {}
    made = Playback(
        RecordedStream(StreamInfo("mine", ("arm",), (1,), 1.0), [0.0], np.zeros((1, 1), np.uint8))
    )

    def opened(address, **how):
        asked.update(how, address=address)
        return made

    monkeypatch.setitem(sources._own, "mine", opened)
    assert open_source("mine:over:there", seed=3) is made
    assert asked["address"] == "over:there"
    assert asked["seed"] == 3
