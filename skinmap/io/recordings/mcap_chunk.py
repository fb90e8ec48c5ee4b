"""What a chunk of an MCAP file holds: unfolded within bounds, proved by its checksum."""

from __future__ import annotations

import struct
import zlib

MAX_RECORD = 64 * 2**20  # bytes of one record, and of what a chunk unfolds to; ours have 64 kB
CHUNK_HEAD = struct.Struct("<QQQII")  # times, size, checksum, length of the compression's name
PIECE = 2**20  # unfolded at once [bytes]


def unfold(body: bytes, *, whole: bool = True) -> bytes:
    """Uncompressed content of a chunk; of one that was cut, as much as can be had.

    Raises
    ------
    ValueError
        Sizes beyond what is read, an unknown compression, a wrong checksum.
    """
    _, _, size, checksum, letters = CHUNK_HEAD.unpack_from(body)
    start = CHUNK_HEAD.size + letters + 8
    compression = body[CHUNK_HEAD.size : CHUNK_HEAD.size + min(letters, 8)]
    if size > MAX_RECORD:
        raise ValueError(f"a chunk that says it unfolds to {size / 2**20:.0f} MB")
    if whole and int.from_bytes(body[start - 8 : start], "little") != len(body) - start:
        raise ValueError("a chunk of another length than it says")
    data = _decompress(compression, body[start:], size, whole=whole)
    if whole and (len(data) != size or (checksum and zlib.crc32(data) != checksum)):
        raise ValueError("a chunk with a wrong checksum")
    return data


def _decompress(compression: bytes, data: bytes, size: int, *, whole: bool) -> bytes:
    """At most `size` bytes of what is compressed in `data`, whatever it says of itself."""
    if compression == b"":
        return data[:size]
    if compression == b"zstd":
        return _zstd(data, size, whole=whole)
    if compression == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        try:
            return bytes(LZ4FrameDecompressor().decompress(data, max_length=size))
        except RuntimeError as error:
            raise ValueError(str(error)) from None
    raise ValueError(f"compressed by {compression!r}")


def _zstd(data: bytes, size: int, *, whole: bool) -> bytes:
    """In pieces, so that what a cut frame holds is had before its end is missed."""
    from zstandard import ZstdDecompressor, ZstdError

    reader = ZstdDecompressor(max_window_size=2**26).stream_reader(data)
    pieces, left = [], size
    try:
        while left > 0 and (piece := reader.read(min(left, PIECE))):
            pieces.append(piece)
            left -= len(piece)
    except ZstdError as error:
        if whole:
            raise ValueError(str(error)) from None
    return b"".join(pieces)
