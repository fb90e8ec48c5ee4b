"""Where a skin was touched: planted presses are counted, what hangs and spikes are not."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, MissingFileError, SkinMismatchError, SkinWarning
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.live.touched_taxels import recordings_of, touched_in
from skinmap.touch.prepared_skin import PreparedSkin

RATE = 50.0
PRESSES = ((4.0, 4.5, 100.0), (6.0, 6.6, 160.0), (9.0, 9.4, 120.0))  # begin, end [s], counts


@pytest.fixture(scope="module")
def robot():
    return skinmap.load_robot("kaspar")


@pytest.fixture(scope="module")
def skin(robot):
    return PreparedSkin(robot.skin("torso"))


@pytest.fixture(scope="module")
def spot(skin):
    """A taxel and those around it."""
    distance = np.linalg.norm(skin.skin.positions - skin.skin.positions[100], axis=1)
    return np.argsort(distance)[:7]


def planted(spot, *, gap: float = 0.0, clock: float = 0.0) -> Playback:
    """Twelve seconds with the presses, a taxel that hangs from the first sample and a spike."""
    times = np.arange(600) / RATE
    values = np.zeros((600, 240), np.float32)
    for begin, end, counts in PRESSES:
        values[np.ix_((times >= begin) & (times < end), spot)] = counts
    values[:, 7] = 200.0
    values[250, 200] = 180.0
    times = clock + np.where(times > 8.0, times + gap, times)
    return Playback(
        RecordedStream(StreamInfo("planted", ("torso",), (240,), RATE), times, values), speed=np.inf
    )


def test_touched_counts_planted_presses(robot, skin, spot):
    found = touched_in([Path("a")], robot, {"torso": skin}, lambda _: planted(spot))
    torso = found.parts["torso"]
    assert torso.count[spot].tolist() == [3] * len(spot)
    np.testing.assert_allclose(torso.dwell[spot], 0.5 + 0.6 + 0.4, rtol=0, atol=3.5 / RATE)
    assert torso.largest[spot].tolist() == [160.0] * len(spot)
    np.testing.assert_allclose(torso.last[spot], 9.4, rtol=0, atol=1.5 / RATE)
    others = np.setdiff1d(np.arange(240), spot)
    assert not torso.count[others].any()  # nor the one that hangs, nor the spike
    assert found.seconds == pytest.approx(12.0)


def test_touched_adds_recordings_and_names_the_last(robot, skin, spot):
    paths = [Path("a"), Path("b")]
    found = touched_in(paths, robot, {"torso": skin}, lambda _: planted(spot))
    assert found.parts["torso"].count[spot].tolist() == [6] * len(spot)
    rows = list(csv.DictReader(found.csv().splitlines()))
    channel = str(skin.skin.channels[spot[0]])
    mine = next(row for row in rows if row["channel"] == channel)
    assert (mine["count"], mine["recording"], mine["part"]) == ("6", "b", "torso")
    never = next(row for row in rows if row["count"] == "0")
    assert (never["last_s"], never["recording"]) == ("", "")


@pytest.mark.parametrize(("first", "second", "last"), [(2e9, 1e9, 0), (1e9, 2e9, 1), (2e9, 5, 1)])
def test_the_last_recording_is_that_of_the_latest_clock(robot, skin, spot, first, second, last):
    begins = {"a": first, "b": second}
    made = [Path("a"), Path("b")]
    found = touched_in(made, robot, {"torso": skin}, lambda p: planted(spot, clock=begins[p.name]))
    assert found.parts["torso"].recording[spot].tolist() == [last] * len(spot)
    np.testing.assert_allclose(found.parts["torso"].last[spot], 9.4, rtol=0, atol=1.5 / RATE)


def test_touched_does_not_count_a_gap_as_dwell(robot, skin, spot):
    found = touched_in([Path("a")], robot, {"torso": skin}, lambda _: planted(spot, gap=3600.0))
    assert found.parts["torso"].dwell.max() < 1.7
    assert found.seconds < 12.5


def test_touched_refuses_other_parts(robot, skin, spot):
    info = StreamInfo("other", ("left_foot",), (96,), RATE)
    other = Playback(
        RecordedStream(info, np.arange(3) / RATE, np.zeros((3, 96), np.float32)), speed=np.inf
    )
    with pytest.raises(SkinMismatchError, match="left_foot"):
        touched_in([Path("a")], robot, {"torso": skin}, lambda _: other)


def test_recordings_of_an_empty_folder(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(MissingFileError, match="recordings"):
        recordings_of(tmp_path)


def test_export_touched_writes_a_line_for_each_taxel(tmp_path):
    words = ["record", "sim", "--robot", "kaspar", "--part", "torso", "--seconds", "3"]
    folder = tmp_path / "day"
    folder.mkdir()
    one = folder / "one.mcap"
    assert CliRunner().invoke(cli, [*words, "--speed", "inf", "-o", str(one)]).exit_code == 0
    out = tmp_path / "touched.csv"
    done = CliRunner().invoke(
        cli, ["export", str(folder), "--format", "touched", "-o", str(out), "--json"]
    )
    assert done.exit_code == 0, done.output
    made = json.loads(done.stdout)
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 240
    assert made["recordings"] == ["one.mcap"]
    assert made["parts"][0]["taxels"] == sum(row["count"] != "0" for row in rows) > 0


def test_files_of_a_folder_that_cannot_be_read_are_left_out(robot, tmp_path):
    """A day's folder holds what a crash left: one such file must not hide the others."""
    good = tmp_path / "good.mcap"
    words = ["record", "sim:seed=1", "--robot", "kaspar", "--part", "torso", "--seconds", "2"]
    assert CliRunner().invoke(cli, [*words, "--speed", "inf", "-o", str(good)]).exit_code == 0
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "noise.mcap").write_bytes(b"abc" * 1000)
    np.savez(tmp_path / "foreign.npz", pressure=np.zeros((5, 240)))
    with pytest.warns(SkinWarning, match="left out") as told:
        assert recordings_of(tmp_path) == [good]
    assert {str(one.message).split(": ")[1].rsplit("/", 1)[1] for one in told} == {
        "empty.mcap", "noise.mcap", "foreign.npz",
    }  # fmt: skip
    out = tmp_path / "touched.csv"
    words = ["export", str(tmp_path), "--format", "touched", "-o", str(out), "--json"]
    with pytest.warns(SkinWarning, match="left out"):
        done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["recordings"] == ["good.mcap"]
    good.unlink()
    with pytest.warns(SkinWarning), pytest.raises(DataFormatError):
        recordings_of(tmp_path)


def test_taxel_table_beside_a_mapping_is_no_recording(tmp_path):
    (tmp_path / "mapping.toml").write_text('robot = "kaspar"\npart = "torso"\n')
    (tmp_path / "taxels.csv").write_text("\ufeffchannel,module,x,y,z,nx,ny,nz\n0,0,0,0,0,0,0,1\n")
    samples = tmp_path / "samples.csv"
    samples.write_text("time," + ",".join(map(str, range(240))) + "\n")
    axes = tmp_path / "three_axes.csv"
    axes.write_text("time,x,y,z\n")
    assert recordings_of(tmp_path) == [samples, axes]
