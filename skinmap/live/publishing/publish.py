"""Publish samples, contacts and labels so that other programs can follow (docs/live.md)."""

from __future__ import annotations

from collections.abc import Sequence

from skinmap.errors import UnknownNameError
from skinmap.live.publishing.foxglove_publisher import FoxglovePublisher
from skinmap.live.publishing.lsl_publisher import LslPublisher
from skinmap.live.publishing.publisher import Publisher, Topic
from skinmap.live.publishing.zenoh_publisher import ZenohPublisher
from skinmap.live.publishing.zmq_publisher import ZmqPublisher
from skinmap.live.sources.source import Source, SourceEnded, StreamInfo
from skinmap.skin.robot import Robot

WAYS = ("lsl:NAME", "zmq:PORT", "zmq:HOST:PORT", "zenoh[:PORT]", "foxglove[:PORT]")
POLL = 0.2  # so often a silent source lets an interruption through [s]


def open_publisher(
    spec: str,
    info: StreamInfo,
    *,
    topics: Sequence[Topic] | None = None,
    robot: Robot | None = None,
) -> Publisher:
    """Open a stream that others can follow.

    Parameters
    ----------
    spec : str
        "lsl:NAME", "zmq:PORT" or "zmq:HOST:PORT", "zenoh" or "zenoh:PORT", "foxglove" or
        "foxglove:PORT". Without a host nobody but this machine can follow; "lsl://any/NAME",
        "zmq:*:PORT", "zenoh:*:PORT" and "foxglove:*:PORT" open it, with a warning.
    info : StreamInfo
        Of the samples.
    topics : sequence of {"raw", "pressure", "contacts", "labels"}, optional
        What to send of a moment: the samples of the stream's kind by default, with contacts and
        labels.
    robot : Robot, optional
        What Foxglove and ROS 2 draw.

    Raises
    ------
    UnknownNameError
        No such way or topic.
    OutputError
        A port that is in use, or a name that another stream has.
    MissingLibraryError
        A package that the way needs is not installed.
    """
    way, _, address = spec.partition(":")
    wanted: Sequence[Topic] = (info.kind, "contacts", "labels") if topics is None else topics
    if way == "zmq":
        return ZmqPublisher(address, info, wanted)
    if way == "lsl":
        return LslPublisher(address, info, wanted)
    if way == "zenoh":
        return ZenohPublisher(address, info, wanted, robot)
    if way == "foxglove":
        return FoxglovePublisher(address, info, wanted, robot)
    raise UnknownNameError("way to publish", way, WAYS)


def stream(source: Source, publisher: Publisher) -> None:
    """Publish all that a source gives, as it comes; back when the source ends."""
    while True:
        try:
            block = source.read(POLL)
        except SourceEnded:
            return
        if block is not None:
            publisher.send_block(block)
