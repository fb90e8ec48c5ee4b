"""Publish samples, contacts and labels so that other programs can follow (docs/live.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from skinmap.errors import UnknownNameError
from skinmap.live.publishing.publisher import Publisher, Topic
from skinmap.live.sources.source import Source, SourceEnded, StreamInfo
from skinmap.registry import Registry
from skinmap.skin.robot import Robot


class OpenPublisher(Protocol):
    """What an entry point of the group `skinmap.publishers` names.

    `address` is what follows the colon of "name:address", empty where there is none; a robot that
    a way has no use for is left alone.
    """

    def __call__(  # noqa: D102 - the class says it
        self, address: str, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None
    ) -> Publisher: ...


publishers: Registry[OpenPublisher] = Registry(
    "way to publish",
    "skinmap.publishers",
    built_in={
        "foxglove": "skinmap.live.publishing.foxglove_publisher:FoxglovePublisher",
        "lsl": "skinmap.live.publishing.lsl_publisher:LslPublisher",
        "zenoh": "skinmap.live.publishing.zenoh_publisher:ZenohPublisher",
        "zmq": "skinmap.live.publishing.zmq_publisher:ZmqPublisher",
    },
)
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
        "foxglove:PORT", "NAME" or "NAME:ADDRESS" of the group `skinmap.publishers`. Without a host
        nobody but this machine can follow; "lsl://any/NAME", "zmq:*:PORT", "zenoh:*:PORT" and
        "foxglove:*:PORT" open it, with a warning.
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
    names = publishers.names()
    if way not in names:
        said = {one.partition(":")[0].partition("[")[0] for one in WAYS}
        raise UnknownNameError("way to publish", way, (*WAYS, *(n for n in names if n not in said)))
    return publishers.get(way)(address, info, wanted, robot)


def stream(source: Source, publisher: Publisher) -> None:
    """Publish all that a source gives, as it comes; back when the source ends."""
    while True:
        try:
            block = source.read(POLL)
        except SourceEnded:
            return
        if block is not None:
            publisher.send_block(block)
