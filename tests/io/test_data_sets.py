"""Recordings as data sets of others: Zarr by its own reader, LeRobot by Parquet's, rosbag2's."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader

from skinmap.cli.main import cli
from skinmap.errors import MissingLibraryError, OutputError
from skinmap.io.recordings.touch_files import save_recordings
from skinmap.live.sources.open_recording import open_track
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
