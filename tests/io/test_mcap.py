"""MCAP recordings: what is written is what is read, by us and by the standard reader."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    OutputError,
    SkinMismatchError,
    UnknownNameError,
)
from skinmap.io.mcap.reading import Index, McapSamples, read_track, write_marked, write_repaired
from skinmap.io.mcap.writing import McapRecording, McapWriter
from skinmap.io.recordings.recorded_stream import MarkedTouch, nanoseconds_of
from skinmap.io.recordings.touch_files import load_recordings, save_recordings
from skinmap.io.ros2.messages import decode, definition, encode, read_text
from skinmap.io.taxels.taxel_table import parse_csv
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.simulator import simulate, simulate_pairs

N = 30


def write(path, values, *, rate=50.0, kind="raw", start=0.0, **how) -> None:
    file = McapRecording(
        path, parts=["a", "b"], widths={kind: [10, values.shape[1] - 10]}, rate=rate, **how
    )
    for row, sample in enumerate(values):
        file.add(kind, start + row / rate, sample)
    file.close()


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (200, N)).astype(np.uint8)


@pytest.fixture(scope="module")
def two_parts(icub) -> list[Recording]:
    rng = np.random.default_rng(1)
    return [
        simulate(icub.skin("left_hand"), rng=rng, per_gesture=2, variety=0.0),
        simulate_pairs(icub.skin("left_foot"), rng=rng, count=3, variety=0.0),
    ]


def assert_same(one: Recording, other: Recording) -> None:
    assert (one.part, one.labels) == (other.part, other.labels)
    for name in ("times", "pressures", "events", "subjects"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("number", ["UInt8", "Float32"])
def test_cdr_message_follows_the_rules_of_alignment(number):
    values = np.array([1, 2, 255], np.uint8 if number == "UInt8" else np.float32)
    message = encode(values, number)
    # By hand: encapsulation; one dimension "channel" of size and stride 3; offset 0; 3 values.
    head = "00010000 01000000 08000000 6368616e6e656c00 03000000 03000000 00000000 03000000"
    assert message == bytes.fromhex(head) + values.tobytes()
    np.testing.assert_array_equal(decode(message, number), values)
    with pytest.raises(ValueError, match="3 values expected, got"):
        decode(message[:-1], number)
    with pytest.raises(ValueError, match="a message of 5 bytes"):
        decode(message[:5], number)


def test_samples_come_back_bit_by_bit(tmp_path, values):
    write(tmp_path / "t.mcap", values)
    track = read_track(tmp_path / "t.mcap")
    np.testing.assert_array_equal(track.values[:], values)
    np.testing.assert_array_equal(track.values[150:170], values[150:170])
    np.testing.assert_array_equal(track.times, np.arange(200) / 50)
    assert track.values[:1].dtype == np.uint8
    assert (track.kind, track.parts) == ("raw", ("a", "b"))
    assert (track.info.widths, track.info.rate) == ((10, 20), 50)
    assert track.loss.seconds == track.gaps == 0
    assert not track.loss.recovered


def test_whole_counts_take_a_byte_and_other_numbers_four(tmp_path):
    values = np.tile(np.arange(N, dtype=np.float32), (4, 1))
    values[2] += 0.5
    values[3, 5] = np.nan
    write(tmp_path / "t.mcap", values)
    track = read_track(tmp_path / "t.mcap")
    np.testing.assert_array_equal(track.values[:], values)
    with (tmp_path / "t.mcap").open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics == ["/skin/raw", "/skin/raw", "/skin/raw_float", "/skin/raw_float"]


def test_standard_reader_reads_values_labels_and_skin(tmp_path, icub, two_parts):
    save_recordings(two_parts, tmp_path / "t.mcap", robot=icub)
    data = (tmp_path / "t.mcap").read_bytes()
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    rows = list(reader.iter_messages("/skin/pressure"))
    schema, channel, message = rows[10]
    assert (schema.name, schema.encoding) == ("std_msgs/msg/UInt8MultiArray", "ros2msg")
    assert schema.data == definition("std_msgs/UInt8MultiArray")
    assert channel.message_encoding == "cdr"
    np.testing.assert_array_equal(
        decode(message.data, "UInt8"), np.concatenate([one.pressures[10] for one in two_parts])
    )
    assert message.log_time == message.publish_time == 200_000_000
    touches = [json.loads(read_text(m.data)) for _, _, m in reader.iter_messages("/skin/touches")]
    assert len(touches) == sum(len(one.labels) for one in two_parts)
    assert set(touches[0]) == {"part", "event", "label", "began_s", "ended_s", "subject"}
    head, bag = [one.metadata for one in reader.iter_metadata()]
    assert "message_count" in bag["serialized_metadata"]
    assert head["robot"] == "iCub"
    tables = {one.name: one.data.decode() for one in reader.iter_attachments()}
    skin = icub.skin("left_foot")
    np.testing.assert_array_equal(
        parse_csv(tables["skin/left_foot.csv"], tmp_path).positions, skin.positions
    )
    summary = reader.get_summary()
    assert summary.statistics.message_count == len(rows) + len(touches)


def test_messages_hold_a_chunk_of_64_kb_at_most_and_a_tenth_of_a_second(tmp_path):
    values = np.random.default_rng(1).integers(0, 255, (60, 4326)).astype(np.uint8)
    write(tmp_path / "t.mcap", values)
    with (tmp_path / "t.mcap").open("rb") as file:
        indexes = make_reader(file).get_summary().chunk_indexes
    spans = [(one.message_end_time - one.message_start_time) / 1e9 for one in indexes]
    assert max(spans) <= 0.1
    assert max(one.uncompressed_size for one in indexes) < 64 * 1024 + 4326 + 100
    assert len(indexes) == 10  # of six samples each


def test_recordings_of_touches_come_back_whole(tmp_path, icub, two_parts):
    save_recordings(two_parts, tmp_path / "t.mcap", robot=icub)
    back = load_recordings(tmp_path / "t.mcap")
    for one, other in zip(two_parts, back, strict=True):
        assert_same(one, other)
    np.testing.assert_array_equal(back[1].owners, two_parts[1].owners)


def test_recordings_of_one_touch_in_two_runs_come_back_whole(tmp_path):
    events = np.array([0, 0, -1, 0, 1, 1, -1])
    one = Recording("p", np.arange(7) / 10, np.ones((7, 3), np.uint8), events, ("poke", "rub"))
    save_recordings([one], tmp_path / "t.mcap")
    assert_same(one, load_recordings(tmp_path / "t.mcap")[0])


def test_angles_stand_at_the_samples_after_them(tmp_path):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"raw": [2]}, rate=10)
    for row in range(4):
        file.add("raw", row / 10, np.zeros(2, np.uint8))
        if row == 1:
            file.add_angles(0.1, {"elbow": 0.5})
        if row == 3:
            file.add_angles(0.3, {"elbow": 0.7, "wrist": -1.0})
    file.close()
    track = read_track(tmp_path / "t.mcap")
    assert track.joints == ("elbow", "wrist")
    nan = np.nan
    np.testing.assert_array_equal(track.angles, [[nan, nan], [0.5, nan], [0.5, nan], [0.7, -1.0]])


def test_gaps_count_missing_time(tmp_path):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"raw": [2]}, rate=10)
    for time in (0.0, 0.1, 0.2, 0.5, 0.6, 0.9):
        file.add("raw", time, np.zeros(2, np.uint8))
    file.close()
    track = read_track(tmp_path / "t.mcap")
    assert (track.gaps, track.loss.recovered) == (2, False)


def test_late_samples_are_read_in_the_order_of_time(tmp_path):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"raw": [1]}, rate=10)
    for time in (0.0, 0.2, 0.1, 0.3):
        file.add("raw", time, np.array([round(time * 10)], np.uint8))
    file.close()
    track = read_track(tmp_path / "t.mcap")
    np.testing.assert_array_equal(track.values[:][:, 0], [0, 1, 2, 3])


@pytest.mark.parametrize("time", [-1.0, float("nan"), float("inf"), 2.0**40])
def test_times_that_are_none_are_refused(tmp_path, time):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"raw": [2]})
    with pytest.raises(InvalidArrayError, match="time must lie in"):
        file.add("raw", time, np.zeros(2, np.uint8))
    file.close()


def test_nanoseconds_give_the_same_seconds_back():
    times = np.random.default_rng(0).uniform(0, 4e5, 1000).round(9)
    stamps = np.array([nanoseconds_of(time) for time in times], np.uint64)
    # Half a nanosecond of rounding is all that MCAP's clock costs.
    np.testing.assert_allclose(stamps.astype(np.float64) / 1e9, times, rtol=0, atol=0.6e-9)


def test_wrong_number_of_channels_is_refused(tmp_path, values):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"raw": [3]})
    with pytest.raises(SkinMismatchError, match=r"raw values of shape \(4,\), the skin has 3"):
        file.add("raw", 0.0, np.zeros(4, np.uint8))
    file.close()


def test_sample_of_other_width_is_named(tmp_path):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"raw": [3]})
    file.add("raw", 0.0, np.zeros(3, np.uint8))
    file._widths = {"raw": (5,)}
    file.add("raw", 0.1, np.zeros(5, np.uint8))
    file.close()
    with pytest.raises(DataFormatError, match="sample 1 has 5 values, its skin 3 channels"):
        read_track(tmp_path / "t.mcap")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.array([[1.0, 256.0]], np.float32), "sample 0 holds 256.0 at channel 1; pressures are"),
        (np.array([[1.0, np.nan]], np.float32), "sample 0 holds nan at channel 1"),
        (np.array([[-1.0, 1.0]], np.float32), "sample 0 holds -1.0 at channel 0"),
    ],
)
def test_pressures_that_are_none_are_named(tmp_path, values, message):
    file = McapRecording(tmp_path / "t.mcap", parts=["a"], widths={"pressure": [2]})
    file.add("pressure", 0.0, values[0])
    file.close()
    with pytest.raises(DataFormatError, match=message):
        load_recordings(tmp_path / "t.mcap")


def test_raw_values_are_no_pressures(tmp_path, values):
    write(tmp_path / "t.mcap", values)
    with pytest.raises(DataFormatError, match="holds raw values only; record pressures"):
        load_recordings(tmp_path / "t.mcap")
    with pytest.raises(DataFormatError, match="holds no pressure values, only raw"):
        read_track(tmp_path / "t.mcap", kind="pressure")


def test_files_that_are_none_are_refused(tmp_path):
    with pytest.raises(MissingFileError, match="expected an MCAP recording"):
        read_track(tmp_path / "gone.mcap")
    for content, message in ((b"", "an empty file"), (b"text" * 9, "not an MCAP file")):
        (tmp_path / "t.mcap").write_bytes(content)
        with pytest.raises(DataFormatError, match=message):
            read_track(tmp_path / "t.mcap")
    with pytest.raises(
        UnknownNameError, match=r"files ending in '\.wav'; the recording formats are: \.npz, \.mcap"
    ):
        (tmp_path / "t.wav").write_bytes(b"")
        load_recordings(tmp_path / "t.wav")
    with pytest.raises(OutputError, match="cannot write"):
        McapRecording(tmp_path / "gone" / "t.mcap", parts=["a"], widths={"raw": [3]})


def test_mcap_of_others_is_refused(tmp_path):
    with (tmp_path / "t.mcap").open("wb", buffering=0) as file:
        writer = McapWriter(file)
        channel = writer.add_channel("/camera", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    with pytest.raises(DataFormatError, match="not a Skinmap recording: it names no skin"):
        read_track(tmp_path / "t.mcap")


def test_parts_sampled_at_other_times_are_refused_in_mcap(tmp_path):
    one, other = (
        Recording(part, np.arange(5) / rate, np.zeros((5, 2), np.uint8), np.full(5, -1), ())
        for part, rate in (("a", 50), ("b", 40))
    )
    with pytest.raises(SkinMismatchError, match="'b' and 'a' were sampled at other times"):
        save_recordings([one, other], tmp_path / "t.mcap")


def touched_file(path: Path, **options: Any) -> McapRecording:
    """Ten seconds of two parts: the second is pressed from 3.1 to 5.5 s, one taxel of it hangs."""
    file = McapRecording(path, parts=["a", "b"], widths={"pressure": [3, 5]}, rate=50.0, **options)
    for row in range(500):
        values = np.zeros(8, np.uint8)
        values[7] = 180
        if 155 <= row < 275:
            values[3:5] = 90
        file.add("pressure", row / 50.0, values)
    file.mark("b", 0, "poke", began=3.1)
    file.mark("b", 0, "poke", began=3.1, ended=5.48)
    return file


def test_overview_has_what_was_touched_each_second_and_no_taxel_that_hangs(tmp_path):
    touched_file(tmp_path / "t.mcap").close()
    track = read_track(tmp_path / "t.mcap")
    made = track.overview
    assert made is not None
    assert made.seconds.tolist() == [3, 4, 5]
    assert made.parts.tolist() == [1, 1, 1]
    assert made.largest.tolist() == [90.0, 90.0, 90.0]
    assert made.taxels.tolist() == [2, 2, 2]
    assert made.marks.tolist() == [1, 0, 0]
    assert (made.touched(0), made.touched(1)) == ([], [(3.0, 6.0)])


def test_file_that_proves_to_be_whole_is_read_by_its_index_with_the_same_samples(tmp_path):
    path = tmp_path / "t.mcap"
    touched_file(path).close()
    trusted, scanned = Index(path, trusted=True), Index(path)
    assert trusted.found.finished
    assert not trusted.found.damage
    assert trusted.channels.keys() == scanned.channels.keys()
    for number, messages in scanned.channels.items():
        assert trusted.channels[number].times == messages.times
        assert trusted.channels[number].offsets == messages.offsets
    assert max(map(max, (one.lengths for one in trusted.channels.values()))) == 0  # by its index
    np.testing.assert_array_equal(
        McapSamples(trusted, "pressure", 8)[0:500], McapSamples(scanned, "pressure", 8)[0:500]
    )


@pytest.mark.parametrize("place", [0.3, 0.6, 0.95])
def test_file_with_one_wrong_byte_is_gone_through_as_ever(tmp_path, place):
    path = tmp_path / "t.mcap"
    touched_file(path).close()
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= 0x10
    path.write_bytes(data)
    lengths = [n for one in Index(path, trusted=True).channels.values() for n in one.lengths]
    assert min(lengths) > 0  # every record was looked at


def test_cut_file_opens_without_overview_and_mending_gives_it_one(tmp_path):
    path = tmp_path / "t.mcap"
    touched_file(path, chunk_seconds=0.1).close()
    whole = read_track(path).overview
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"overview.csv") - 40])
    track = read_track(path)
    assert track.overview is None
    assert track.loss.recovered
    assert len(track.times) == 500
    write_repaired(path, tmp_path / "mended.mcap")
    mended = read_track(tmp_path / "mended.mcap").overview
    assert mended is not None
    assert whole is not None
    assert mended.seconds.tolist() == whole.seconds.tolist()
    assert mended.marks.tolist() == whole.marks.tolist()


def test_labelled_copy_has_the_marks_of_its_labels(tmp_path):
    path, other = tmp_path / "t.mcap", tmp_path / "o.mcap"
    touched_file(path).close()
    touch = MarkedTouch("b", 0, "slap", 200, 220)
    write_marked(path, other, [touch, replace(touch, event=1)])
    made = read_track(other).overview
    assert made is not None
    assert (made.seconds.tolist(), made.marks.tolist()) == ([3, 4, 5], [0, 2, 0])
