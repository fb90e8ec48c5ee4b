"""What LabRecorder writes, made here by the rules of the format."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinmap.errors import (
    DataFormatError,
    MissingFileError,
    SkinError,
    SkinWarning,
    UnknownNameError,
)
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.io.recordings.xdf import BOUNDARY, read_xdf

RATE = 50.0
START = 1000.0
OURS = (
    "<desc><skinmap><version>1</version><kind>pressure</kind><robot>iCub</robot><parts>"
    "<part><name>a</name><channels>3</channels><fingerprint>ab</fingerprint></part>"
    "<part><name>b</name><channels>5</channels><fingerprint></fingerprint></part>"
    "</parts></skinmap></desc>"
)


def chunk(tag: int, content: bytes) -> bytes:
    return b"\x04" + struct.pack("<I", len(content) + 2) + struct.pack("<H", tag) + content


def header(stream: int, name: str, channels: int, kind: str = "float32", desc: str = "") -> bytes:
    xml = (
        f'<?xml version="1.0"?><info><name>{name}</name><type>Tactile</type>'
        f"<channel_count>{channels}</channel_count><nominal_srate>{RATE}</nominal_srate>"
        f"<channel_format>{kind}</channel_format><created_at>1.0</created_at>{desc}</info>"
    )
    return chunk(2, struct.pack("<I", stream) + xml.encode())


def samples(
    stream: int, values: np.ndarray, first: int = 0, times: np.ndarray | None = None
) -> bytes:
    content = struct.pack("<I", stream) + b"\x04" + struct.pack("<I", len(values))
    for row, sample in enumerate(values):
        time = (first + row) / RATE if times is None else times[row]
        stamp = struct.pack("<d", START + time)
        content += b"\x08" + stamp + sample.astype("<f4").tobytes()
    return chunk(3, content)


def offset(stream: int, time: float, value: float) -> bytes:
    return chunk(4, struct.pack("<Idd", stream, time, value))


def recording(values: np.ndarray, name: str = "left_hand", desc: str = "") -> bytes:
    body = b"XDF:" + chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')
    body += header(1, name, values.shape[1], desc=desc) + header(2, "marks", 1, "string")
    for first in range(0, len(values), 20):
        body += samples(1, values[first : first + 20], first) + chunk(5, BOUNDARY)
        body += chunk(3, struct.pack("<I", 2) + b"\x01\x01\x08" + struct.pack("<d", START)
                      + b"\x01\x02hi")  # fmt: skip
        body += offset(1, START + first / RATE, -0.5)
    return body + chunk(6, struct.pack("<I", 1) + b"<info></info>")


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (100, 8)).astype(np.uint8)


def read(tmp_path, data: bytes, **how) -> RecordedStream:
    (tmp_path / "t.xdf").write_bytes(data)
    return read_xdf(tmp_path / "t.xdf", **how)


def test_stream_of_numbers_is_read_at_its_corrected_times(tmp_path, values):
    track = read(tmp_path, recording(values))
    np.testing.assert_array_equal(track.values[:], values)
    assert (track.parts, track.info.widths, track.kind) == (("left_hand",), (8,), "raw")
    assert track.values[:].dtype == np.uint8
    # The clocks differ by half a second all the time; jitter removal leaves a straight line.
    np.testing.assert_allclose(track.times, START - 0.5 + np.arange(100) / RATE, rtol=0, atol=1e-6)
    assert not track.loss.recovered


def test_stream_that_describes_its_skin_is_read_as_it_says(tmp_path, values):
    track = read(tmp_path, recording(values, "demo", OURS))
    assert (track.parts, track.info.widths, track.kind) == (("a", "b"), (3, 5), "pressure")
    assert (track.info.robot, track.info.fingerprints) == ("iCub", {"a": "ab"})
    np.testing.assert_array_equal(track.values[:][:, track.columns("b")], values[:, 3:])


def test_description_of_another_width_is_not_believed(tmp_path, values):
    wrong = OURS.replace("<channels>5<", "<channels>6<")
    assert read(tmp_path, recording(values, "demo", wrong)).parts == ("demo",)


def test_streams_are_parts_of_the_robot(tmp_path, values, icub):
    track = read(tmp_path, recording(values, "skin_left_hand"), robot=icub)
    assert (track.parts, track.info.robot) == (("left_hand",), "iCub")
    with pytest.raises(UnknownNameError, match="no part of iCub among the streams 'tail'"):
        read(tmp_path, recording(values, "tail"), robot=icub)


def streams(*several: tuple[np.ndarray, np.ndarray, str]) -> bytes:
    """A file of streams, each with times, values and a description."""
    body = b"XDF:" + chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')
    for number, (times, values, desc) in enumerate(several, 1):
        body += header(number, f"s{number}", values.shape[1], desc=desc)
        body += samples(number, values, times=times)
    return body


def test_all_streams_that_describe_their_skin_are_joined(tmp_path, values):
    other = OURS.replace(">a<", ">c<").replace(">b<", ">d<")
    times = np.arange(100) / RATE
    track = read(tmp_path, streams((times, values, OURS), (times, values + 1.0, other)))
    assert (track.parts, track.kind, track.info.robot) == (("a", "b", "c", "d"), "pressure", "iCub")
    np.testing.assert_array_equal(track.values[:], np.hstack([values, values + 1.0]))
    raw = other.replace("pressure", "raw")
    with pytest.warns(SkinWarning, match=r"left out: s2 \(raw, c, d\)"):
        assert read(tmp_path, streams((times, values, OURS), (times, values, raw))).parts == (
            "a", "b"
        )  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
def test_a_loss_of_samples_is_one_gap_and_bursts_are_none(tmp_path, seed):
    rng = np.random.default_rng(seed)
    times = np.arange(600) / RATE + rng.normal(0, 0.002, 600)
    counted = np.arange(600)[:, None] % 251
    kept = (np.arange(600) < 250) | (np.arange(600) >= 400)
    track = read(tmp_path, streams((times[kept], counted[kept], "")))
    assert track.gaps == 1
    assert np.diff(track.times).max() == pytest.approx(151 / RATE, abs=0.005)
    assert track.seconds == pytest.approx(12.0, abs=0.01)
    # A radio sends ten samples at once: the line through them all is as it was.
    bursts = np.arange(600) // 10 * 10 / RATE + rng.normal(0, 0.002, 600)
    late = np.arange(600) / RATE  # a computer that paused twice for a second
    for first in (100, 350):
        late[first : first + 60] = np.maximum(late[first : first + 60], late[first + 50])
    for times in (bursts, late):
        track = read(tmp_path, streams((times, counted, "")))
        assert track.gaps == 0
        np.testing.assert_allclose(np.diff(track.times), np.diff(track.times).mean(), rtol=1e-6)


def test_a_rate_that_was_only_meant_is_not_believed(tmp_path, values):
    track = read(tmp_path, streams((np.arange(100) / 40.0, values, "")))
    assert track.info.rate == pytest.approx(40.0)  # the header has 50


def test_a_clock_that_begins_anew_is_refused(tmp_path, values):
    times = np.r_[np.arange(60), np.arange(40)] / RATE
    with pytest.raises(DataFormatError, match="the clock of 's1' began anew: sample 60"):
        read(tmp_path, streams((times, values, "")))


def test_a_stream_that_ends_early_is_not_held_to_the_end(tmp_path, values):
    times = np.arange(300) / RATE
    long = np.arange(300)[:, None] % 251
    with pytest.warns(SkinWarning, match="'s2' sent nothing at 197 of 300 samples"):
        track = read(tmp_path, streams((times, long, ""), (times[:100] - 0.001, values, "")))
    np.testing.assert_array_equal(track.values[:100][:, 1:], values)
    assert track.seconds == pytest.approx(2.06)


def test_cut_file_gives_all_whole_chunks(tmp_path, values):
    data = recording(values)
    cut = data.rindex(samples(1, values[80:], 80)) + 100
    track = read(tmp_path, data[:cut])
    np.testing.assert_array_equal(track.values[:], values[:80])
    assert track.loss.recovered


def test_damaged_length_leads_to_the_next_boundary(tmp_path, values):
    data = bytearray(recording(values))
    place = data.index(samples(1, values[20:40], 20))
    data[place] = 3  # no number has three bytes
    track = read(tmp_path, bytes(data))
    np.testing.assert_array_equal(track.values[:], np.delete(values, np.r_[20:40], axis=0))
    assert track.loss.recovered


def test_sizes_are_checked_before_anything_is_made_of_them(tmp_path, values):
    many = struct.pack("<I", 1) + b"\x08" + struct.pack("<Q", 2**40) + b"\x08" * 100
    wide = header(3, "wide", 2**31)
    tracemalloc.start()
    track = read(tmp_path, recording(values) + chunk(3, many) + wide)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(track.values[:], values)
    assert len(track.loss.damage) == 2
    assert peak < 32 * 2**20


def test_files_that_are_none_are_refused(tmp_path, values):
    with pytest.raises(MissingFileError, match="expected an XDF recording"):
        read_xdf(tmp_path / "gone.xdf")
    for data, message in (
        (b"", "an empty file"),
        (b"text" * 10, "not an XDF file"),
        (b"XDF:", "no stream of numbers in it"),
        (recording(values)[:300], "no stream of numbers in it"),
    ):
        with pytest.raises(DataFormatError, match=message):
            read(tmp_path, data)


def test_entities_are_not_unfolded(tmp_path, values):
    bomb = b'<!DOCTYPE a [<!ENTITY b "bbbb">]><info><name>&b;</name></info>'
    track = read(tmp_path, recording(values) + chunk(2, struct.pack("<I", 9) + bomb))
    assert "XML with declarations" in track.loss.damage[0]


@pytest.mark.fuzz
@settings(
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    flips=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=5
    ),
    end=st.floats(0, 1),
)
def test_damaged_files_are_read_or_refused(tmp_path, values, flips, end):
    data = bytearray(recording(values))
    for where, bit in flips:
        data[int(where * len(data))] ^= 1 << bit
    try:
        track = read(tmp_path, bytes(data[: int(end * len(data))]))
    except SkinError:
        return
    assert len(track.values[:]) == len(track.times)
    assert np.isfinite(track.times).all()
