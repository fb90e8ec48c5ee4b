"""Publish samples, contacts and labels so that other programs can follow (docs/live.md)."""

from __future__ import annotations

import json
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import SkinMismatchError, UnknownNameError, check_known
from skinmap.live.contacts.named_touch import Moment, NamedTouch, words_of
from skinmap.live.network.network_messages import VERSION
from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo
from skinmap.recognition.answers import answers_object
from skinmap.registry import Registry
from skinmap.skin.robot import Robot

# What an entry point of the group `skinmap.publishers` names: it is called with an address, a
# StreamInfo, topics and a robot or None. The address is what follows the colon of "name:address",
# empty where there is none; a robot that a way has no use for is left alone.
publishers: Registry[Callable[..., Publisher]] = Registry(
    "way to publish",
    "skinmap.publishers",
    built_in={
        "foxglove": "skinmap.live.publishing.ros2_topics:FoxglovePublisher",
        "lsl": "skinmap.live.network.lsl_stream:LslPublisher",
        "zenoh": "skinmap.live.network.zenoh_stream:ZenohPublisher",
        "zmq": "skinmap.live.network.zmq_stream:ZmqPublisher",
    },
)
WAYS = ("lsl:NAME", "zmq:PORT", "zmq:HOST:PORT", "zenoh[:PORT]", "foxglove[:PORT]")
HEARTBEAT = 0.2  # between two descriptions, so that a dead publisher shows within 1 s [s]
POLL = 0.2  # so often a silent source lets an interruption through [s]


def open_publisher(
    spec: str,
    info: StreamInfo,
    *,
    topics: Sequence[Topic] | None = None,
    robot: Robot | None = None,
    speed: float = 1.0,
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
    speed : float
        Of the source, as a multiple of its clock: LSL and Zenoh send times of this machine.

    Returns
    -------
    Publisher
        Open; `send(moment)` and `send_block(block)` publish, `close()` ends it.

    Raises
    ------
    UnknownNameError
        No such way or topic.
    OutputError
        A port that is in use, or a name that another stream has.
    MissingLibraryError
        A package that the way needs is not installed.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> publisher = skinmap.live.open_publisher("lsl:example", source.info)
    >>> publisher.send_block(source.read(30.0))
    >>> publisher.close()
    >>> source.close()
    """
    way, _, address = spec.partition(":")
    wanted: Sequence[Topic] = (info.kind, "contacts", "labels") if topics is None else topics
    names = publishers.names()
    if way not in names:
        said = {one.partition(":")[0].partition("[")[0] for one in WAYS}
        raise UnknownNameError("way to publish", way, (*WAYS, *(n for n in names if n not in said)))
    publisher = publishers.get(way)
    # Ways that keep the source's own times know of no speed.
    own = {"speed": speed} if speed != 1.0 and way in ("lsl", "zenoh") else {}
    return publisher(address, info, wanted, robot, **own)


def stream(
    source: Source, publisher: Publisher | None, seconds: float | None = None
) -> tuple[int, bool]:
    """Publish what a source gives, as it comes, until it ends, for so long [s], or until Ctrl-C.

    Returns
    -------
    came : int
        Samples.
    interrupted : bool
    """
    came, began = 0, time.perf_counter()
    try:
        while seconds is None or time.perf_counter() - began < seconds:
            block = source.read(POLL)
            if block is not None:
                came += len(block)
                if publisher is not None:
                    publisher.send_block(block)
    except (SourceEnded, KeyboardInterrupt) as why:
        return came, isinstance(why, KeyboardInterrupt)
    return came, False


Topic = Literal["raw", "pressure", "contacts", "labels"]
TOPICS: tuple[Topic, ...] = ("raw", "pressure", "contacts", "labels")


def _samples_of(moment: Moment) -> tuple[FloatArray, dict[str, Any], dict[str, Any]]:
    """Samples of the step that ends in a moment: the last one is what the moment itself shows."""
    times, before, raw_before = moment.block or (np.array([moment.time]), {}, {})

    def rows(own: Mapping[str, Any], earlier: Mapping[str, Any]) -> dict[str, Any]:
        return {part: np.concatenate([earlier[part][:-1], row[None]]) if part in earlier
                else row[None].repeat(len(times), axis=0) for part, row in own.items()}  # fmt: skip

    return times, rows(moment.pressures, before), rows(moment.raw, raw_before)


STEP = 1e-6  # least between two samples of a topic, which a follower would drop as repeated [s]


class OurTimes:
    """A source's times in a clock of this machine: evenly spaced as they are, never backwards.

    Parameters
    ----------
    clock : callable
        The time now [s].
    speed : float
        Of the source, as a multiple of its clock.
    drift : float
        The source's clock may be off by so much before it is set anew [s].
    """

    def __init__(self, clock: Callable[[], float], speed: float, drift: float) -> None:
        self._clock, self._speed, self._drift = clock, speed, drift
        self._offset = float("nan")
        self._last: dict[str, float] = {}

    def stamps(self, topic: str, times: FloatArray) -> FloatArray:
        """Times (k,) of samples of a topic in our clock [s]."""
        own = times / self._speed
        now = self._clock()
        if not abs(now - float(own[-1]) - self._offset) < self._drift:
            self._offset = now - float(own[-1])
        steps = STEP * np.arange(1, len(own) + 1)
        after = np.maximum(own + self._offset - steps, self._last.get(topic, -np.inf))
        found: FloatArray = np.maximum.accumulate(after) + steps
        self._last[topic] = float(found[-1])
        return found


def played(info: StreamInfo, speed: float) -> StreamInfo:
    """A stream whose samples come so many times faster; without a rate where all come at once."""
    return replace(info, rate=info.rate * speed if speed < np.inf else 0.0)


class Publisher(ABC):
    """Sends what it is given, with or without listeners.

    Parameters
    ----------
    info : StreamInfo
        Of the samples.
    topics : sequence of {"raw", "pressure", "contacts", "labels"}
        What to send of a moment.
    robot : Robot, optional
        What some ways draw.
    """

    def __init__(
        self, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None = None
    ) -> None:
        check_known("topic", topics, TOPICS)
        self.info, self.topics, self.robot = info, tuple(dict.fromkeys(topics)), robot
        self.sent = 0
        self._contacts: tuple[NamedTouch, ...] = ()
        self._labels: tuple[tuple[Any, ...], ...] = ()

    def send(self, moment: Moment) -> None:
        """Send a moment: the samples of its step, contacts while there are any, changed labels.

        Raises
        ------
        SkinMismatchError
            A part of the stream is missing, or has another number of taxels.
        """
        if moment.stale:
            return
        times, pressures, raw = _samples_of(moment)
        if "raw" in self.topics and raw:
            self.send_samples("raw", times, self._rows(raw))
        if "pressure" in self.topics:
            self.send_samples("pressure", times, self._rows(pressures))
        if "contacts" in self.topics and (moment.touches or self._contacts):
            self._send_text("contacts", moment.time, contacts_json(moment))
        self._contacts = moment.touches
        named = tuple(
            (one.part, one.identity, one.label, _number(round(one.confidence, 2)), words_of(one))
            for one in moment.touches
        )
        if "labels" in self.topics and named != self._labels:
            self._send_text("labels", moment.time, labels_json(moment))
        self._labels = named

    def send_block(self, block: Block) -> None:
        """Send samples as a source gave them."""
        self.send_samples(self.info.kind, block.times, block.values)

    def send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        """Send samples (k, channels); uint8 goes as it is, other types as float32.

        Raises
        ------
        SkinMismatchError
            Another number of channels than the stream declares.
        """
        if values.ndim != 2 or values.shape[1] != self.info.channels:
            raise SkinMismatchError(
                f"{values.shape[-1]} values in a sample, "
                f"stream {self.info.name!r} has {self.info.channels} channels"
            )
        self._send_samples(topic, times, values)
        self.sent += len(values)

    @abstractmethod
    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None: ...

    @abstractmethod
    def _send_text(self, topic: Topic, time: float, text: str) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Give threads and sockets back; may be called twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _rows(self, values: Any) -> NDArray[Any]:
        missing = [part for part in self.info.parts if part not in values]
        if missing:
            raise SkinMismatchError(f"stream {self.info.name!r} misses {', '.join(missing)}")
        return np.concatenate([np.asarray(values[part]) for part in self.info.parts], axis=1)


def repeated(seconds: float, call: Callable[[], object]) -> Callable[[], None]:
    """Call a function now and every so many seconds, in a thread; what is returned ends that."""
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            call()
            stop.wait(seconds)

    def end() -> None:
        stop.set()
        thread.join()

    thread = threading.Thread(target=work, name="heartbeat", daemon=True)
    thread.start()
    return end


def contacts_json(moment: Moment) -> str:
    """Contacts of a moment, without names."""
    contacts = [
        {
            "part": one.part,
            "identity": one.identity,
            "began_s": _number(one.began),
            "taxels": one.taxels.tolist(),
            "centre_m": _numbers(one.centre),
            "normal": None if one.normal is None else _numbers(one.normal),
            "area_m2": _number(one.area),
            "area_least_m2": _number(one.area_least),
            "peak": _number(one.peak),
            "mean": _number(one.mean),
            "load": None if one.load is None else one.load.plain(),
            "path_m": None if one.path is None else [_numbers(row) for row in one.path],
        }
        for one in moment.touches
    ]
    return _text({"skinmap": VERSION, "time_s": _number(moment.time), "contacts": contacts})


def labels_json(moment: Moment) -> str:
    """Names of the touches of a moment."""
    labels = [
        {
            "part": one.part,
            "identity": one.identity,
            "label": one.label,
            "confidence": _number(one.confidence),
            "began_s": _number(one.began),
            **answers_object(one.answers),
        }
        for one in moment.touches
    ]
    return _text({"skinmap": VERSION, "time_s": _number(moment.time), "labels": labels})


def _text(found: dict[str, Any]) -> str:
    return json.dumps(found, allow_nan=False, separators=(",", ":"))


def _number(value: float) -> float | None:
    """Seven digits are more than any of it deserves; JSON has no NaN."""
    return float(f"{value:.10g}") if np.isfinite(value) else None


def _numbers(values: NDArray[Any]) -> list[float | None]:
    return [_number(float(value)) for value in values]
