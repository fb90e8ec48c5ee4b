"""The demo itself, run end to end on two parts."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import OutputError, SkinWarning
from skinmap.touch.simulation.simulator import simulate
from viewer.demo import training_parts

KEYS = {
    "robot", "parts", "taxels", "meshed_taxels", "patches", "flips", "edge_rms_percent",
    "structures", "accuracy", "seconds", "files",
}  # fmt: skip


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Numbers and folder of a demo on the sole and the forearm."""
    out = tmp_path_factory.mktemp("demo") / "out"
    words = ["demo", "--part", "left_foot", "--part", "right_forearm"]
    words += ["--seed", "3", "--out", str(out), "--json"]
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), out


def test_demo_prints_the_promised_numbers(demo):
    result, _ = demo
    assert set(result) >= KEYS
    assert result["taxels"] == result["meshed_taxels"] == 490
    assert (result["patches"], result["flips"]) == (3, 0)
    assert 0 < result["edge_rms_percent"]["median"] <= result["edge_rms_percent"]["max"] <= 1.4
    assert 0 < result["structures"]["rotated"] < result["structures"]["plain"]
    assert result["normals"]["inward"] == 0
    assert result["trained_on"] == ["left_foot"]
    assert set(result["accuracy"]) == {
        "same_parts", "other_parts", "other_parts_histogram", "other_parts_paper",
    }  # fmt: skip
    # One sole to learn from: far from what 13 parts give, well above the chance of 0.25.
    assert result["accuracy"]["same_parts"] >= 0.75
    assert result["accuracy"]["other_parts"] >= 0.5


def test_demo_writes_every_file_it_lists_and_nothing_else(demo):
    result, out = demo
    found = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert found == set(result["files"])
    assert {"robot.png", "structures.png", "report.html", "demo.json"} <= found
    assert {"flatmaps/left_foot.png", "flatmaps/right_forearm.png"} <= found
    assert json.loads((out / "demo.json").read_text()) == result


def test_report_holds_everything_itself(demo):
    result, out = demo
    page = (out / "report.html").read_text()
    # Four letters of a movie in base64 may well be these.
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "base64,", page)
    assert "http" not in words.replace("http-equiv", "")
    assert page.count("data:image/png;base64,") >= 4
    assert "data:video/mp4;base64," in page or "data:image/gif;base64," in page
    for number in (f"{result['taxels']:,}", f"{100 * result['accuracy']['same_parts']:.1f} %"):
        assert number in page


def test_pictures_show_something(demo):
    import imageio.v3 as iio

    result, out = demo
    for name in result["files"]:
        if Path(name).suffix == ".png":
            picture = iio.imread(out / name)[..., :3]
            assert picture.std() > 10, name
            # Nothing is cut off: the outermost pixels are paper.
            for edge in (picture[0], picture[-1], picture[:, 0], picture[:, -1]):
                assert np.median(edge) > 200, name


def test_replay_is_a_movie_of_some_seconds(demo):
    import imageio_ffmpeg

    result, out = demo
    assert "replay.mp4" in result["files"]
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(out / "replay.mp4"))
    assert 50 <= frames <= 400
    assert seconds == pytest.approx(frames / 25.0, abs=0.1)


def test_demo_without_ffmpeg_has_its_movie_as_a_gif(tmp_path, monkeypatch):
    def few(skin, *, per_gesture, **how):
        """Pokes alone are shown, and ten of each gesture taught."""
        kinds = {"gestures": ["poke"]} if per_gesture == 1 else {}
        return simulate(skin, per_gesture=min(per_gesture, 10), **kinds, **how)

    monkeypatch.setattr("viewer.demo.simulate", few)
    monkeypatch.setattr("viewer.view_files.find_ffmpeg", lambda: None)
    words = ["demo", "--part", "left_foot", "--part", "right_forearm"]
    with pytest.warns(SkinWarning, match=r"replay.gif instead"):
        done = CliRunner().invoke(cli, [*words, "--out", str(tmp_path / "x"), "--json"])
    assert done.exit_code == 0, done.output
    files = json.loads(done.stdout)["files"]
    assert "replay.gif" in files
    assert all((tmp_path / "x" / name).is_file() for name in files)


def test_demo_that_cannot_write_says_so_before_it_works(tmp_path):
    (tmp_path / "file").write_text("")
    words = ["demo", "--out", str(tmp_path / "file" / "x")]
    with pytest.raises(OutputError, match="cannot write to the folder"):
        CliRunner().invoke(cli, words, catch_exceptions=False)


def test_demo_on_one_part_is_refused(tmp_path):
    words = ["demo", "--part", "torso", "--out", str(tmp_path / "x")]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 2
    assert "give two --part" in result.output
    assert not (tmp_path / "x").exists()


def test_training_parts_never_share_a_kind_with_tested_ones(icub):
    trained = training_parts(icub.parts)
    tested = set(icub.parts) - set(trained)
    kinds = {part.split("_", 1)[-1] for part in trained}
    assert trained
    assert tested
    assert not kinds & {part.split("_", 1)[-1] for part in tested}
    assert training_parts(["left_arm", "right_arm"]) == ("left_arm",)


def test_view_writes_a_picture(tmp_path):
    path = tmp_path / "touches.png"
    words = ["view", "icub", "--part", "left_foot", "--screenshot", str(path), "--json"]
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0
    shown = json.loads(result.stdout)
    assert shown["files"] == [str(path)]
    assert [touch["part"] for touch in shown["touches"]] == ["left_foot"]
    assert path.read_bytes().startswith(b"\x89PNG")
