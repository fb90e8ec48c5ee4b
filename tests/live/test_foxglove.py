"""`--publish foxglove`, heard by a client that speaks the protocol with `websockets` alone."""

from __future__ import annotations

import json
import socket
import struct
import threading
import warnings
from collections.abc import Iterator

import numpy as np
import pytest

from skinmap.errors import OutputError, SkinWarning
from skinmap.io.ros2.messages import read_cloud
from skinmap.live import open_publisher
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.live.sources.source import StreamInfo

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
sync = pytest.importorskip("websockets.sync.client")
PART, LIMIT = "left_hand", 20.0


@pytest.fixture
def publisher(icub):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    info = StreamInfo("t", (PART,), (len(icub.skin(PART)),), 50.0, "pressure", "iCub")
    with open_publisher(f"foxglove:{port}", info, robot=icub) as found:
        yield found


class Client:
    """What arrives, by topic."""

    def __init__(self, socket) -> None:
        self.socket = socket
        self.channels: dict[str, dict] = {}
        self.topics: dict[int, str] = {}
        self.told: list[dict] = []

    def subscribe(self) -> None:
        new = [one for one in self.channels.values() if one["id"] not in self.topics]
        self.topics |= {one["id"]: one["topic"] for one in new}
        if new:
            asked = [{"id": one["id"], "channelId": one["id"]} for one in new]
            self.say(op="subscribe", subscriptions=asked)

    def say(self, **words) -> None:
        self.socket.send(json.dumps(words))

    def hear(self) -> tuple[str, bytes] | None:
        """The next message of a topic; None for words of the server, which are kept."""
        frame = self.socket.recv(timeout=LIMIT)
        if isinstance(frame, bytes):
            if frame[0] != 1:
                return None
            (number,) = struct.unpack_from("<I", frame, 1)
            return self.topics[number], frame[13:]
        words = json.loads(frame)
        self.told.append(words)
        if words["op"] == "advertise":
            self.channels |= {one["topic"]: one for one in words["channels"]}
        return None

    def until(self, topics: set[str], send) -> dict[str, list[bytes]]:
        """Messages, while `send` is called again and again, until all topics have brought one."""
        got: dict[str, list[bytes]] = {}
        stop = threading.Event()

        def work():
            while not stop.wait(0.01):
                send()

        thread = threading.Thread(target=work)
        thread.start()
        try:
            for _ in range(10_000):
                if topics <= set(got):
                    break
                found = self.hear()
                self.subscribe()
                if found is not None:
                    got.setdefault(found[0], []).append(found[1])
        finally:
            stop.set()
            thread.join()
        return got

    def asked(self, op: str) -> dict:
        for _ in range(1000):
            for words in self.told:
                if words["op"] == op:
                    self.told.remove(words)
                    return words
            self.hear()
        raise AssertionError(f"no {op} came")


def moment(icub, time=1.0):
    width = len(icub.skin(PART))
    touch = NamedTouch(PART, np.array([3, 4]), icub.skin(PART).positions[3], "poke", 0.75, 5)
    return Moment(time, {PART: np.arange(width, dtype=np.float32)}, (touch,))


@pytest.fixture
def client(publisher) -> Iterator[Client]:
    address = f"ws://127.0.0.1:{publisher.port}"
    with sync.connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        yield Client(socket)


def test_client_gets_scene_touches_transforms_samples_and_labels(publisher, client, icub):
    wanted = {
        "/skin/pressure", "/skin/points", "/skin/scene", "/tf_static",
        "/robot_description", "/skin/markers", "/skin/contacts",
    }  # fmt: skip
    time = [0.0]

    def send():
        time[0] += 0.02
        publisher.send(moment(icub, time[0]))

    got = client.until(wanted, send)
    schemas = {topic: one["schemaName"] for topic, one in client.channels.items()}
    assert schemas["/skin/scene"] == "foxglove.SceneUpdate"
    assert schemas["/tf_static"] == "tf2_msgs/msg/TFMessage"
    width = len(icub.skin(PART))
    values = np.frombuffer(got["/skin/pressure"][-1], "<f4", offset=36)
    np.testing.assert_array_equal(values, np.arange(width))
    _, points = read_cloud(got["/skin/points"][-1])
    np.testing.assert_array_equal(points["pressure"], np.arange(width))
    assert b"poke" in got["/skin/markers"][-1]
    assert f"skin {PART}".encode() in got["/skin/scene"][-1]
    # A colour (38 bytes with its head) and a point (29) for each taxel, and three corners a face.
    assert len(got["/skin/scene"][-1]) > width * (38 + 29)


def test_port_in_use_and_open_address_are_said(publisher, icub):
    with pytest.raises(OutputError, match=r"cannot publish at 127\.0\.0\.1"):
        open_publisher(f"foxglove:{publisher.port}", publisher.info, robot=icub)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SkinWarning)
        with pytest.raises(SkinWarning, match="every machine"):
            open_publisher("foxglove:*:1", publisher.info)
