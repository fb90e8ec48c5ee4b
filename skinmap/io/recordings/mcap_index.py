"""Where the messages of an MCAP recording are, and their values, read when asked."""

from __future__ import annotations

from array import array
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError
from skinmap.io.recordings.mcap_recording import TOPICS
from skinmap.io.recordings.mcap_scan import DAMAGED, Place, read_chunk, scan
from skinmap.io.recordings.recorded_stream import Kind, seconds_of
from skinmap.io.ros2.arrays import DTYPES, HEAD, Number, decode

KEPT = 4  # chunks kept unfolded: who plays a recording comes by each of them once


class Messages:
    """Where the messages of one channel are: five numbers each, however long they are."""

    def __init__(self) -> None:
        self.times, self.samples = array("Q"), array("I")
        self.chunks, self.offsets, self.lengths = array("I"), array("I"), array("I")

    def __len__(self) -> int:
        return len(self.times)

    def order(self) -> IntArray:
        """Rows in the order of their times; those of one time as they were written."""
        return np.argsort(np.frombuffer(self.times, np.uint64), kind="stable")


class Index:
    """All messages of a file by channel, and its chunks."""

    def __init__(self, path: Path) -> None:
        self.channels: dict[int, Messages] = {}
        self.chunks: list[Place] = []
        self.path = path
        self.found = scan(path, self._take)

    def _take(
        self, channel: int, sample: int, time: int, offset: int, length: int, place: Place
    ) -> None:
        if not self.chunks or self.chunks[-1] is not place:
            self.chunks.append(place)
        messages = self.channels.setdefault(channel, Messages())
        messages.times.append(time)
        messages.samples.append(sample)
        messages.chunks.append(len(self.chunks) - 1)
        messages.offsets.append(offset)
        messages.lengths.append(length)

    def of(self, topic: str) -> Messages:
        """Messages of a topic; none where the file has no such channel."""
        for channel in self.found.copies:
            if channel.topic == topic and channel.id in self.channels:
                return self.channels[channel.id]
        return Messages()


class Content:
    """The bytes of messages, read when asked; the newest chunks are kept."""

    def __init__(self, index: Index) -> None:
        self._index = index
        self._kept: OrderedDict[int, bytes] = OrderedDict()

    def __call__(self, messages: Messages, row: int) -> bytes:
        """Bytes of one message.

        Raises
        ------
        DataFormatError
            The file has changed since it was opened.
        """
        number = messages.chunks[row]
        if number not in self._kept:
            try:
                with self._index.path.open("rb") as file:
                    chunk = read_chunk(file, self._index.chunks[number])
            except (OSError, *DAMAGED) as error:
                raise DataFormatError(f"has changed since: {error}", self._index.path) from None
            while len(self._kept) >= KEPT:
                self._kept.popitem(last=False)
            self._kept[number] = chunk
        start = messages.offsets[row]
        return self._kept[number][start : start + messages.lengths[row]]


class McapSamples:
    """Values (t, channels) of a recording, read from its chunks when asked.

    Parameters
    ----------
    index : Index
    kind : {"raw", "pressure"}
    channels : int

    Raises
    ------
    DataFormatError
        A sample of another number of values.
    """

    def __init__(self, index: Index, kind: Kind, channels: int) -> None:
        self._channels, self._path = channels, index.path
        self._content = Content(index)
        self._messages: dict[Number, Messages] = {
            number: index.of(topic) for (each, number), topic in TOPICS.items() if each == kind
        }
        times, samples, numbers, rows = [], [], [], []
        for place, (number, messages) in enumerate(self._messages.items()):
            self._check_lengths(number, messages)
            times.append(np.array(messages.times, np.uint64))
            samples.append(np.array(messages.samples, np.int64))
            numbers.append(np.full(len(messages), place))
            rows.append(np.arange(len(messages)))
        stamps = np.concatenate(times)
        # Those of one time in the order in which they were written.
        order = np.lexsort((np.concatenate(samples), stamps))
        self.stamps: IntArray = stamps[order].astype(np.int64)
        self.times: FloatArray = seconds_of(stamps[order])
        self.samples: IntArray = np.concatenate(samples)[order]
        self._numbers, self._rows = np.concatenate(numbers)[order], np.concatenate(rows)[order]
        floats = len(self._messages["Float32"]) > 0
        self.dtype = DTYPES["Float32" if floats else "UInt8"]

    def _check_lengths(self, number: Number, messages: Messages) -> None:
        wanted = HEAD.size + self._channels * DTYPES[number].itemsize
        other = np.flatnonzero(np.array(messages.lengths, np.int64) != wanted)
        if len(other):
            size = messages.lengths[int(other[0])] - HEAD.size
            raise DataFormatError(
                f"sample {other[0]} has {max(size, 0) // DTYPES[number].itemsize} values, its skin "
                f"{self._channels} channels",
                self._path,
            )

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        names = tuple(self._messages)
        chosen = list(zip(self._numbers[rows].tolist(), self._rows[rows].tolist(), strict=True))
        values = np.zeros((len(chosen), self._channels), self.dtype)
        for place, (which, row) in enumerate(chosen):
            message = self._content(self._messages[names[which]], row)
            try:
                values[place] = decode(message, names[which])
            except ValueError as error:
                raise DataFormatError(f"sample {row}: {error}", self._path) from None
        return values
