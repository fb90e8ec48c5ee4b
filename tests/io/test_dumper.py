"""Logs of the data dumper."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinmap.errors import DataFormatError, MissingFileError, SkinError, UnknownNameError
from skinmap.io.recordings.dumper import read_dump
from skinmap.io.recordings.recorded_stream import RecordedStream

RATE = 50.0


def log(values, *, start=100.0, rate=RATE, first=7) -> bytes:
    lines = [
        f"{first + row} {start + row / rate:.6f} " + " ".join(f"{value:g}" for value in sample)
        for row, sample in enumerate(values)
    ]
    return ("\n".join(lines) + "\n").encode()


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (40, 12)).astype(np.uint8)


def store(folder, data: bytes):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "data.log").write_bytes(data)
    return folder / "data.log"


def test_log_is_read_as_it_was_sent(tmp_path, values):
    path = store(tmp_path / "torso", log(values))
    for where in (path, path.parent):
        track = read_dump(where)
        np.testing.assert_array_equal(track.values[:], values)
        np.testing.assert_allclose(track.times, 100 + np.arange(40) / RATE, rtol=0, atol=1e-6)
        assert track.values[:1].dtype == np.uint8
        assert (track.kind, track.parts, track.info.widths) == ("raw", ("torso",), (12,))
        assert track.info.rate == pytest.approx(RATE, rel=1e-4)  # stamps have microseconds
        assert not track.loss.recovered


def test_values_with_fractions_stay(tmp_path, values):
    track = read_dump(store(tmp_path / "a", log(values / 2)))
    np.testing.assert_array_equal(track.values[:], (values / 2).astype(np.float32))


def test_folders_are_parts_of_the_robot(tmp_path, icub, values):
    store(tmp_path / "skin_left_arm_comp", log(values))
    store(tmp_path / "left_forearm", log(values))
    track = read_dump(tmp_path, robot=icub)
    assert set(track.parts) == {"left_arm", "left_forearm"}
    store(tmp_path / "tail", log(values))
    with pytest.raises(
        UnknownNameError, match="no part of iCub for the folder 'tail'; the parts are"
    ):
        read_dump(tmp_path, robot=icub)


def test_parts_stand_together_with_what_each_sent_last(tmp_path):
    # One at 50 Hz from 100 s, one at 25 Hz from 100.04 s: each of its samples stands twice.
    fast = np.arange(20, dtype=np.uint8)[:, None]
    slow = np.arange(100, 110, dtype=np.uint8)[:, None]
    store(tmp_path / "fast", log(fast))
    store(tmp_path / "slow", log(slow, start=100.04, rate=25.0))
    track = read_dump(tmp_path)
    assert track.parts == ("fast", "slow")
    np.testing.assert_allclose(track.times, 100.04 + np.arange(18) / RATE, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(track.values[:][:, 0], np.arange(2, 20))
    np.testing.assert_array_equal(track.values[:][:, 1], np.repeat(np.arange(100, 109), 2))


def test_parts_recorded_at_other_times_are_refused(tmp_path, values):
    store(tmp_path / "a", log(values))
    store(tmp_path / "b", log(values, start=900.0))
    with pytest.raises(DataFormatError, match="its parts were recorded at other times"):
        read_dump(tmp_path)


def test_late_lines_are_put_in_order(tmp_path, values):
    lines = log(values).splitlines(keepends=True)
    lines[3], lines[4] = lines[4], lines[3]
    track = read_dump(store(tmp_path / "a", b"".join(lines)))
    np.testing.assert_array_equal(track.values[:], values)


def test_lines_of_one_stamp_are_all_read(tmp_path):
    values = np.arange(60, dtype=np.uint8)[:, None]
    lines = [f"{k} {100 + k // 5 / 10:.1f} {k}\n" for k in range(60)]
    track = read_dump(store(tmp_path / "a", "".join(lines).encode()).parent)
    np.testing.assert_array_equal(track.values[:], values)


@pytest.mark.parametrize("cut", [1, 4, 20])
def test_cut_log_gives_all_whole_lines(tmp_path, values, cut):
    track = read_dump(store(tmp_path / "a", log(values)[:-cut]))
    np.testing.assert_array_equal(track.values[:], values[:39])
    assert track.loss.recovered
    assert track.loss.seconds == pytest.approx(1 / RATE, rel=1e-4)
    assert track.loss.damage == ("cut off in line 40",)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"3 1.0 1 2\n", r"data\.log:2: 2 values, the lines before it have 12"),
        (b"3 1.0 " + b"1 " * 11 + b"256\n", "2: a value of 256; a taxel sends 0 to 255"),
        (b"3 1.0 " + b"1 " * 11 + b"-1\n", "2: a value of -1"),
        (b"3 1.0 " + b"1 " * 11 + b"nan\n", "2: expected finite numbers"),
        (b"3 inf " + b"1 " * 12 + b"\n", "2: expected finite numbers"),
        (b"3 1.0 " + b"1 " * 11 + b"x\n", "2: expected numbers only: sequence number, time"),
        (b"3 1.0 " + b"1 " * 11 + b"1_0\n", "2: expected numbers only"),
        (b"\xff\xfe\n", "2: expected numbers only"),
    ],
)
def test_line_that_is_none_is_named(tmp_path, values, line, message):
    lines = log(values).splitlines(keepends=True)
    path = store(tmp_path / "a", b"".join([lines[0], line, *lines[1:]]))
    with pytest.raises(DataFormatError, match=message):
        read_dump(path)


def test_logs_that_are_none_are_refused(tmp_path, values):
    with pytest.raises(MissingFileError, match="expected a log of the data dumper"):
        read_dump(tmp_path / "gone.log")
    with pytest.raises(MissingFileError, match=r"expected data\.log here or in a folder a part"):
        read_dump(tmp_path)
    for content in (b"", b"\n\n"):
        with pytest.raises(DataFormatError, match="no sample in it"):
            read_dump(store(tmp_path / "a", content))
    with pytest.raises(DataFormatError, match="a sequence number, a time stamp and values, got 2"):
        read_dump(store(tmp_path / "a", b"1 2\n1 2\n"))


@pytest.mark.fuzz
@settings(
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    places=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=4),
    end=st.floats(0, 1),
)
def test_damaged_logs_are_read_or_refused(tmp_path, values, places, end):
    data = bytearray(log(values))
    for where, byte in places:
        data[int(where * len(data))] = byte
    try:
        track = read_dump(store(tmp_path / "a", bytes(data[: int(end * len(data))])))
    except SkinError:
        return
    assert isinstance(track, RecordedStream)
    assert track.values[:].min() >= 0
    assert track.values[:].max() <= 255
