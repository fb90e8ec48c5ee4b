"""A cut or damaged MCAP recording as a whole file that every MCAP reader opens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from skinmap.errors import OutputError
from skinmap.io.recordings.mcap_head import read_head
from skinmap.io.recordings.mcap_index import Content, Index
from skinmap.io.recordings.mcap_recording import METADATA, REPAIRED
from skinmap.io.recordings.mcap_track import read_track
from skinmap.io.recordings.mcap_writer import McapWriter
from skinmap.io.recordings.recorded_stream import RecordedStream

CHUNK_SECONDS = 10.0  # nothing is lived through here, so chunks close by size


def write_repaired(path: Path, output: Path) -> RecordedStream:
    """Copy all messages that can be had, the skin and the touches into a whole file.

    Parameters
    ----------
    path : Path
        A recording of ours.
    output : Path
        MCAP with an index; it remembers what the damaged file had lost.

    Returns
    -------
    RecordedStream
        What is in it.

    Raises
    ------
    MissingFileError, DataFormatError
        As for `read_track`.
    OutputError
        The output cannot be written.
    """
    track = read_track(path)  # refuses what is no recording of ours, or one that makes no sense
    index = Index(path)
    head = read_head(index.found)
    if track.loss.recovered:
        head[REPAIRED] = repr(track.loss.seconds)
    try:
        with output.open("wb", buffering=0) as file:
            writer = McapWriter(file, chunk_seconds=CHUNK_SECONDS)
            writer.add_metadata(METADATA, head)
            numbers = _channels(writer, index, head)
            for name, data in sorted(index.found.attachments.items()):
                writer.add_attachment(name, "text/csv", data)
            _copy(writer, index, numbers)
            writer.finish()
    except OSError as error:
        raise OutputError(f"cannot write {str(output)!r}: {error.strerror}") from None
    return track


def _channels(writer: McapWriter, index: Index, head: dict[str, str]) -> dict[int, int]:
    """Describe the channels anew; their new numbers by the old ones."""
    found = index.found
    schemas = {
        number: writer.add_schema(one.name, one.encoding, one.data)
        for number, one in sorted(found.schemas.items())
    }
    numbers: dict[int, int] = {}
    for number, one in sorted(found.channels.items()):
        own = head if one.metadata else {}
        schema = schemas.get(one.schema_id, 0)
        numbers[number] = writer.add_channel(one.topic, one.message_encoding, schema, own)
    return numbers


def _copy(writer: McapWriter, index: Index, numbers: dict[int, int]) -> None:
    """All messages of known channels, in the order in which they stood in the file."""
    content = Content(index)
    columns: list[tuple[Any, ...]] = []
    for number, messages in index.channels.items():
        if number in numbers:
            count = len(messages)
            rows = np.arange(count)
            columns.append((messages.chunks, messages.offsets, np.full(count, number), rows))
    if not columns:
        return
    chunks, offsets, channels, rows = (np.concatenate(each) for each in zip(*columns, strict=True))
    for place in np.lexsort((offsets, chunks)).tolist():
        number, row = int(channels[place]), int(rows[place])
        messages = index.channels[number]
        data = content(messages, row)
        writer.add_message(numbers[number], messages.times[row], data, messages.samples[row])
