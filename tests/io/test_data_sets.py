"""Recordings as data sets of others: LeRobot by Parquet's reader, rosbag2's by rosbags."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader

from skinmap.cli.main import cli
from skinmap.errors import MissingLibraryError, OutputError
from skinmap.io.recordings.touch_files import save_recordings
from skinmap.live.sources.open_source import open_track
from skinmap.touch.recording import Recording

PART = "left_hand"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, icub):
    """Sixty samples of noise on a hand, of which twenty are a poke."""
    path = tmp_path_factory.mktemp("recorded") / "t.mcap"
    width = len(icub.skin(PART))
    values = np.random.default_rng(0).integers(0, 256, (60, width)).astype(np.uint8)
    events = np.full(60, -1)
    events[20:40] = 0
    touches = Recording(PART, np.arange(60) / 50, values, events, ("poke",), np.zeros(1, int))
    save_recordings(touches, path, robot=icub)
    return path


def export(*words: str):
    return CliRunner().invoke(cli, ["export", *words])


def exported(recorded, format: str, out) -> dict:
    result = export(str(recorded), "--format", format, "-o", str(out), "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_lerobot_has_the_frames_tasks_and_taxels(recorded, tmp_path, icub):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow (skinmap[lerobot]) is missing")
    exported(recorded, "lerobot", tmp_path / "d")
    track = open_track(recorded)
    info = json.loads((tmp_path / "d/meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_frames"]) == ("v3.0", 50, 60)
    path = info["data_path"].format(chunk_index=0, file_index=0)
    frames = parquet.read_table(tmp_path / "d" / path).to_pydict()
    assert set(frames) == set(info["features"])
    np.testing.assert_array_equal(frames[f"observation.tactile.{PART}"], track.values[:])
    np.testing.assert_allclose(frames["timestamp"], track.times, rtol=0, atol=1e-6)
    tasks = parquet.read_table(tmp_path / "d/meta/tasks.parquet").to_pydict()
    said = [tasks["task"][one] for one in frames["task_index"]]
    assert said == ["no touch"] * 20 + [f"poke on {PART}"] * 20 + ["no touch"] * 20
    skin = json.loads((tmp_path / "d/meta/skin.json").read_text())["taxels"][PART]
    np.testing.assert_allclose(skin["positions_m"], icub.skin(PART).positions, rtol=0, atol=1e-9)
    stats = json.loads((tmp_path / "d/meta/stats.json").read_text())
    one = stats[f"observation.tactile.{PART}"]
    np.testing.assert_allclose(one["mean"], track.values[:].mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(one["std"], track.values[:].std(axis=0), rtol=1e-9)


def test_lerobot_holds_angles_and_names_its_times(tmp_path):
    """Angles that come late, channels with gaps, and a rate of 12.5 with a pause of 10 s."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow (skinmap[lerobot]) is missing")
    from skinmap.errors import SkinWarning
    from skinmap.io.recordings.learning import write_lerobot
    from skinmap.io.recordings.recorded_stream import RecordedStream, StreamInfo
    from skinmap.skin.taxels import TaxelTable

    times = np.arange(50) / 12.5 + 10 * (np.arange(50) >= 25)
    angles = np.full((50, 2), -0.7)
    angles[:10] = angles[30] = np.nan
    table = TaxelTable([1, 2, 5], [0, 0, 1], np.eye(3), np.eye(3))
    info = StreamInfo("x", ("pad",), (3,), 0.0)
    track = RecordedStream(info, times, np.zeros((50, 3), np.uint8), joints=("a", "b"),
                           angles=angles, tables={"pad": table})  # fmt: skip
    with pytest.warns(SkinWarning) as said:
        write_lerobot(track, tmp_path / "d")
    assert [str(one.message).split()[0] for one in said] == ["LeRobot", "angles"]
    frames = parquet.read_table(tmp_path / "d/data/chunk-000/file-000.parquet").to_pydict()
    np.testing.assert_allclose(frames["observation.state"], -0.7, atol=1e-6)
    np.testing.assert_array_equal(frames["observation.time"], times)
    features = json.loads((tmp_path / "d/meta/info.json").read_text())["features"]
    assert features["observation.tactile.pad"]["names"] == ["pad_1", "pad_2", "pad_5"]


@pytest.mark.parametrize("kind", ["pressure", "raw"])
def test_an_exported_npz_is_exported_whole_again(kind, tmp_path):
    """Joints, taxels and raw values came back as pressures alone, or were refused."""
    from skinmap.io.recordings.learning import write_npz
    from skinmap.io.recordings.recorded_stream import RecordedStream, StreamInfo
    from skinmap.skin.taxels import TaxelTable

    table = TaxelTable([1, 2, 5], [0, 0, 1], np.eye(3), np.eye(3))
    values = np.random.default_rng(0).integers(0, 200, (50, 3)).astype(np.uint8)
    track = RecordedStream(
        StreamInfo("x", ("pad",), (3,), 50.0, kind), np.arange(50) / 50, values, joints=("a",),
        angles=np.linspace(0, 1, 50)[:, None], tables={"pad": table},
    )  # fmt: skip
    write_npz(track, tmp_path / "a.npz")
    result = export(str(tmp_path / "a.npz"), "-o", str(tmp_path / "b.npz"))
    assert result.exit_code == 0, result.output
    with np.load(tmp_path / "a.npz") as first, np.load(tmp_path / "b.npz") as second:
        assert first.files == second.files
        for name in first.files:
            np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_lerobot_opens_by_its_own_reader(recorded, tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow (skinmap[lerobot]) is missing")
    datasets = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset", reason="lerobot is not installed (2 GB with torch)"
    )
    exported(recorded, "lerobot", tmp_path / "d")
    found = datasets.LeRobotDataset("local/skin", root=tmp_path / "d")
    assert len(found) == 60
    assert found[25]["task"] == f"poke on {PART}"
    values = open_track(recorded).values[:]
    np.testing.assert_array_equal(found[25][f"observation.tactile.{PART}"].numpy(), values[25])


def test_rosbag2_has_a_cloud_for_every_sample(recorded, tmp_path):
    exported(recorded, "rosbag2", tmp_path / "bag")
    with AnyReader([tmp_path / "bag"]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
    assert counts["/skin/pressure"] == counts["/skin/points"] == 60
    assert counts["/skin/touches"] == counts["/robot_description"] == counts["/tf_static"] == 1


def test_folder_that_is_there_and_taxels_as_a_data_set_are_refused(recorded, tmp_path):
    (tmp_path / "d").mkdir()
    (tmp_path / "d/mine.txt").write_text("keep")
    result = export(str(recorded), "--format", "rosbag2", "-o", str(tmp_path / "d"))
    assert isinstance(result.exception, OutputError)
    assert "which this command did not make" in str(result.exception)
    assert [one.name for one in (tmp_path / "d").iterdir()] == ["mine.txt"]
    result = export("icub", "--format", "lerobot", "-o", str(tmp_path / "e"))
    assert result.exit_code == 2
    assert "lerobot is for recordings" in result.output
    assert not (tmp_path / "e").exists()


def test_missing_package_is_one_line(recorded, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    result = export(str(recorded), "--format", "lerobot", "-o", str(tmp_path / "d"))
    assert isinstance(result.exception, MissingLibraryError)  # exit 2 and one line, in `main`
    assert "pip install 'skinmap[lerobot]'" in str(result.exception)
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize("package", ["foxglove", "zenoh"])
def test_missing_package_of_a_stream_is_one_line(monkeypatch, package):
    monkeypatch.setitem(__import__("sys").modules, package, None)
    words = ["simulate", "icub", "--part", PART, "--publish", package, "--seconds", "1"]
    result = CliRunner().invoke(cli, words)
    assert isinstance(result.exception, MissingLibraryError)  # exit 2 and one line, in `main`
    assert f"pip install 'skinmap[{package}]'" in str(result.exception)


@pytest.mark.parametrize("suffix", [".mcap", ".npz"])
def test_contacts_keep_the_marks_of_the_recording(suffix, tmp_path, icub):
    """The table had the names of the shipped model alone."""
    import csv

    from skinmap import simulate

    touches = simulate(icub.skin(PART), gestures=["poke"], per_gesture=1, rng=0)
    named = replace(touches, labels=("a, b",))
    save_recordings(named, tmp_path / f"t{suffix}", robot=icub)
    result = export(
        str(tmp_path / f"t{suffix}"), "--format", "contacts", "-o", str(tmp_path / "c.csv")
    )
    assert result.exit_code == 0, result.output
    with (tmp_path / "c.csv").open(newline="") as file:
        marked = [row["marked"] for row in csv.DictReader(file)]
    assert marked[0] == "a, b"
    assert marked.count("a, b") > len(marked) / 2


def test_statistics_hold_for_times_since_1970():
    """Their deviation was 0."""
    from skinmap.io.recordings.learning import _Statistics

    times, found = 1.7e9 + np.arange(600) / 50.0, _Statistics()
    for block in np.split(times, 3):
        found.add(block)
    assert found.result()["std"][0] == pytest.approx(times.std(), rel=1e-6)
    assert found.result()["mean"][0] == pytest.approx(times.mean(), abs=1e-6)
    assert (found.result()["min"], found.result()["max"]) == ([times[0]], [times[-1]])
