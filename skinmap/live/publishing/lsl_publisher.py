"""Publish over the lab streaming layer: an outlet for samples, others for contacts and labels."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import OutputError, SkinWarning
from skinmap.live.network.lsl_settings import (
    TEXT_TYPE,
    TYPE,
    describe,
    keep_on_loopback,
    load_lsl,
    split_scope,
)
from skinmap.live.publishing.publish import Publisher, Topic
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot

TAKEN = 0.3  # so long a stream of the same name is looked for [s]
BUFFERED = 5  # kept for a follower who reads too slowly [s]
DRIFT = 0.1  # the source's clock may be off by so much before it is set anew [s]


class LslPublisher(Publisher):
    """Outlets "NAME" (samples), "NAME-raw", "NAME-contacts" and "NAME-labels" (JSON).

    Parameters
    ----------
    address : str
        "NAME", or "//any/NAME" for the whole network.
    info : StreamInfo
    topics : sequence of str
    robot : Robot, optional
        Not needed.

    Raises
    ------
    OutputError
        Another stream has that name.
    """

    def __init__(
        self, address: str, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None = None
    ) -> None:
        super().__init__(info, topics)
        self._scope, self.name = split_scope(address)
        self._lsl = load_lsl(self._scope)
        self._offset = float("nan")
        self._outlets: dict[Topic, Any] = {}
        for found in self._lsl.resolve_byprop("name", self.name, 1, TAKEN):
            raise OutputError(
                f"an LSL stream named {self.name!r} is there already: "
                f"{found.uid()} on {found.hostname()}; choose another name"
            )
        for topic in self.topics:
            self._outlets[topic] = self._open(topic)

    def stream_name(self, topic: Topic) -> str:
        """Name of the stream of a topic."""
        return self.name if topic == self.info.kind else f"{self.name}-{topic}"

    def wait_for_followers(self, timeout: float) -> bool:
        """Whether a listener connects within a time [s]."""
        return bool(self._outlets[self.info.kind].wait_for_consumers(timeout))

    def _open(self, topic: Topic) -> Any:
        lsl, name, text = self._lsl, self.stream_name(topic), topic in ("contacts", "labels")
        print_ = repr((name, self.info.robot, self.info.parts, self.info.widths, topic))
        found = lsl.StreamInfo(
            name,
            TEXT_TYPE if text else TYPE,
            1 if text else self.info.channels,
            0.0 if text else self.info.rate,
            "string" if text else "float32",
            # The same after a restart, so that followers find it again.
            hashlib.sha256(print_.encode()).hexdigest()[:16],
        )
        describe(found.desc(), self.info)
        outlet = lsl.StreamOutlet(found, max_buffered=BUFFERED)
        if not self._scope:
            ports = _ports(outlet.get_info().as_xml())
            if not keep_on_loopback(ports):
                warnings.warn(
                    f"LSL listens on ports {sorted(ports)} of all addresses of this machine",
                    SkinWarning,
                    stacklevel=5,
                )
        return outlet

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        if topic not in self._outlets:
            self._outlets[topic] = self._open(topic)
        stamps = self._stamps(times)
        rows = np.ascontiguousarray(values, np.float32)
        self._outlets[topic].push_chunk(rows, stamps.tolist())

    def _send_text(self, topic: Topic, time: float, text: str) -> None:
        stamp = float(self._stamps(np.array([time]))[0])
        self._outlets[topic].push_sample([text], stamp)

    def close(self) -> None:
        """Take the streams away; may be called twice."""
        self._outlets.clear()

    def _stamps(self, times: FloatArray) -> FloatArray:
        """Times in LSL's clock: as evenly spaced as the source's, never far from now."""
        now = self._lsl.local_clock()
        off = now - float(times[-1]) - self._offset
        if not abs(off) < DRIFT:
            self._offset = now - float(times[-1])
        return times + self._offset


def _ports(xml: str) -> set[int]:
    """Ports that a stream is served on."""
    from lxml import etree

    root = etree.fromstring(xml.encode())
    names = ("v4data_port", "v4service_port")
    found = {int(root.findtext(name) or 0) for name in names}
    return found - {0}
