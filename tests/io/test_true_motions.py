"""The truth of simulated motions in the formats of recordings."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, SkinWarning
from skinmap.io.mcap.writing import TOUCHES, McapRecording
from skinmap.io.recordings.marks import Marks
from skinmap.live.sources.open_source import open_track

PART = "left_hand"


@pytest.fixture(scope="module")
def made():
    skin = skinmap.load_robot("kaspar").skin(PART)
    return skinmap.simulate(skin, rng=3, gestures=["stroke", "tap", "poke"], per_gesture=1)


@pytest.fixture
def files(made, tmp_path):
    robot = skinmap.load_robot("kaspar")
    for suffix in (".npz", ".mcap"):
        skinmap.save_recordings(made, tmp_path / f"t{suffix}", robot=robot)
    return tmp_path


def same(one, other, later=0.0) -> None:
    """All of it, to the last bit unless it was moved in time."""
    assert [motion is None for motion in one] == [motion is None for motion in other]
    for left, right in zip(one, other, strict=True):
        if left is not None:
            for name, array in left.shifted(later).to_arrays().items():
                np.testing.assert_allclose(
                    right.to_arrays()[name], array, rtol=0, atol=1e-9 if later else 0
                )


def run(*line: object) -> str:
    found = CliRunner().invoke(cli, [str(word) for word in line])
    assert found.exit_code == 0, found.output
    return found.output


def test_mcap_keeps_what_npz_keeps(made, files):
    truth = {label: one for label, one in zip(made.labels, made.motions, strict=True)}
    assert truth["poke"] is None
    assert len(truth["stroke"].times) > 5
    for suffix in (".npz", ".mcap"):
        (read,) = skinmap.load_recordings(files / f"t{suffix}")
        same(made.motions, read.motions)


@pytest.mark.parametrize("start", [".npz", ".mcap"])
def test_exported_arrays_keep_it(made, files, start):
    run("export", files / f"t{start}", "-o", files / "arrays.npz")
    (read,) = skinmap.load_recordings(files / "arrays.npz")
    same(made.motions, read.motions)
    run("export", files / f"t{start}", "-o", files / "arrays.h5")
    import h5py

    with h5py.File(files / "arrays.h5") as file:
        event = made.labels.index("stroke")
        way = made.motions[event].to_arrays()["way"]
        np.testing.assert_array_equal(file[f"{PART}/motions/{event}/way"][:], way)


def test_a_format_without_it_says_so(files):
    pytest.importorskip("pyarrow")
    track = open_track(files / "t.mcap")
    from skinmap.io.recordings.learning import write_lerobot

    with pytest.warns(SkinWarning, match="does not keep the true motion"):
        write_lerobot(track, files / "set")


@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_marks_keep_it_while_their_times_stay(made, files, suffix):
    table = files / "touches.csv"
    run("label", files / f"t{suffix}", "-o", table, "--robot", "kaspar")
    lines = table.read_text().splitlines()
    stroke = next(k for k, line in enumerate(lines) if ",stroke," in line)
    tap = next(k for k, line in enumerate(lines) if ",tap," in line)
    lines[stroke] = lines[stroke].replace(",stroke,", ",caress,")
    cells = lines[tap].split(",")
    cells[2] = f"{float(cells[2]) + 0.1:.3f}"  # a tap that begins later is another one
    lines[tap] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    out = files / f"named{suffix}"
    run("label", files / f"t{suffix}", table, "-o", out, "--robot", "kaspar")
    (read,) = skinmap.load_recordings(out)
    found = dict(zip(read.labels, read.motions, strict=True))
    own = made.motions[made.labels.index("stroke")]
    same([own], [found["caress"]])
    assert found["tap"] is None
    track = open_track(out)
    caress = next(k for k, one in enumerate(track.touches) if one.motion is not None)
    first = track.touches[caress].first
    parted = Marks(track.touches).split(caress, first + 3)
    assert all(one.motion is None for one in parted.touches)


def test_merged_recordings_move_it_in_time(made, files):
    run("merge", files / "t.npz", files / "t.mcap", "-o", files / "both.mcap")
    (read,) = skinmap.load_recordings(files / "both.mcap")
    count = len(made.labels)
    same(made.motions, read.motions[:count], later=-float(made.times[0]))
    again = read.times[np.flatnonzero(read.events >= count)[0]]
    first = made.times[np.flatnonzero(made.events >= 0)[0]]
    same(made.motions, read.motions[count:], later=float(again - first))


def test_damaged_motions_are_refused(made, files):
    damaged = files / "damaged.mcap"
    file = McapRecording(damaged, parts=[PART], widths={"pressure": [made.pressures.shape[1]]})
    for row in range(3):
        file.add("pressure", row / 50.0, made.pressures[row])
    content = {"part": PART, "event": 0, "label": "stroke", "began_s": 0.0, "ended_s": 0.02}
    content["motion"] = {"presses": [[0.0, 0.02]], "way": [[0.0, 1.0]], "turned": [0.0]}
    from skinmap.io.ros2.messages import text_message

    file._message(TOUCHES, 20_000_000, text_message(json.dumps(content)), 0)
    file.close()
    with pytest.raises(DataFormatError, match="motion of touch 0"):
        skinmap.load_recordings(damaged)


def test_recordings_without_truth_have_none(made, files):
    still = replace(made, motions=())
    skinmap.save_recordings(still, files / "still.mcap", robot=skinmap.load_robot("kaspar"))
    assert skinmap.load_recordings(files / "still.mcap")[0].motions == ()
