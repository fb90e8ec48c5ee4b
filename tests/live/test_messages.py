from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinmap.errors import MessageError
from skinmap.live.network.network_messages import pack_info, read_json, unpack_info
from skinmap.live.network.zmq_stream import HEADER, Header, unpack_header, unpack_values
from skinmap.live.sources.source import StreamInfo

INFO = StreamInfo(
    "demo", ("arm", "hand"), (3, 2), 50.0, "raw", "icub", {"arm": "ab12"}, "simulation"
)
HEAD = Header(2, 5, 7, 3, 1.5, 99.25)


def test_header_has_the_documented_bytes():
    # docs/live.md: offsets 0, 4, 5, 6, 8, 12, 16, 24, 32 and 40 bytes in all.
    packed = HEAD.pack()
    assert len(packed) == 40
    assert packed[:4] == b"SKIN"
    assert (packed[4], packed[5]) == (1, 2)
    assert struct.unpack_from("<I", packed, 8) == (5,)
    assert struct.unpack_from("<I", packed, 12) == (7,)
    assert struct.unpack_from("<Q", packed, 16) == (3,)
    assert struct.unpack_from("<dd", packed, 24) == (1.5, 99.25)
    assert unpack_header(packed) == HEAD


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (0, "X", r"begins with b'XKIN', expected b'SKIN'"),
        (4, 9, "of version 9, this Skinmap reads 1"),
        (5, 3, "values of type 3; expected 1"),
        (24, float("nan"), "a sample of time nan"),
        (32, float("inf"), "sent at inf"),
    ],
)
def test_header_refuses(place, value, said):
    packed = bytearray(HEAD.pack())
    if isinstance(value, str):
        packed[place] = ord(value)
    elif isinstance(value, int):
        packed[place] = value
    else:
        struct.pack_into("<d", packed, place, value)
    with pytest.raises(MessageError, match=said):
        unpack_header(bytes(packed))


def test_header_of_another_length_is_refused():
    with pytest.raises(MessageError, match="a header of 39 bytes, expected 40"):
        unpack_header(HEAD.pack()[:-1])


def test_values_are_a_view_of_the_frame():
    values = np.arange(5, dtype="<f4")
    np.testing.assert_array_equal(unpack_values(HEAD, values.tobytes(), INFO), values)
    bytes_ = Header(1, 5, 7, 3, 1.5, 9.0)
    assert unpack_values(bytes_, bytes(range(5)), INFO).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("size", [0, 19, 21, 24, 4000])
def test_values_of_another_size_are_refused(size):
    with pytest.raises(MessageError, match=f"5 channels in {size} bytes, stream 'demo' declares 5"):
        unpack_values(HEAD, bytes(size), INFO)


def test_info_comes_back_as_it_went():
    back = unpack_info(pack_info(INFO, session=3, heartbeat=0.2))
    for name in ("name", "parts", "widths", "rate", "kind", "robot", "fingerprints"):
        assert getattr(back, name) == getattr(INFO, name), name
    assert INFO.clock == "simulation"
    assert back.clock == "publisher"  # what comes over a network is live, whatever made it


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"skinmap": 2}, "a description of version 2, this Skinmap reads 1"),
        ({"kind": "smell"}, "kind must be one of pressure, raw, got 'smell'"),
        ({"rate_hz": -1}, "rate_hz must be a number from 0.*, got -1"),
        ({"rate_hz": float("nan")}, "rate_hz must be a number from 0.*, got nan"),
        ({"rate_hz": "fast"}, "rate_hz must be a number, got 'fast'"),
        ({"parts": []}, "parts must be a list of length from 1, got a list"),
        ({"parts": [{"part": "a"}]}, r"parts\[0\] lacks 'channels'"),
        ({"parts": [{"part": "a", "channels": 0}]}, "a whole number from 1, got 0"),
        ({"parts": [{"part": "a", "channels": 2.5}]}, "a whole number, got 2.5"),
        ({"parts": [{"part": "a", "channels": 10**9}]}, "at most 1000000 are read"),
        ({"parts": [{"part": "a", "channels": 1}] * 2}, "each once"),
        ({"parts": "abc"}, "parts must be a list, got 'abc'"),
    ],
)
def test_info_refuses(change, said):
    found = json.loads(pack_info(INFO, session=3, heartbeat=0.2)) | change
    with pytest.raises(MessageError, match=said):
        unpack_info(json.dumps(found).encode())


def test_json_refuses_what_is_no_object():
    for bad in (b"", b"[1]", b"\xff", b"[" * 5000, b"{" * 2_000_000):
        with pytest.raises(MessageError):
            read_json(bad)


@pytest.mark.fuzz
@given(st.binary(max_size=HEADER.size + 8))
def test_any_bytes_as_a_header_are_read_or_refused(frame):
    try:
        header = unpack_header(frame)
    except MessageError:
        return
    assert header.pack() == frame[:6] + b"\0\0" + frame[8:]


@pytest.mark.fuzz
@given(st.integers(0, HEADER.size - 1), st.integers(0, 255), st.binary(max_size=40))
def test_a_header_with_one_wrong_byte_is_read_or_refused(place, value, frame):
    packed = bytearray(HEAD.pack())
    packed[place] = value
    try:
        values = unpack_values(unpack_header(bytes(packed)), frame, INFO)
    except MessageError:
        return
    assert values.shape == (5,)


words = st.text("aé\n\0{", max_size=3)  # few letters: drawing from all of Unicode is slow to start
nested = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)
keys = st.sampled_from(["skinmap", "name", "kind", "parts", "rate_hz", "robot", "clock"])


@pytest.mark.fuzz
@given(st.dictionaries(keys, nested), st.booleans())
def test_any_description_is_read_or_refused(changes, whole):
    found = json.loads(pack_info(INFO, session=3, heartbeat=0.2)) if whole else {}
    try:
        info = unpack_info(json.dumps(found | changes).encode())
    except MessageError:
        return
    assert info.channels >= 1
