"""Recordings of all formats as sources."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap.live
from skinmap.errors import DataFormatError, MissingFileError, SkinMismatchError, UnknownNameError
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.recordings.learning import write_npz
from skinmap.io.recordings.touch_files import load_recordings, save_recordings
from skinmap.live.sources.open_source import open_recording, open_track
from skinmap.live.sources.source import Seekable, SourceEnded, blocks
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.simulator import simulate


@pytest.fixture(scope="module")
def touches(icub) -> list[Recording]:
    rng = np.random.default_rng(1)
    return [
        simulate(icub.skin(part), rng=rng, per_gesture=2, variety=0.0)
        for part in ("left_hand", "left_foot")
    ]


@pytest.fixture(scope="module")
def files(touches, icub, tmp_path_factory):
    """The same touches in each format of ours."""
    folder = tmp_path_factory.mktemp("files")
    save_recordings(touches, folder / "t.mcap", robot=icub)
    save_recordings(touches, folder / "t.npz")
    write_npz(open_track(folder / "t.mcap"), folder / "arrays.npz")
    return folder


def all_values(source) -> np.ndarray:
    return np.concatenate([block.values for block in blocks(source)])


@pytest.mark.parametrize("name", ["t.mcap", "t.npz", "arrays.npz"])
def test_formats_play_the_same(files, touches, icub, name):
    source = open_recording(files / name, robot=icub, speed=np.inf)
    assert isinstance(source, Seekable)
    assert source.info.parts == ("left_hand", "left_foot")
    assert source.info.rate == pytest.approx(50.0, rel=1e-9)
    values = all_values(source)
    for part, one in zip(source.info.parts, touches, strict=True):
        columns = source.info.part_slice(part)
        count = len(one.times)
        np.testing.assert_array_equal(values[:count, columns], one.pressures)
        assert not values[count:, columns].any()


@pytest.mark.parametrize("name", ["t.mcap", "t.npz", "arrays.npz"])
def test_formats_load_the_same(files, touches, name):
    for one, other in zip(touches, load_recordings(files / name), strict=True):
        assert (one.part, one.labels) == (other.part, other.labels)
        for field in ("times", "pressures", "events", "subjects"):
            np.testing.assert_array_equal(getattr(one, field), getattr(other, field))


def test_open_source_plays_mcap_from_any_place(files, touches):
    source = skinmap.live.open_source(files / "t.mcap", speed=np.inf)
    source.seek(1.0)
    assert source.read(1.0).times[0] == pytest.approx(1.0, abs=1e-9)
    source.close()
    with pytest.raises(SourceEnded):
        source.read(0.0)


def test_parts_are_chosen_in_the_order_asked_for(files, touches):
    source = open_recording(files / "t.mcap", parts=["left_foot"], speed=np.inf)
    assert source.info.parts == ("left_foot",)
    assert set(source.info.fingerprints) == {"left_foot"}
    count = len(touches[1].times)
    np.testing.assert_array_equal(all_values(source)[:count], touches[1].pressures)
    with pytest.raises(
        UnknownNameError, match=r"no part in stream .t\.mcap. 'tail'; the parts are"
    ):
        open_recording(files / "t.mcap", parts=["tail"])


def test_recording_of_another_skin_is_refused_by_name(tmp_path, icub):
    skin = icub.skin("left_hand")
    file = McapRecording(
        tmp_path / "t.mcap",
        parts=["left_hand"],
        widths={"pressure": [len(skin)]},
        fingerprints={"left_hand": "f" * 64},
    )
    file.add("pressure", 0.0, np.zeros(len(skin), np.uint8))
    file.close()
    with pytest.raises(SkinMismatchError, match="another skin: the layout of 'left_hand' is not"):
        open_recording(tmp_path / "t.mcap", robot=icub)


def test_recording_of_too_few_channels_is_refused(tmp_path, icub):
    file = McapRecording(tmp_path / "t.mcap", parts=["left_hand"], widths={"raw": [5]})
    file.add("raw", 0.0, np.zeros(5, np.uint8))
    file.close()
    with pytest.raises(SkinMismatchError, match="has 5 channels for 'left_hand'; its 48 taxels"):
        open_recording(tmp_path / "t.mcap", robot=icub)


def test_both_kinds_are_there_when_both_were_recorded(tmp_path):
    file = McapRecording(
        tmp_path / "t.mcap", parts=["a"], widths={"raw": [3], "pressure": [2]}, rate=50
    )
    for row in range(4):
        file.add("raw", row / 50, np.full(3, 240 - row, np.uint8))
        file.add("pressure", row / 50, np.full(2, row, np.uint8))
    file.close()
    default = open_recording(tmp_path / "t.mcap", speed=np.inf)
    assert (default.info.kind, default.info.channels) == ("pressure", 2)
    np.testing.assert_array_equal(all_values(default)[:, 0], range(4))
    raw = open_recording(tmp_path / "t.mcap", kind="raw", speed=np.inf)
    assert (raw.info.kind, raw.info.channels) == ("raw", 3)
    np.testing.assert_array_equal(all_values(raw)[:, 0], 240 - np.arange(4))


def test_dumper_folder_is_a_source(tmp_path, icub):
    folder = tmp_path / "left_hand"
    folder.mkdir()
    line = " ".join(["240"] * 192)
    (folder / "data.log").write_text("".join(f"{i} {i / 50} {line}\n" for i in range(20)))
    source = skinmap.live.open_source(tmp_path, robot=icub, speed=np.inf)
    assert (source.info.kind, source.info.widths) == ("raw", (192,))
    assert all_values(source).shape == (20, 192)


def test_a_recorded_stream_says_of_itself_what_its_source_does(files):
    track, source = open_track(files / "t.mcap"), open_recording(files / "t.mcap")
    assert (source.info, track.info.robot) == (track.info, "iCub")
    assert track.values[:].shape[1] == track.info.channels
    assert set(track.info.fingerprints) == {"left_hand", "left_foot"}


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(MissingFileError, match="expected a recording"):
        open_recording(tmp_path / "gone.mcap")
    (tmp_path / "t.wav").write_bytes(b"RIFF")
    with pytest.raises(
        UnknownNameError, match=r"no reader of recordings for 't\.wav'; the readers are"
    ):
        open_recording(tmp_path / "t.wav")
    (tmp_path / "t.npz").write_bytes(b"PK")
    with pytest.raises(DataFormatError, match="not a Skinmap recording"):
        load_recordings(tmp_path / "t.npz")


@pytest.mark.parametrize("tick", [1.0, 0.1])
def test_coarse_time_stamps_are_neither_gaps_nor_a_rate_of_zero(tick):
    from skinmap.io.recordings.recorded_stream import measured_rate

    times = np.floor(np.arange(1000) / 50 / tick + 1e-9) * tick  # as loggers in whole seconds write
    assert measured_rate(times) == pytest.approx(50, rel=0.06)
    assert measured_rate(np.zeros(5)) == 0.0
