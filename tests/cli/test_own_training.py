"""Training on touches of one's own, and judging it: sessions, people, robots, leaks."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import SkinError, SkinWarning
from skinmap.recognition.classifier import DEFAULT, classifiers
from skinmap.recognition.descriptors import ContactGeometry, recorded_touches
from skinmap.recognition.evaluate import score
from skinmap.touch.recording import Recording

ROBOT = Path(__file__).parents[2] / "docs" / "examples" / "robot"
KINDS = ("poke", "full_finger")


def run(*words):
    result = CliRunner().invoke(cli, [*map(str, words), "--json"])
    assert result.exit_code == 0, (result.output, result.exception)
    return json.loads(result.stdout)


def refuse(*words) -> str:
    result = CliRunner().invoke(cli, [*map(str, words)])
    assert isinstance(result.exception, SkinError | SystemExit), result.output
    text = result.output if isinstance(result.exception, SystemExit) else str(result.exception)
    return " ".join(text.split())


def touched(robot, part, seed, *, kinds=KINDS, count=6, **said) -> Recording:
    skin = skinmap.load_robot(robot).skin(part)
    one = skinmap.simulate(skin, gestures=kinds, per_gesture=count, rng=seed, variety=0)
    words = {key: (word,) * len(one.labels) for key, word in said.items()}
    return replace(one, robot=robot, subjects=np.zeros(len(one.labels), np.int64), **words)


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Two days on one part, each by one person, and one on another robot."""
    folder = tmp_path_factory.mktemp("own")
    for day, who, seed in (("monday", "ada", 1), ("tuesday", "ben", 2)):
        one = touched("kaspar", "torso", seed, sessions=day, people=who)
        skinmap.save_recordings(one, folder / f"{day}.npz")
    other = touched("icub", "left_arm", 3, sessions="tuesday", people="ben")
    skinmap.save_recordings(other, folder / "other.npz")
    return folder


def test_a_recording_says_which_robot_it_is_of(days):
    assert run("info", days / "monday.npz")["skin"]["robot"] == "kaspar"


@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_touches_of_another_layout_of_as_many_taxels_are_refused(tmp_path, suffix):
    """The channels changed since: every touch would be somewhere else."""
    shutil.copytree(ROBOT, tmp_path / "bot")
    words = ["--per-gesture", 6, "--gesture", "poke", "--gesture", "pat"]
    path = tmp_path / f"t{suffix}"
    run("simulate", tmp_path / "bot/robot.toml", *words, "-o", path)
    assert skinmap.load_recordings(path)[0].fingerprint
    run("train", path, "-o", tmp_path / "before.skinmodel")
    table = tmp_path / "bot/forearm.csv"
    head, *rows = table.read_text().splitlines()
    numbers = [row.split(",")[0] for row in rows]
    rows = [",".join([k, *row.split(",")[1:]]) for k, row in zip(numbers[::-1], rows, strict=True)]
    table.write_text("\n".join([head, *rows]) + "\n")
    message = refuse("train", path, "-o", tmp_path / "after.skinmodel")
    assert "recorded on another skin" in message


def test_touches_that_find_no_room_are_told(tmp_path):
    """A whole hand hardly fits on the back of a child's: too few came, and nothing said why."""
    words = ["simulate", "kaspar", "--part", "left_hand", "--per-gesture", "12", "-o"]
    result = CliRunner().invoke(cli, [*words, str(tmp_path / "t.npz")])
    assert "12 poke," in result.output
    assert "whole_hand (12 do not fit)" in result.output


def test_folders_of_several_robots_are_trained_on(days, tmp_path):
    told = run("train", days, "-o", tmp_path / "m.skinmodel", "--with-simulated", 4)
    assert [(one["robot"], one["part"]) for one in told["skins"]] == [
        ("KASPAR", "torso"), ("iCub", "left_arm"),
    ]  # fmt: skip
    assert told["sessions"] == {"monday": 12, "tuesday": 24}
    assert told["people"] == {"ada": 12, "ben": 24}
    assert told["simulated"] == {"full_finger": 8, "poke": 8}
    assert told["warnings"] == []
    model = skinmap.Classifier.load(tmp_path / "m.skinmodel")
    assert sorted(one.part for one in model.trained_on) == ["left_arm", "torso"]


def test_five_touches_a_label_are_enough_and_each_is_tested_unseen(tmp_path):
    few = touched("kaspar", "torso", 5, count=5)
    skinmap.save_recordings(few, tmp_path / "few.npz")
    told = run("train", tmp_path / "few.npz", "-o", tmp_path / "m.skinmodel")
    assert (told["touches"], told["tested"]["same_parts"]) == (10, 10)
    assert told["tested_by"] == "cross_validation"
    assert told["accuracy"]["same_parts"] >= 0.7
    # Labels that mean nothing are named no better than by chance, whatever the model has learnt.
    mixed = np.random.default_rng(0).permutation(few.labels)
    skinmap.save_recordings(replace(few, labels=tuple(map(str, mixed))), tmp_path / "mixed.npz")
    told = run("train", tmp_path / "mixed.npz", "-o", tmp_path / "m.skinmodel")
    assert told["accuracy"]["same_parts"] <= 0.7


def test_settings_of_a_classifier_come_from_a_profile(tmp_path):
    skinmap.save_recordings(touched("kaspar", "torso", 5, count=5), tmp_path / "few.npz")
    profile = tmp_path / "settings.toml"
    text = f'[profile]\nformat = 1\nskinmap = "{skinmap.__version__}"\n\n[classify]\nwords = 5\n'
    words = ["train", tmp_path / "few.npz", "--profile", profile, "--force"]
    words += ["-o", tmp_path / "m.skinmodel", "--classifier", "histogram"]
    profile.write_text(text)
    assert run(*words)["settings"] == {"words": 5}
    profile.write_text(text + 'classifier = "paper"\n')  # not the one that is trained
    assert run(*words)["settings"] == {}


def test_labels_of_one_session_are_warned_of(tmp_path):
    for label, seed in zip(KINDS, (1, 2), strict=True):
        one = touched("kaspar", "torso", seed, kinds=(label,))
        skinmap.save_recordings(one, tmp_path / f"{label}.npz")
    told = run("train", *(tmp_path / f"{label}.npz" for label in KINDS), "-o", tmp_path / "m")
    assert any("one session only: poke (poke), full_finger" in word for word in told["warnings"])


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (["train", "empty"], "expected a folder with recordings"),
        (["train", "one.npz", "--with-simulated", "3"], "none of jab, slap is simulated"),
        (["train", "alone.npz"], "two labels or more; marked are: 12 poke;"),
        (["train", "one.npz", "--part", "tail"], "no recorded part 'tail'"),
        (["train", "one.npz", "--robot", "icub"], "the skin of iCub has"),
        (["evaluate", "one.npz", "--leave-out", "weather"], "'weather' is not one of"),
        (["evaluate", "--protocol", "kaspar", "--leave-out", "part"], "has its own splits"),
        (["evaluate", "unmarked.npz"], "no marked touch in the recordings"),
    ],
)
def test_what_cannot_be_trained_or_judged_is_said_in_one_line(tmp_path, monkeypatch, words, match):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    one = touched("kaspar", "torso", 1)
    other = {"poke": "jab", "full_finger": "slap"}
    named = replace(one, labels=tuple(other[label] for label in one.labels))
    skinmap.save_recordings(named, "one.npz")
    skinmap.save_recordings(replace(one, labels=("poke",) * len(one.labels)), "alone.npz")
    idle = np.full(len(one.events), -1)
    nobody = {"subjects": np.zeros(0, int), "sessions": (), "people": ()}
    skinmap.save_recordings(replace(one, labels=(), events=idle, **nobody), "unmarked.npz")
    assert match in refuse(*words)
    assert not (tmp_path / "touch.skinmodel").exists()


def at_rest(one: Recording, pattern: np.ndarray) -> Recording:
    """A recording whose taxels rest at a pattern."""
    pressures = np.maximum(one.pressures, pattern[None].astype(np.uint8))
    return replace(one, pressures=pressures)


def judged(folder, *words):
    files = sorted(folder.glob("*.npz"))
    told = run("evaluate", *files, "--leave-out", "event", "--seeds", 1, "--set", "folds=3", *words)
    return {row["left_out"]: row for row in told["left_out"]}, told


def test_a_resting_pattern_that_names_the_label_is_found(tmp_path):
    """Each label of each day rests otherwise: no figure with touches dealt out means anything."""
    rng = np.random.default_rng(0)
    taxels = len(skinmap.load_robot("kaspar").skin("torso"))
    for day in ("monday", "tuesday"):
        for label in KINDS:
            one = touched("kaspar", "torso", int(rng.integers(99)), kinds=(label,), sessions=day)
            pattern = np.where(rng.random(taxels) < 0.05, 40, 0)
            skinmap.save_recordings(at_rest(one, pattern), tmp_path / f"{day}_{label}.npz")
    rows, _ = judged(tmp_path, "--leave-out", "session")
    assert rows["event"]["meaning"] == "no"
    assert "means nothing" in rows["event"]["verdict"]
    assert min(rows["event"]["control"], rows["event"]["raw"]) > 0.9
    assert rows["session"]["meaning"] == "yes"
    assert rows["session"]["raw"] < 0.8


def test_clean_recordings_mean_something_under_every_split(days):
    rows, told = judged(days, "--leave-out", "session", "--leave-out", "person", "--leave-out",
                        "place", "--leave-out", "part")  # fmt: skip
    assert list(rows) == ["event", "session", "person", "place", "part"]
    assert {row["meaning"] for row in rows.values()} == {"yes"}
    assert all(row["mean"] > 0.6 for row in rows.values())
    assert rows["place"]["groups"] == 8
    assert told["sessions"] == {"monday": 12, "tuesday": 24}


def test_a_label_of_one_session_cannot_be_judged_by_leaving_it_out(tmp_path):
    for label, seed in zip(KINDS, (1, 2), strict=True):
        one = touched("kaspar", "torso", seed, kinds=(label,))
        skinmap.save_recordings(one, tmp_path / f"{label}.npz")
    rows, _ = judged(tmp_path, "--leave-out", "session", "--leave-out", "person")
    assert rows["session"]["mean"] is None
    assert "touches of one session only: full_finger (full_finger)" in rows["session"]["verdict"]
    assert "the person of 12 touches is not known" in rows["person"]["verdict"]
    assert rows["event"]["meaning"] == "doubtful"


def of_people_left_out(touches, count, *, seed, mixed=False):
    """Mean of the classes, of people left out, by a model of `count` touches a class."""
    rng = np.random.default_rng(seed)
    people = rng.permutation(sorted({touch.person for touch in touches}))
    learn = set(people[: len(people) // 2].tolist())
    own = [touches[k] for k in rng.permutation(len(touches)) if touches[k].person in learn]
    # Nobody marks what the skin did not feel; in the test it counts as wrong.
    own = [touch for touch in own if len(ContactGeometry().describe(touch))]
    labels = [name for name, have in Counter(t.label for t in own).items() if have >= 5]
    train = [one for name in labels for one in [t for t in own if t.label == name][:count]]
    if mixed:
        words = rng.permutation([one.label for one in train])
        train = [replace(t, label=str(w)) for t, w in zip(train, words, strict=True)]
    model = classifiers.get(DEFAULT)().fit(train, rng=rng)
    judged = [t for t in touches if t.person not in learn and t.label in labels]
    return float(np.mean(list(score(model, judged).per_label.values())))


def test_few_touches_a_class_name_those_of_other_people(prepared):
    skin = prepared("left_hand")
    made = skinmap.simulate(skin.skin, rng=0, per_gesture=40)
    touches = recorded_touches(skin, replace(made, people=tuple(map(str, made.subjects))))
    five, twenty = (
        np.mean([of_people_left_out(touches, count, seed=seed) for seed in (0, 1)])
        for count in (5, 20)
    )
    assert five >= 0.7  # 0.86 over 20 trials, 0.06 from trial to trial
    assert twenty >= 0.8  # 0.91
    mixed = [of_people_left_out(touches, 5, seed=seed, mixed=True) for seed in (0, 1)]
    assert np.mean(mixed) <= 0.45  # chance is 0.25


@pytest.mark.parametrize("seed", range(6))
def test_what_chance_holds_out_leaves_enough_of_each_label(seed):
    """Nine touches of a label: a third held out at random may leave four."""
    from types import SimpleNamespace

    from skinmap.recognition.evaluate import CALIBRATION_FOLDS, is_few

    rng = np.random.default_rng(seed)
    touches = [SimpleNamespace(label=label) for label in "ab" for _ in range(9)]
    held = rng.permutation(18) < 0.3 * 18
    train = [one for one, out in zip(touches, held, strict=True) if not out]
    same = [one for one, out in zip(touches, held, strict=True) if out]
    least = min(sum(one.label == label for one in train) for label in "ab")
    assert is_few(train, same) == (least < CALIBRATION_FOLDS)
    assert is_few(touches[:8] + touches[9:17])
    assert not is_few(touches)


def test_a_rare_label_that_is_missed_is_named_beside_the_share_of_all(tmp_path):
    one = touched("kaspar", "torso", 4, kinds=("poke",), count=30, sessions="monday")
    labels = tuple("odd" if k % 5 == 0 else "poke" for k in range(len(one.labels)))  # alike
    skinmap.save_recordings(replace(one, labels=labels), tmp_path / "t.npz")
    words = ["train", str(tmp_path / "t.npz"), "-o", str(tmp_path / "m.skinmodel")]
    found = run(*words)
    assert found["accuracy"]["same_parts"] > 0.7
    assert found["per_label"]["odd"] < 0.5
    said = CliRunner().invoke(cli, [*words, "--force"]).output
    assert "labels differ: " in said
    assert "odd" in said.partition("in the mean of labels")[2]


def test_a_recording_without_samples_is_named_and_breaks_nothing(tmp_path):
    skin = skinmap.load_robot("icub").skin("left_foot")
    none, rows = np.zeros(0), np.zeros((0, len(skin)), np.uint8)
    path = tmp_path / "none.npz"
    skinmap.save_recordings(
        [Recording("left_foot", none, rows, none.astype(int), (), robot="icub")], path
    )
    assert "two labels or more; marked are: none" in refuse(
        "train", path, "-o", tmp_path / "m.skinmodel"
    )
    with pytest.warns(SkinWarning, match="no samples"):
        assert "0 touches in 0 samples" in CliRunner().invoke(cli, ["classify", str(path)]).output


def test_raw_values_are_not_asked_about_other_parts(days, tmp_path):
    """Taxels are read by number: those of another part have nothing to do with them."""
    model = tmp_path / "raw.skinmodel"
    told = run("train", days, "--part", "torso", "--classifier", "raw-rbf", "-o", model)
    assert told["accuracy"]["other_parts"] is None
    assert told["warnings"] == [
        "raw-rbf reads taxels by number; not tested on other parts: left_arm"
    ]
    assert model.exists()
