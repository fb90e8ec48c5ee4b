"""Zenoh: our publisher and source in two processes, and what a node of ROS 2 would send or see."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, MessageError, SkinMismatchError, UnreachableError
from skinmap.io.ros2.messages import Cloud, encode, read_cloud
from skinmap.live import open_publisher, open_source
from skinmap.live.network.zenoh_stream import (
    ATTACHMENT,
    key_of,
    open_session,
    parse_zenoh,
    values_of,
)
from skinmap.live.sources.source import Block, StreamInfo

zenoh = pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
PART, LIMIT = "left_hand", 20.0


@pytest.fixture
def port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def read_all(source, count: int):
    """At least so many samples."""
    times, rows = [], []
    until = time.perf_counter() + LIMIT
    while len(rows) < count and time.perf_counter() < until:
        block = source.read(0.5)
        if block is not None:
            times += block.times.tolist()
            rows += list(block.values)
    return np.array(times), np.array(rows)


def test_every_sample_of_another_process_arrives(port, icub):
    command = [
        str(Path(sys.executable).with_name("skinmap")), "simulate", "icub", "--part", PART,
        "--publish", f"zenoh:{port}", "--seconds", "15",
    ]  # fmt: skip
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert "publishing" in child.stderr.readline()
        source = open_source(f"zenoh:{port}", robot=icub)
        assert (source.info.parts, source.info.kind) == ((PART,), "pressure")
        times, rows = read_all(source, 50)
        assert rows.shape[1] == len(icub.skin(PART))
        assert (np.diff(times) >= 0).all()
        assert source.alive
        assert (source.counts.lost, source.counts.refused, source.counts.dropped) == (0, 0, 0)
        source.close()
    finally:
        child.terminate()
        child.wait(LIMIT)
        child.stderr.close()


def test_samples_keep_their_times_apart(port, icub):
    """They are sent when they come, a few at once."""
    width = len(icub.skin(PART))
    info = StreamInfo("t", (PART,), (width,), 50.0, "pressure", "iCub")
    with open_publisher(f"zenoh:{port}", info) as publisher:
        source = open_source(f"zenoh:{port}", robot=icub)
        first_one = Block(np.array([99.98]), np.zeros((1, width), np.uint8), 0.0)
        while source.read(0.2) is None:  # until the publisher knows of the source
            publisher.send_block(first_one)
        before = time.time()
        for first in range(0, 30, 10):
            times = 100.0 + 0.02 * np.arange(first, first + 10)
            publisher.send_block(Block(times, np.zeros((10, width), np.uint8), 0.0))
        times, _ = read_all(source, 30)
        source.close()
    np.testing.assert_allclose(np.diff(times), 0.02, atol=1e-6)
    assert times[0] == pytest.approx(before, abs=2.0)  # in ROS time


def test_node_of_ros2_sees_keys_messages_and_tokens(port, icub):
    width = len(icub.skin(PART))
    info = StreamInfo("t", (PART,), (width,), 50.0, "pressure", "iCub")
    with open_publisher(f"zenoh:{port}", info, robot=icub, topics=["pressure"]) as publisher:
        session = open_session(parse_zenoh(str(port)).address, listen=False)
        came = {}
        subscriber = session.declare_subscriber(
            "0/skin/**", lambda one: came.setdefault(str(one.key_expr), one)
        )
        values, until = np.arange(width, dtype=np.float32), time.perf_counter() + LIMIT
        keys = {key_of("/skin/pressure", "std_msgs/Float32MultiArray"),
                key_of("/skin/points", "sensor_msgs/PointCloud2")}  # fmt: skip
        step = 0
        while not keys <= set(came) and time.perf_counter() < until:
            publisher.send_samples("pressure", np.array([step / 50]), values[None])
            step += 1
        assert keys <= set(came)
        one = came[key_of("/skin/points", "sensor_msgs/PointCloud2")]
        assert "sensor_msgs::msg::dds_::PointCloud2_/RIHS01_9198cabf" in str(one.key_expr)
        _, points = read_cloud(one.payload.to_bytes())
        np.testing.assert_array_equal(points["pressure"], values)
        number, sent, length, _ = ATTACHMENT.unpack(one.attachment.to_bytes())
        assert number >= 1
        assert length == 16
        assert abs(sent / 1e9 - time.time()) < 60
        tokens = [str(one.ok.key_expr) for one in session.liveliness().get("@ros2_lv/**")]
        assert any("/NN/" in one for one in tokens)
        assert any("/MP/" in one and "%skin%pressure" in one for one in tokens)
        subscriber.undeclare()
        session.close()


@pytest.mark.parametrize("kind", ["sensor_msgs/PointCloud2", "std_msgs/Float32MultiArray"])
def test_topic_of_somebody_else_is_a_source(port, icub, kind):
    width = len(icub.skin(PART))
    session = open_session(parse_zenoh(str(port)).address, listen=True)
    publisher = session.declare_publisher(key_of("/tactile", kind))
    cloud = Cloud("hand", np.zeros((width, 3)), "force")
    values = np.linspace(0, 1, width, dtype=np.float32)
    message = cloud.message(10**9, values) if "Cloud" in kind else encode(values, "Float32")
    try:
        source = None
        stop = threading.Event()

        def send():
            step = 0
            while not stop.wait(0.01):
                step += 1
                publisher.put(message, attachment=ATTACHMENT.pack(step, step, 16, bytes(16)))

        thread = threading.Thread(target=send)
        thread.start()
        try:
            source = open_source(f"zenoh:{port}/tactile", robot=icub, parts=[PART])
            assert source.info.parts == (PART,)
            _, rows = read_all(source, 5)
            np.testing.assert_array_equal(rows[0], values)
            assert source.counts.lost == 0
            with pytest.raises(SkinMismatchError, match=f"has {width} values"):
                open_source(f"zenoh:{port}/tactile", robot=icub, parts=["torso"])
        finally:
            stop.set()
            thread.join()
            if source is not None:
                source.close()
    finally:
        session.close()


def test_silence_and_wrong_words_are_said(port, monkeypatch):
    monkeypatch.setattr("skinmap.live.network.zenoh_stream.WAIT", 0.3)
    with pytest.raises(UnreachableError, match=r"nothing is published on /skin at 127\.0\.0\.1"):
        open_source(f"zenoh:{port}")
    with pytest.raises(InvalidArrayError, match="no topic of ROS 2"):
        open_source("zenoh:/a b")
    with pytest.raises(MessageError, match="clouds and arrays are read"):
        values_of("std_msgs::msg::dds_::String_", b"\x00\x01\x00\x00")
    monkeypatch.setenv("ROS_DOMAIN_ID", "x")
    with pytest.raises(InvalidArrayError, match="ROS_DOMAIN_ID is 'x'"):
        key_of("/a", "std_msgs/String")


def test_a_clock_that_steps_back_between_waiting_messages_keeps_all_of_them(port, icub):
    """`SampleChecks` finds the step; times that were made equal would be dropped as repeated."""
    width = len(icub.skin(PART))
    session = open_session(parse_zenoh(str(port)).address, listen=True)
    publisher = session.declare_publisher(key_of("/tactile", "std_msgs/Float32MultiArray"))
    message = encode(np.linspace(0, 1, width, dtype=np.float32), "Float32")
    stop, stamps = threading.Event(), []

    def send():
        while not stop.wait(0.005):
            step = len(stamps)
            stamp = 10**9 * (100 if step < 200 else 50) + step * 5_000_000
            stamps.append(stamp)
            publisher.put(message, attachment=ATTACHMENT.pack(step, stamp, 16, bytes(16)))

    thread = threading.Thread(target=send)
    thread.start()
    source = None
    try:
        source = open_source(f"zenoh:{port}/tactile", robot=icub, parts=[PART])
        times, _ = read_all(source, 300)
        assert len(np.unique(times)) == len(times)
        assert (np.diff(times) < 0).sum() == 1
        publisher.put(message)  # nobody stamped it: the stream's clock is the sender's
        deadline = time.perf_counter() + LIMIT
        while source.counts.refused == 0 and time.perf_counter() < deadline:
            source.read(0.1)
        assert source.counts.refused == 1
    finally:
        stop.set()
        thread.join()
        if source is not None:
            source.close()
        session.close()
