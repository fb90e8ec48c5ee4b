"""One file, one count of touches, whichever command counts them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.collection import collect
from skinmap.cli.main import cli
from skinmap.io.mcap.reading import read_track
from skinmap.io.mcap.writing import McapRecording
from skinmap.touch.contacts.grouping import without_stuck
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

PART, RATE = "left_hand", 50.0


def run(*words):
    found = CliRunner().invoke(cli, [*map(str, words), "--json"], catch_exceptions=False)
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


@pytest.fixture(scope="module")
def skin():
    return PreparedSkin(skinmap.load_robot("kaspar").skin(PART))


@pytest.fixture(scope="module")
def file(skin, tmp_path_factory):
    """Twelve touches, and a mark of three seconds under which an area hangs and nobody touches."""
    rng, gestures = np.random.default_rng(5), ["poke", "full_finger"]
    made = simulate(skin.skin, rng=rng, gestures=gestures, per_gesture=6, variety=0.0)
    quiet = np.zeros((200, len(skin)), np.uint8)
    values = np.concatenate([quiet, made.pressures, quiet])
    hang = np.argsort(np.linalg.norm(skin.skin.positions - skin.skin.positions[5], axis=1))[:5]
    values[:, hang] = 120
    path = tmp_path_factory.mktemp("counts") / "marked.mcap"
    times = np.arange(len(values)) / RATE
    marked = McapRecording(
        path, parts=(PART,), widths={"pressure": (len(skin),)}, rate=RATE, name="t",
        robot="Kaspar", manifest="kaspar",
    )  # fmt: skip
    for time, row in zip(times.tolist(), values, strict=True):
        marked.add("pressure", time, row)
    for event, label in enumerate(made.labels):
        own = times[200:-200][made.events == event]
        marked.mark(PART, event, label, began=float(own[0]), ended=float(own[-1]))
    marked.mark(PART, 99, "hold", began=0.0, ended=3.0)
    marked.close()
    return path


def test_marks_on_stuck_taxels_are_left_out_everywhere(file, tmp_path):
    merged = run("merge", file, "-o", tmp_path / "merged.mcap")
    labelled = run("label", file, "-o", tmp_path / "marks.csv")
    trained = run("train", file, "-o", tmp_path / "m.skinmodel")
    found = collect([file])
    assert sum(merged["touches"].values()) == 12
    assert sum(labelled["touches"].values()) == 12
    assert (merged["stuck"], labelled["stuck"], found.stuck) == (1, 1, 1)
    assert len(found.touches) == 12
    assert trained["touches"] == 12
    assert "1 marked touches were left out: only stuck taxels were pressed" in trained["warnings"]
    assert run("merge", tmp_path / "merged.mcap", "-o", tmp_path / "again.mcap")["stuck"] == 0


def test_what_nobody_touches_stays_marked_as_that(skin):
    made = simulate(skin.skin, rng=np.random.default_rng(5), per_gesture=1, variety=0.0)
    same, gone = without_stuck(made, skin.geometry)
    assert same is made
    assert len(gone) == 0


def test_recorded_and_found_touches_are_as_many_and_carry_their_channels(tmp_path):
    out = tmp_path / "b.mcap"
    line = ["record", "sim:edge,seed=2", "--label", "stroke", "--part", "torso"]
    recorded = run(*line, "--seconds", 20, "--speed", "inf", "-o", out)
    marks = read_track(out).touches
    assert sum(recorded["touches"].values()) == len(marks) > 3
    assert all(mark.channels for mark in marks)
    found = run("label", out, "--find", "-o", tmp_path / "b.csv")
    assert found["found"] == len(marks)
    assert len(collect([out]).touches) == len(marks)
    named = tmp_path / "n.mcap"
    kept = run("label", out, tmp_path / "b.csv", "--name", "stroke", "-o", named)
    assert sum(kept["touches"].values()) == len(marks)
