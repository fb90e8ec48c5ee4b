"""Cut, damaged and hostile MCAP files: what can be had is had, the rest is said to be lost."""

from __future__ import annotations

import io
import re
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from skinmap.errors import SkinError
from skinmap.io.mcap import mcap_scan
from skinmap.io.mcap.mcap_scan import MAX_RECORD
from skinmap.io.mcap.reading import read_track
from skinmap.io.mcap.writing import MAGIC, McapRecording, McapWriter
from skinmap.io.ros2.messages import array_type, definition, encode, full_name

N, RATE, COUNT = 40, 50.0, 100
STEP = 1 / RATE

fuzz = settings(
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (COUNT, N)).astype(np.uint8)


@pytest.fixture(scope="module")
def whole(values, tmp_path_factory) -> bytes:
    """A recording of 2 s in 17 chunks, with touches and angles."""
    path = tmp_path_factory.mktemp("whole") / "t.mcap"
    file = McapRecording(path, parts=["a"], widths={"raw": [N]}, rate=RATE)
    for row, sample in enumerate(values):
        file.add("raw", row * STEP, sample)
        if row % 20 == 0:
            file.add_angles(row * STEP, {"elbow": row / 100})
            file.mark("a", row // 20, "poke", began=row * STEP)
        if row % 20 == 10:
            file.mark("a", row // 20, "poke", began=(row - 10) * STEP, ended=row * STEP)
    file.close()
    return path.read_bytes()


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Offset and length of each chunk record."""
    found, offset = [], len(MAGIC)
    while offset < len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, offset)
        if opcode == 6:
            found.append((offset, 9 + length))
        offset += 9 + length
    return found


def read(tmp_path, data: bytes):
    (tmp_path / "t.mcap").write_bytes(data)
    return read_track(tmp_path / "t.mcap")


def test_the_whole_file_is_whole(tmp_path, whole, values):
    track = read(tmp_path, whole)
    np.testing.assert_array_equal(track.values[:], values)
    assert [(one.first, one.last) for one in track.touches] == [
        (first, first + 10) for first in range(0, 100, 20)
    ]
    assert len(chunks(whole)) == 17


def test_file_cut_between_chunks_gives_all_samples_before(tmp_path, whole, values):
    offset, _ = chunks(whole)[10]
    track = read(tmp_path, whole[:offset])
    np.testing.assert_array_equal(track.values[:], values[:60])
    assert track.loss.recovered
    assert track.loss.seconds == 0.1  # nothing says what followed: as much as a chunk may hold


def test_file_cut_in_a_chunk_says_how_much_the_chunk_held(tmp_path, whole, values):
    offset, length = chunks(whole)[10]
    track = read(tmp_path, whole[: offset + length // 2])
    np.testing.assert_array_equal(track.values[:], values[:60])
    # The chunk's head survived: it held samples 60 to 65.
    assert track.loss.seconds == pytest.approx(6 * STEP, abs=1e-9)
    assert "cut off in the chunk" in track.loss.damage[0]


def test_touch_without_an_end_lasts_to_the_last_sample(tmp_path, whole):
    offset, _ = chunks(whole)[4]
    track = read(tmp_path, whole[:offset])
    assert [(one.first, one.last) for one in track.touches] == [(0, 10), (20, 23)]


def test_every_cut_of_the_file_opens_or_is_refused(tmp_path, whole, values):
    before = 0
    for end in [*range(0, len(whole), 61), len(whole) - 1]:
        try:
            track = read(tmp_path, whole[:end])
        except SkinError:
            assert before == 0  # once the head is there, every file opens
            continue
        assert len(track.times) >= before
        before = len(track.times)
        np.testing.assert_array_equal(track.values[:], values[:before])
        assert track.loss.recovered == (end < len(whole))
    assert before == COUNT


def test_damaged_chunk_is_left_out_and_its_time_is_counted(tmp_path, whole, values):
    offset, length = chunks(whole)[5]
    data = bytearray(whole)
    data[offset + length - 20] ^= 0x10
    track = read(tmp_path, bytes(data))
    np.testing.assert_array_equal(track.values[:], np.delete(values, np.r_[30:36], axis=0))
    assert track.loss.recovered
    assert track.loss.seconds == pytest.approx(6 * STEP, abs=1e-9)
    assert track.gaps == 1


def test_damaged_last_chunk_says_how_much_it_held(tmp_path, whole):
    offset, length = chunks(whole)[-1]
    data = bytearray(whole)
    data[offset + length - 20] ^= 0x10
    track = read(tmp_path, bytes(data))
    assert len(track.times) == 96
    assert track.loss.seconds == pytest.approx(4 * STEP, abs=1e-9)


@pytest.mark.parametrize("length", [0, 3, 2**40, 2**64 - 1])
def test_wrong_length_of_a_record_leads_to_the_next_chunk(tmp_path, whole, values, length):
    offset, _ = chunks(whole)[5]
    data = bytearray(whole)
    struct.pack_into("<Q", data, offset + 1, length)
    track = read(tmp_path, bytes(data))
    np.testing.assert_array_equal(track.values[:], np.delete(values, np.r_[30:36], axis=0))
    assert track.loss.seconds == pytest.approx(6 * STEP, abs=1e-9)


def test_head_survives_in_the_channels(tmp_path, whole, values):
    # The first record after the header is the metadata; make it one of an unknown kind.
    offset = len(MAGIC)
    offset += 9 + struct.unpack_from("<Q", whole, offset + 1)[0]
    assert whole[offset] == mcap_scan.METADATA
    data = bytearray(whole)
    data[offset] = 0x90
    np.testing.assert_array_equal(read(tmp_path, bytes(data)).values[:], values)


def test_flipped_bit_in_what_the_file_says_of_itself_is_outvoted(tmp_path, whole):
    # Five copies: the metadata, and two channels at the beginning and at the end.
    for place in (one.start() for one in re.finditer(rb"widths|fingerprints|\[\"a\"\]", whole)):
        data = bytearray(whole)
        data[place + 2] ^= 4
        track = read(tmp_path, bytes(data))
        assert (track.parts, track.info.widths, len(track.times)) == (("a",), (N,), COUNT)
        assert track.loss.recovered
        assert any("differ" in one for one in track.loss.damage)
        assert track.loss.seconds == 0


def standard_file(values: np.ndarray, compression: CompressionType, **how) -> bytes:
    """Our channels, written by the standard library in one large chunk."""
    out = io.BytesIO()
    writer = Writer(out, compression=compression, **how)
    writer.start()
    head = {
        "format": "skinmap-mcap-1", "parts": '["a"]', "samples": "{}", "fingerprints": "{}",
        "widths": f'{{"raw": [{values.shape[1]}]}}', "rate": "50.0",
    }  # fmt: skip
    writer.add_metadata("skinmap", head)
    schema = writer.register_schema(
        full_name(array_type("UInt8")), "ros2msg", definition(array_type("UInt8"))
    )
    channel = writer.register_channel("/skin/raw", "cdr", schema)
    for row, sample in enumerate(values):
        writer.add_message(channel, row * 20_000_000, encode(sample, "UInt8"), 0, row)
    writer.finish()
    return out.getvalue()


@pytest.mark.parametrize("how", [{"use_chunking": True}, {"use_chunking": False}])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_other_writers_and_compressions_are_read(tmp_path, values, compression, how):
    track = read(tmp_path, standard_file(values, compression, **how))
    np.testing.assert_array_equal(track.values[:], values)
    assert not track.loss.recovered


def test_half_a_chunk_gives_the_samples_that_can_be_unfolded(tmp_path):
    # zstd unfolds blocks of 128 kB: of a chunk of 1 MB that was cut, some are whole.
    values = np.random.default_rng(0).integers(0, 256, (250, 4000)).astype(np.uint8)
    data = standard_file(values, CompressionType.ZSTD, chunk_size=2 * 10**6)
    ((offset, length),) = chunks(data)
    track = read(tmp_path, data[: offset + length // 2])
    assert 90 <= len(track.times) <= 125
    np.testing.assert_array_equal(track.values[:], values[: len(track.times)])
    assert track.loss.seconds == pytest.approx((250 - len(track.times)) * STEP, abs=1e-9)


def bomb(size: int, stated: int) -> bytes:
    """A file whose chunk unfolds to `size` zeros and says `stated`."""
    file = io.BytesIO()
    writer = McapWriter(file)
    head = {"format": "skinmap-mcap-1", "parts": '["a"]', "widths": '{"raw": [2]}'}
    writer.add_metadata("skinmap", {**head, "samples": "{}", "fingerprints": "{}"})
    zeros = zstandard.ZstdCompressor().compress(bytes(size))
    body = struct.pack("<QQQI", 0, 0, stated, zlib.crc32(bytes(size)))
    body += struct.pack("<I4sQ", 4, b"zstd", len(zeros)) + zeros
    return file.getvalue() + struct.pack("<BQ", 6, len(body)) + body


@pytest.mark.parametrize("stated", [2**28, 2**62, 1000])
def test_chunks_that_unfold_to_too_much_are_refused_before_they_do(tmp_path, stated):
    data = bomb(2**28, stated)
    assert len(data) < 2**17
    (tmp_path / "t.mcap").write_bytes(data)
    tracemalloc.start()
    track = read_track(tmp_path / "t.mcap")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(track.times) == 0
    assert track.loss.recovered
    assert peak < 8 * 2**20  # not the 256 MB that it holds, nor what it says


def test_record_larger_than_any_of_ours_is_not_read(tmp_path, whole):
    head = struct.pack("<BQ", mcap_scan.METADATA, MAX_RECORD + 1)
    offset, _ = chunks(whole)[3]
    with (tmp_path / "t.mcap").open("wb") as file:
        file.write(whole[:offset] + head)
        file.truncate(offset + 9 + MAX_RECORD + 1)  # a hole: no disk is used
    tracemalloc.start()
    track = read_track(tmp_path / "t.mcap")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(track.times) == 18
    assert peak < 16 * 2**20


@pytest.mark.fuzz
@fuzz
@given(
    flips=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=6
    ),
    end=st.floats(0, 1),
)
def test_flipped_bits_never_give_a_wrong_value(tmp_path, whole, values, flips, end):
    data = bytearray(whole)
    for where, bit in flips:
        data[int(where * len(data))] ^= 1 << bit
    try:
        track = read(tmp_path, bytes(data[: max(1, int(end * len(data)))]))
        found = track.values[:]
    except SkinError:
        return
    if (track.kind, track.parts, track.info.widths) != ("raw", ("a",), (N,)):
        return  # what the file says of itself carries no checksum
    rows = np.rint(track.times * RATE).astype(int)
    # A message's values stand under the checksum of their chunk.
    np.testing.assert_array_equal(found, values[rows])
    assert np.isfinite(track.loss.seconds)
    assert track.loss.seconds >= 0
