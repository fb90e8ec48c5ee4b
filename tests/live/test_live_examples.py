"""The examples of docs/live.md run as they are written."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import uuid
from pathlib import Path

import numpy as np
import pytest

from skinmap.live import open_publisher
from skinmap.live.sources.source import StreamInfo

ROOT = Path(__file__).parents[2]
INFO = StreamInfo("demo", ("left_hand",), (48,), 200.0, "pressure", "iCub")


def code(beginning: str) -> str:
    text = (ROOT / "docs" / "live.md").read_text()
    (found,) = re.findall(rf"```python\n({beginning}.*?)```", text, flags=re.DOTALL)
    return found


@pytest.fixture
def publish():
    """A function that publishes a skin at 200 Hz until the test is over."""
    stop, threads = threading.Event(), []

    def begin(spec: str) -> None:
        publisher = open_publisher(spec, INFO, topics=["pressure"])

        def send() -> None:
            step = 0
            while not stop.wait(0.005):
                values = np.full((1, 48), step % 100, np.uint8)
                publisher.send_samples("pressure", np.array([step / 200]), values)
                step += 1
            publisher.close()

        threads.append(threading.Thread(target=send))
        threads[-1].start()

    yield begin
    stop.set()
    for thread in threads:
        thread.join()


def run(text: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", text, *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_zmq_reader_reads_without_skinmap(publish):
    text = code("# zmq reader")
    assert "skinmap" not in text
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    publish(f"zmq:{port}")
    out = run(text, str(port))
    samples = re.findall(r"sample (\d+) at ([\d.]+) s: 48 channels, largest (\d+)", out)
    assert len(samples) >= 10
    for sequence, moment, largest in samples:
        assert int(largest) == int(sequence) % 100
        assert float(moment) == pytest.approx(int(sequence) / 200, abs=0.0051)  # two digits


def test_lsl_reader_reads_without_skinmap(publish):
    text = code("# lsl reader")
    assert "import skinmap" not in text
    name = f"test-{uuid.uuid4().hex[:12]}"
    publish(f"lsl:{name}")
    out = run(text, name)
    assert out.startswith("left_hand 48\n")
    assert len(re.findall(r"sample at [\d.]+ s: 48 channels, [\d.]+\n", out)) == 20


def test_readers_are_short():
    for beginning in ("# zmq reader", "# lsl reader"):
        lines = [line for line in code(beginning).splitlines() if line and line[0] != "#"]
        assert len(lines) <= 15


def test_opening_a_source_as_written(capsys):
    exec(compile(code("from skinmap.live import open_source"), "docs/live.md", "exec"), {})
    assert "('left_hand',) 48 50.0" in capsys.readouterr().out
