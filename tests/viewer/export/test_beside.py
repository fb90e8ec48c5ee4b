"""Two recordings in one picture: `skinmap view A --beside B --screenshot FILE`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import SkinError, SkinWarning
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from viewer.drawing.frame import canvas
from viewer.drawing.panel.touch_list import details
from viewer.drawing.skin.skin_view import signs_of
from viewer.export.beside import changed_touch
from viewer.layers import moved_touch, paired_touches, touches_at


def recorded(path: Path, robot: str, part: str, seed: int) -> Path:
    words = ["record", f"sim:seed={seed}", "--robot", robot, "--part", part, "--seconds", "3"]
    done = CliRunner().invoke(cli, [*words, "--speed", "inf", "-o", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("pair")
    return tuple(recorded(folder / f"{seed}.mcap", "kaspar", "torso", seed) for seed in (1, 2))


def view(*words: object) -> dict:
    done = CliRunner().invoke(cli, ["view", *map(str, words), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_beside_shows_two_recordings_and_their_difference(opengl, pair, tmp_path):
    out = tmp_path / "difference.png"
    left, right = pair
    shown = view(left, "--beside", right, "--part", "torso", "--at", "2", "--screenshot", out)
    other = shown["beside"]
    assert (shown["source"], other["source"]) == (str(left), str(right))
    assert shown["time"] == other["time"]
    assert other["difference"]["parts"] == ["torso"]
    assert 0 < other["difference"]["taxels"] <= 240
    assert len(other["difference"]["touches"]) >= max(len(shown["touches"]), len(other["touches"]))
    picture = np.array(Image.open(out))
    assert picture.shape == (1600, 2200, 3)


def test_a_recording_beside_itself_does_not_differ(opengl, pair, tmp_path):
    out = tmp_path / "same.png"
    left = pair[0]
    shown = view(left, "--beside", left, "--part", "torso", "--at", "2", "--screenshot", out)
    found = shown["beside"]["difference"]
    assert (found["taxels"], found["largest"]) == (0, 0.0)
    assert all(one["left"] == one["right"] and not one["moved_mm"] for one in found["touches"])
    picture = np.array(Image.open(out))
    # Below the headings, which name the two.
    np.testing.assert_array_equal(picture[80:800, :1100], picture[80:800, 1100:])


def test_the_difference_calls_stuck_taxels_of_either_side_stuck(
    opengl, pair, tmp_path, monkeypatch
):
    signs = []

    def noted(*words):
        signs.append(signs_of(*words))
        return signs[-1]

    monkeypatch.setattr(canvas, "signs_of", noted)
    one, other = pair  # taxels of the other one hang
    for left, right in ((one, other), (other, one)):
        view(left, "--beside", right, "--part", "torso", "--at", "2", "--screenshot",
             tmp_path / "d.png")  # fmt: skip
        assert set(signs[-1][1]) == {"stuck"}


def test_two_skins_are_both_drawn_without_a_difference(opengl, pair, tmp_path):
    other = recorded(tmp_path / "foot.mcap", "icub", "left_foot", 1)
    out = tmp_path / "two.png"
    shown = view(pair[0], "--beside", other, "--at", "2", "--screenshot", out)
    assert shown["beside"]["difference"] is None
    assert "no skin in common" in shown["beside"]["note"]
    assert shown["beside"]["robot"] == "iCub"
    assert np.array(Image.open(out)).shape == (860, 2200, 3)


def test_another_moment_and_another_model_stand_beside_the_same_recording(opengl, pair, tmp_path):
    from skinmap.recognition.model_file import save_classifier
    from skinmap.recognition.named_classifiers import default_model

    words = (pair[0], "--part", "torso", "--at", "0.5", "--screenshot")
    shown = view(*words, tmp_path / "moments.png", "--beside", "2")["beside"]
    assert shown["time"] == pytest.approx(2.0, abs=0.021)
    assert shown["difference"]["taxels"] > 0
    model = tmp_path / "own.skinmodel"
    save_classifier(default_model(), model)
    shown = view(*words, tmp_path / "models.png", "--beside", model)["beside"]
    assert shown["difference"]["taxels"] == 0
    assert all(one["left"] == one["right"] for one in shown["difference"]["touches"])


def plain(path: Path, times: np.ndarray) -> Path:
    """A plain NPZ at rest but for a press that lasts, which its mapping puts on KASPAR's torso."""
    n = len(skinmap.load_robot("kaspar").skin("torso"))
    values = np.zeros((len(times), n), np.uint8)
    values[5:, 100:106] = 120
    np.savez(path, values=values, times=times)
    path.with_suffix(".toml").write_text('robot = "kaspar"\npart = "torso"\n')
    return path


def test_a_time_without_a_sample_is_told_of(opengl, tmp_path):
    """The last sample lasts as long as a sample does; in a gap the next one is shown and named."""
    times = np.r_[np.arange(50) / 50, 5.0 + np.arange(50) / 50]
    path = plain(tmp_path / "gap.npz", times)
    words = (path, "--screenshot", tmp_path / "g.png", "--at")
    assert view(*words, "5.999")["time"] == pytest.approx(5.98)
    with pytest.warns(SkinWarning, match=r"no sample at 3 s: the one at 5.00 s is shown"):
        assert view(*words, "3")["time"] == pytest.approx(5.0)
    one = plain(tmp_path / "one.npz", np.zeros(1))
    assert view(one, "--screenshot", tmp_path / "g.png", "--at", "0")["time"] == 0.0
    done = CliRunner().invoke(cli, ["view", str(one), "--screenshot", "g.png", "--at", "30"])
    assert "no moment at 30 s: 'one.npz' lasts" in str(done.exception)


def test_two_that_show_different_times_are_told_of(opengl, tmp_path):
    """The right one is shorter than what is shown of the left one."""
    left = plain(tmp_path / "left.npz", np.arange(300) / 50)
    right = plain(tmp_path / "right.npz", np.arange(50) / 50)
    one = plain(tmp_path / "one.npz", np.zeros(1))
    out = tmp_path / "d.png"
    apart = view(left, "--beside", right, "--screenshot", out)
    assert apart["time"] > 1.0 > apart["beside"]["time"]
    assert apart["beside"]["note"].startswith(f"left at {apart['time']:.2f} s, right at 0.")
    assert view(left, "--at", "0.5", "--beside", right, "--screenshot", out)["beside"]["note"] == ""
    alone = view(left, "--beside", one, "--screenshot", out)["beside"]
    assert alone["note"].endswith((f", right at {alone['time'] or 0.0:.2f} s", "no sample"))


def test_the_difference_shows_both_names_and_the_way_between():
    left = NamedTouch("torso", np.array([1]), np.zeros(3), "poke", 0.9)
    right = NamedTouch("torso", np.array([1]), np.ones(3), "tap", 0.8)
    shown = moved_touch(left, right)
    assert shown.label == "poke, right tap"
    np.testing.assert_array_equal(shown.path, [[0, 0, 0], [1, 1, 1]])
    assert moved_touch(left, None).label == "poke, left only"


def test_a_touch_of_another_time_has_the_duration_of_its_own():
    held = NamedTouch("torso", np.array([1]), np.zeros(3), "poke", 0.9, began=6.0)
    for own, now, lasted in ((6.5, 19.0, "0.5 s"), (10.0, 2.0, "4.0 s")):
        (shown,) = touches_at(Moment(own, {}, touches=(held,)), now)
        assert lasted in details(moved_touch(shown, None), now)
    assert touches_at(None, 19.0) == []


def test_touches_pair_that_lie_on_the_same_taxels():
    def touch(label: str, taxels: list[int], x: float, part: str = "torso") -> NamedTouch:
        return NamedTouch(part, np.array(taxels), np.array([x, 0.0, 0.0]), label, 0.9)

    left = [touch("poke", [1, 2], 0.0), touch("hold", [8, 9], 0.1)]
    right = [touch("tap", [9, 10], 0.11), touch("poke", [5], 0.01), touch("rub", [0], 0.0, "foot")]
    changed = [changed_touch(*pair) for pair in paired_touches(left, right)]
    rows = [(one.part, one.left, one.right) for one in changed]
    assert rows == [("torso", "poke", "poke"), ("torso", "hold", "tap"), ("foot", None, "rub")]
    assert changed[1].moved_mm == pytest.approx(10.0)
    alone = paired_touches([touch("disc", [50], 0.2), left[0]], [left[0]])
    assert [one and one.label for _, one in alone] == [None, "poke"], "the first takes not all"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--beside", "none.mcap", "--screenshot", "x.png"], "a recording, a moment"),
        (["--beside", "-3", "--screenshot", "x.png"], "not a moment"),
        (["--beside", "{one}", "--html", "x.html"], "for --screenshot, the window and --web"),
        (["--beside", "{one}", "--screenshot", "x.pdf"], "a picture of pixels"),
    ],
)
def test_beside_refuses_in_one_line(pair, tmp_path, monkeypatch, words, line):
    monkeypatch.chdir(tmp_path)
    given = [word.format(one=pair[1]) for word in words]
    done = CliRunner().invoke(cli, ["view", str(pair[0]), *given])
    assert done.exit_code != 0
    said = str(done.exception) if isinstance(done.exception, SkinError) else done.output
    assert line in said
    assert not list(tmp_path.glob("x.*"))


def test_a_moment_has_the_names_of_a_play_from_the_beginning(opengl, tmp_path):
    held = tmp_path / "held.mcap"  # each touch lasts for longer than what is played before it
    words = ["record", "sim:hold,seed=3", "--robot", "kaspar", "--part", "torso", "--seconds", "8"]
    done = CliRunner().invoke(cli, [*words, "--speed", "inf", "-o", str(held)])
    assert done.exit_code == 0, done.output
    shown = view(held, "--screenshot", tmp_path / "most.png")
    again = view(held, "--at", shown["time"], "--screenshot", tmp_path / "at.png")
    assert again["time"] == pytest.approx(shown["time"], abs=1e-6)
    assert shown["touches"]
    assert again["touches"] == shown["touches"]
