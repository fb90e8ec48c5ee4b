"""What CySkin's own programs write: one sample a line, in either of two forms.

1. The first line holds the ids of all channels; each further line a number, the time [s] and a
   value a channel.
2. No such line: each line holds a number and the time [s], then an id and its value in turn.

Values fall into 0 to 20,002; more is an error of a sensor, read as nothing.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from itertools import chain, islice
from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError
from skinmap.io.recordings.channel_table import (
    DIGITS,
    MAX_BYTES,
    ChannelTable,
    needed_mapping,
    recording_of,
)
from skinmap.io.text import MAX_CHANNEL, check_file
from skinmap.touch.recording import Recording

ERROR = 43_000  # values from here on are a sensor's error codes
LEAD = 2  # number and time before the values of a line


def read_cyskin_text(path: Path) -> list[Recording]:
    """Read a recording of CySkin's programs, with a mapping that names its skin.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no mapping, or lines that do not fit together (says which).
    """
    check_file(path, "a CySkin recording", MAX_BYTES)
    mapping = needed_mapping(path)
    try:
        with path.open(encoding="utf-8") as file:
            lines = (
                (number, line.split())
                for number, line in enumerate(file, 1)
                if line.strip() and not line.startswith("#")
            )
            begin = list(islice(lines, 2))
            if len(begin) < 2:
                raise DataFormatError("no samples", path)
            width = len(begin[0][1])
            heads = all(word.isascii() and word.isdigit() for word in begin[0][1])
            heads = heads and len(begin[1][1]) == width + LEAD
            samples = chain(begin[heads:], lines)
            rows = _numbers(samples, width + LEAD * heads, path)
    except UnicodeDecodeError as error:
        raise DataFormatError(f"not a text file ({error.reason})", path) from None
    if heads:
        channels = [min(int(word[:DIGITS]), MAX_CHANNEL + 1) for word in begin[0][1]]
        values = rows[:, LEAD:]
    else:
        pairs = rows[:, LEAD:]
        if pairs.shape[1] == 0 or pairs.shape[1] % 2 or (pairs[:, ::2] != pairs[0, ::2]).any():
            raise DataFormatError(
                "neither a line of ids and then samples, nor samples of ids and values in turn",
                path,
                begin[0][0],
            )
        if not ((pairs[0, ::2] >= 0) & (pairs[0, ::2] <= MAX_CHANNEL)).all():
            raise DataFormatError("ids that are no numbers of taxels", path, begin[0][0])
        channels, values = pairs[0, ::2].astype(np.int64).tolist(), pairs[:, 1::2]
    label = mapping.label_of(path)
    table = ChannelTable(
        rows[:, 1],
        np.where(values >= ERROR, 0.0, values),
        np.array(channels, np.int64),
        np.full(len(rows), 0 if label else -1),
        (label,) if label else (),
    )
    return [recording_of(table, mapping, path)]


def _numbers(lines: Iterable[tuple[int, list[str]]], width: int, path: Path) -> np.ndarray:
    found = array("d")  # a word takes ten times the memory of its number
    for number, words in lines:
        if len(words) != width:
            raise DataFormatError(f"{len(words)} words, expected {width}", path, number)
        try:
            found.extend(map(float, words))
        except ValueError as error:
            raise DataFormatError(str(error), path, number) from None
    return np.frombuffer(found).reshape(-1, width)
