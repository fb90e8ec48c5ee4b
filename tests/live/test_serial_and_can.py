"""The example plug-ins for a serial stream and a CAN bus: a pseudo-terminal, recorded frames."""

from __future__ import annotations

import importlib.util
import os
import pty
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from skinmap.live import PolledSource, check_source
from skinmap.live.sources.source import SourceEnded

PLUGINS = Path(__file__).parents[2] / "docs" / "examples" / "plugins"
WIDTH = 48


def plugin(name: str):
    spec = importlib.util.spec_from_file_location(name, PLUGINS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def terminal():
    """Both ends of a pseudo-terminal: what is written here, and the name to read there."""
    ours, theirs = pty.openpty()
    yield ours, os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def test_serial_lines_are_samples_and_others_are_counted(terminal):
    ours, name = terminal
    robot = SimpleNamespace(parts=("left_hand",), skin=lambda part: range(4))
    how = {"robot": robot, "parts": None, "seed": 0, "speed": 1.0, "loop": False}
    source = plugin("serial_numbers").open_serial(name, **how)
    os.write(ours, b"1,2,3,4\n5 6 7 8\nnoise\n1,2,3\n9,10,1")
    rows = [source.read(5.0).values]
    os.write(ours, b"1,12\n")
    rows.append(source.read(5.0).values)
    np.testing.assert_array_equal(
        np.concatenate(rows), [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12]]
    )
    assert source.counts.refused == 2
    assert source.read(0.0) is None
    source.close()
    source.close()
    with pytest.raises(SourceEnded):
        source.read(1.0)


def frames(samples: np.ndarray, left_out: tuple[int, int] | None = None) -> str:
    """A log of `candump -l`: seven taxels a frame."""
    lines = []
    for step, row in enumerate(samples):
        for place, start in enumerate(range(0, len(row), 7)):
            data = bytes([step % 256, *row[start : start + 7].tolist()]).ljust(8, b"\0")
            if (step, place) != left_out:
                lines.append(f"({step / 50:.6f}) can0 {0x200 + place:03X}#{data.hex().upper()}")
    return "\n".join([*lines, "(9.0) can0 7FF#00"])


@pytest.mark.parametrize("left_out", [None, (2, 3)])
def test_can_frames_become_whole_samples(tmp_path, icub, left_out):
    samples = np.random.default_rng(0).integers(0, 256, (6, WIDTH)).astype(np.uint8)
    skin = len(icub.skin("left_hand"))
    samples = samples[:, :skin]
    (tmp_path / "touch.log").write_text(frames(samples, left_out))
    how = {"robot": icub, "parts": ["left_hand"], "seed": 0, "speed": 1.0, "loop": False}
    source = plugin("can_frames").open_can(str(tmp_path / "touch.log"), **how)
    rows = []
    with pytest.raises(SourceEnded):
        while True:
            block = source.read(1.0)
            rows += [] if block is None else list(block.values)
    kept = samples if left_out is None else np.delete(samples, left_out[0], axis=0)
    np.testing.assert_array_equal(rows, kept)
    assert source.counts.refused == 1  # the frame of another device
    assert source.counts.lost == (left_out is not None)


def test_can_keeps_the_contract_of_sources(tmp_path, icub):
    samples = np.ones((30, len(icub.skin("left_hand"))), np.uint8)
    (tmp_path / "touch.log").write_text(frames(samples))
    how = {"robot": icub, "parts": ["left_hand"], "seed": 0, "speed": 1.0, "loop": False}
    check_source(lambda: plugin("can_frames").open_can(str(tmp_path / "touch.log"), **how))


def test_what_is_no_sample_is_refused_and_the_rest_goes_on():
    rows = [[None, {}], [1, 2], "ab", [[1], [2, 3]], [1, float("nan")]]
    source = PolledSource("device", "left_hand", 2, lambda timeout, counts: rows)
    np.testing.assert_array_equal(source.read(1.0).values, [[1, 2]])
    assert source.counts.refused == 4
