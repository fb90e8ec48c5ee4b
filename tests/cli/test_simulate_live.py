from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
import uuid
from contextlib import contextmanager

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.live import open_publisher, open_source
from skinmap.live.sources.source import StreamInfo

# As docs/json.md lists them.
KEYS = [
    "robot",
    "seed",
    "publish",
    "kind",
    "rate_hz",
    "parts",
    "channels",
    "samples",
    "seconds",
    "behind_s",
    "touches",
    "interrupted",
]
DEADLINE = 60.0  # [s]; only a fault takes as long
COMMAND = (sys.executable, "-c", "from skinmap.cli.main import main; main()", "simulate", "icub")


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@contextmanager
def streaming(*arguments: str):
    """`skinmap simulate` in a process of its own, once it publishes."""
    process = subprocess.Popen(
        [*COMMAND, "--part", "left_hand", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        said = process.stderr.readline()
        assert "publishing 48 channels of iCub at" in said, said
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


def received(source, count: int) -> list:
    blocks, until = [], time.perf_counter() + DEADLINE
    while sum(map(len, blocks)) < count and time.perf_counter() < until:
        block = source.read(0.2)
        if block is not None:
            blocks.append(block)
    return blocks


@pytest.mark.parametrize("way", ["lsl", "zmq"])
def test_simulated_touches_stream_until_interrupted(way, icub):
    spec = f"zmq:{free_port()}" if way == "zmq" else f"lsl:test-{uuid.uuid4().hex[:12]}"
    with streaming("--fault", "rate=200", "--publish", spec, "--json") as process:
        source = open_source(spec, robot=icub)
        assert (source.info.parts, source.info.rate) == (("left_hand",), 200.0)
        assert (source.info.robot, source.info.kind) == ("iCub", "pressure")
        blocks = received(source, 100)
        assert sum(map(len, blocks)) >= 100
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 0, err
        assert "Traceback" not in err
        result = json.loads(out)
        assert result["interrupted"] is True
        assert result["samples"] >= 100
        until = time.perf_counter() + DEADLINE
        while source.alive and time.perf_counter() < until:
            source.read(0.05)
        assert not source.alive
        source.close()


def run(*arguments: str):
    return CliRunner().invoke(cli, ["simulate", "icub", "--part", "left_hand", *arguments])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--publish", "zmq:5555", "--gesture", "pairs"), "leave out pairs"),
        (("--publish", "zmq:5555", "-o", "x.npz"), "leave out --out"),
        (("--publish", "zmq:5555", "--per-gesture", "3"), "leave out --per-gesture"),
        (("--seconds", "3"), "are for streams: add --publish"),
        (("--fault", "raw=yes"), "are for streams: add --publish"),
        (("--publish", "zmq:5555", "--seconds", "0"), "0.0 is not in the range"),
    ],
)
def test_options_that_contradict_each_other_are_refused(arguments, said):
    done = run(*arguments)
    assert done.exit_code == 2
    assert said in done.output


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("tcp:5", "no way to publish 'tcp'"),
        ("zmq:abc", "'abc' is not an address"),
        ("lsl:", "'' is not an LSL stream"),
        ("zmq:9.9.9.9.9:5", "cannot publish at tcp://9.9.9.9.9:5"),
    ],
)
@pytest.mark.filterwarnings("ignore:every machine on the network")
def test_where_nothing_can_be_published_is_one_line(spec, said):
    error = run("--publish", spec).exception
    assert said in str(error)
    assert "\n" not in str(error)


def test_port_in_use_is_one_line():
    port = free_port()
    with open_publisher(f"zmq:{port}", StreamInfo("x", ("a",), (1,), 50.0)):
        error = run("--publish", f"zmq:{port}").exception
    assert isinstance(error, SkinError)  # which `main` shows as one line, with exit code 2
    assert str(error).endswith(f"127.0.0.1:{port}: the port is in use; choose another")


def test_stream_ends_by_itself_and_says_what_it_sent():
    done = run(
        "--publish", f"zmq:{free_port()}", "--seconds", "0.5", "--fault", "raw=yes", "--json"
    )
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert (result["samples"], result["kind"], result["interrupted"]) == (25, "raw", False)
    assert set(result) == set(KEYS)
