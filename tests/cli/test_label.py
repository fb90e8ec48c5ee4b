"""Marks are edited by keys and by CSV, recordings are merged, and old files stay as they are."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import InvalidArrayError, SkinError
from skinmap.io.mcap.reading import read_track
from skinmap.io.recordings.marks import Marks
from skinmap.io.recordings.recorded_stream import MarkedTouch
from skinmap.touch.recording import Recording


def call(*words, keys=None):
    return CliRunner().invoke(cli, [*map(str, words)], input=keys)


def run(*words, keys=None):
    result = call(*words, "--json", keys=keys)
    assert result.exit_code == 0, (result.output, result.exception)
    return json.loads(result.stdout)


def refuse(*words, keys=None) -> str:
    result = call(*words, keys=keys)
    assert isinstance(result.exception, SkinError | SystemExit), result.output
    text = result.output if isinstance(result.exception, SystemExit) else str(result.exception)
    return " ".join(text.split())


@pytest.fixture(scope="module")
def marked(tmp_path_factory):
    """Raw values and pressures of ten seconds, with their marks."""
    path = tmp_path_factory.mktemp("label") / "t.mcap"
    run("record", "sim:raw", "-o", path, "--part", "left_hand", "--seconds", 12, "--speed", "inf",
        "--label", "rub", "--session", "monday", "--person", "ada")  # fmt: skip
    return path


def spans(path):
    return [(one.first, one.last, one.label) for one in Marks(read_track(path).touches).touches]


def test_a_script_names_all_touches_without_a_key(marked, tmp_path):
    made = run("label", marked, "--find", "--name", "jab", "-o", tmp_path / "new.mcap")
    assert made["touches"] == {"jab": made["found"]}
    assert {label for *_, label in spans(tmp_path / "new.mcap")} == {"jab"}


def test_marks_that_are_edited_stay_messages_that_ros_2_reads(marked, tmp_path):
    run("label", marked, "-o", tmp_path / "new.mcap", keys="n jab\nw\n")
    with AnyReader([tmp_path / "new.mcap"]) as reader:
        (touches,) = [one for one in reader.connections if one.topic == "/skin/touches"]
        told = [
            json.loads(reader.deserialize(data, one.msgtype).data)
            for one, _, data in reader.messages([touches])
        ]
    assert told[0]["label"] == "jab"
    assert len(told) == len(spans(marked))


def test_keys_name_split_join_delete_and_undo(marked, tmp_path):
    before, bytes_before = spans(marked), marked.read_bytes()
    keys = "n jab\ns 0.1\nj\ns\nu\nd\nu\nx\nn\n\nd\nw\n"
    told = run("label", marked, "-o", tmp_path / "new.mcap", keys=keys)
    after = spans(tmp_path / "new.mcap")
    expected = [(*before[0][:2], "jab"), before[1], *before[3:]]
    assert after == expected
    assert told["touches"] == {"jab": 1, "rub": len(before) - 2}
    assert marked.read_bytes() == bytes_before
    old, new = read_track(marked, kind="raw"), read_track(tmp_path / "new.mcap", kind="raw")
    np.testing.assert_array_equal(old.values[:], new.values[:])
    kept = read_track(tmp_path / "new.mcap").touches
    assert {(one.session, one.person) for one in kept} == {("monday", "ada")}


@pytest.mark.parametrize("keys", ["q\n", "n jab\n"])
def test_ending_without_w_writes_nothing(marked, tmp_path, keys):
    assert "nothing was written" in refuse("label", marked, "-o", tmp_path / "n.mcap", keys=keys)
    assert not list(tmp_path.iterdir())


def test_a_csv_that_nobody_changed_changes_nothing(marked, tmp_path):
    run("label", marked, "-o", tmp_path / "t.csv")
    run("label", marked, tmp_path / "t.csv", "-o", tmp_path / "same.mcap")
    assert Marks(read_track(tmp_path / "same.mcap").touches) == Marks(read_track(marked).touches)


def test_rows_of_a_csv_are_the_touches(marked, tmp_path):
    run("label", marked, "-o", tmp_path / "t.csv")
    lines = (tmp_path / "t.csv").read_text().splitlines()
    named = lines[1].replace(",rub,", ",tap,")
    (tmp_path / "t.csv").write_text("\n".join([lines[0], named, *lines[3:]]))
    told = run("label", marked, tmp_path / "t.csv", "-o", tmp_path / "new.npz")
    assert told["touches"] == {"rub": len(lines) - 3, "tap": 1}
    (one,) = skinmap.load_recordings(tmp_path / "new.npz")
    assert sorted(one.labels) == ["rub"] * (len(lines) - 3) + ["tap"]
    assert set(one.people) == {"ada"}


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda row: row.replace("rub", ""), "2: a label is empty"),
        (lambda row: row.replace("rub", "a\x07b"), "2: a label without control characters"),
        (lambda row: row.replace("left_hand", "tail"), "2: no part 'tail'"),
        (lambda row: row.replace(",rub", ",rub,more"), "2: 8 cells for 7 columns"),
        (lambda row: f"left_hand,9,5,4,rub,,\n{row}", "2: no sample from 5 to 4 s"),
        (
            lambda row: f"left_hand,9,1700000005.5,1700000006,rub,,\n{row}",
            "2: no sample from 1700000005.5 to 1700000006 s; the recording has those from",
        ),
        (lambda row: f"{row}\n{row}", "3: overlaps the touch"),
    ],
)
def test_rows_that_cannot_be_are_named_by_their_line(marked, tmp_path, change, match):
    run("label", marked, "-o", tmp_path / "t.csv")
    head, row, *_ = (tmp_path / "t.csv").read_text().splitlines()
    (tmp_path / "t.csv").write_text(f"{head}\n{change(row)}\n")
    message = refuse("label", marked, tmp_path / "t.csv", "-o", tmp_path / "n.mcap")
    assert f"t.csv:{match}" in message
    assert not (tmp_path / "n.mcap").exists()


def test_touches_that_nobody_marked_are_found(tmp_path):
    plain, named = tmp_path / "plain.mcap", tmp_path / "named.mcap"
    words = ["sim", "--part", "left_hand", "--seconds", 12, "--speed", "inf", "-o"]
    run("record", *words, plain)
    run("record", *words, named, "--label", "rub")
    told = run("label", plain, "-o", tmp_path / "t.csv")
    assert (told["before"], told["touches"], told["unnamed"]) == (0, {}, told["found"])
    run("label", plain, tmp_path / "t.csv", "--name", "rub", "-o", tmp_path / "new.mcap")
    assert spans(tmp_path / "new.mcap") == spans(named)


def test_nothing_is_written_over(marked, tmp_path):
    (tmp_path / "there.mcap").write_bytes(b"precious")
    for words in (["label", marked, "-o"], ["merge", marked, "-o"]):
        assert "is there already" in refuse(*words, tmp_path / "there.mcap", keys="w\n")
        assert "cannot write" in refuse(*words, marked, "--force", keys="w\n")
    assert (tmp_path / "there.mcap").read_bytes() == b"precious"
    assert "'-o'" in refuse("label", marked)


def mark(first, last, event=0, label="a"):
    return MarkedTouch("p", event, label, first, last)


def test_split_and_join_are_each_others_reverse():
    marks = Marks((mark(5, 9), mark(20, 30, 1)))
    assert Marks(marks.split(0, 7).touches).join(0) == marks
    with pytest.raises(InvalidArrayError, match="cannot be split at 5"):
        marks.split(0, 5)
    with pytest.raises(InvalidArrayError, match="no later touch"):
        marks.join(1)


def recorded(labels, *, taxels=4, rate=50.0, robot="", session="", part="p"):
    """A touch of two samples for each label, a sample of rest between."""
    events = np.concatenate([[-1, k, k] for k in range(len(labels))])
    rng = np.random.default_rng(len(labels))
    return Recording(
        part, np.arange(len(events)) / rate, rng.integers(0, 9, (len(events), taxels), np.uint8),
        events, tuple(labels), robot=robot, sessions=(session,) * len(labels),
    )  # fmt: skip


def saved(path, recording):
    skinmap.save_recordings(recording, path)
    return path


def test_merge_keeps_samples_touches_and_sessions(tmp_path):
    one, other = recorded(["a", "b"]), recorded(["b"], session="evening")
    files = [saved(tmp_path / f"{name}.npz", each) for name, each in (("x", one), ("y", other))]
    told = run("merge", *files, "-o", tmp_path / "all.npz")
    (both,) = skinmap.load_recordings(tmp_path / "all.npz")
    np.testing.assert_array_equal(both.pressures, np.concatenate([one.pressures, other.pressures]))
    assert both.events.tolist() == [-1, 0, 0, -1, 1, 1, -1, 2, 2]
    assert both.sessions == ("x", "x", "evening")
    assert (np.diff(both.times) > 0).all()
    assert told["touches"] == {"a": 1, "b": 2}
    assert told["sessions"] == {"x": 2, "evening": 1}


def test_merge_lays_different_parts_one_after_the_other(tmp_path):
    pad, sleeve = recorded(["a", "b"], part="pad"), recorded(["a"], part="sleeve", taxels=3)
    later = replace(pad, times=pad.times + 1.7e9)  # on a clock of Unix time
    skinmap.save_recordings([pad, sleeve], tmp_path / "x.npz")
    files = tmp_path / "x.npz", saved(tmp_path / "y.npz", sleeve), saved(tmp_path / "z.npz", later)
    run("merge", *files, "-o", tmp_path / "all.npz")
    found = {one.part: one.times for one in skinmap.load_recordings(tmp_path / "all.npz")}
    ends = pad.times[-1] + 1.0, pad.times[-1] + sleeve.times[-1] + 2.0
    np.testing.assert_allclose(found["sleeve"], [*sleeve.times, *(sleeve.times + ends[0])])
    np.testing.assert_allclose(found["pad"], [*pad.times, *(pad.times + ends[1])], atol=1e-6)
    said = refuse("merge", *files, "-o", tmp_path / "all.mcap")
    assert "y.npz holds sleeve, " in said


@pytest.mark.parametrize(
    ("other", "match"),
    [
        ({"taxels": 5}, "another skin"),
        ({"rate": 100.0}, "100 samples a second, x 50: they do not follow each other"),
        ({"robot": "kaspar"}, "recordings of several robots"),
    ],
)
def test_merge_refuses_what_does_not_belong_together(tmp_path, other, match):
    one = saved(tmp_path / "x.npz", recorded(["a"], robot="icub"))
    two = saved(tmp_path / "y.npz", recorded(["a"], **{"robot": "icub", **other}))
    assert match in refuse("merge", one, two, "-o", tmp_path / "all.npz")
    assert not (tmp_path / "all.npz").exists()


def test_help_shows_its_examples_line_by_line():
    said = CliRunner().invoke(cli, ["label", "--help"]).stdout
    assert "\\b" not in said
    assert sum("skinmap label touch.mcap" in line for line in said.splitlines()) == 3


def test_merge_refuses_a_recording_that_is_given_twice(marked, tmp_path):
    said = refuse("merge", marked, marked, "-o", tmp_path / "all.mcap")
    assert f"given twice: {marked}" in said


def test_classify_says_that_the_model_comes_first():
    said = refuse("classify", "t.npz", "m.skinmodel")
    assert "the model comes first: m.skinmodel t.npz" in said


def stamped(path, times, *, part="left_hand", rate=50.0):
    """A plain NPZ with three presses of a second at 2, 4 and 6 s of the samples' own clock."""
    skin = skinmap.load_robot("kaspar").skin(part)
    own = np.arange(round(8 * rate)) / rate
    away = np.linalg.norm(skin.positions - skin.positions[20], axis=1)
    press = np.exp(-0.5 * (away / 8e-3) ** 2)
    height = sum(150.0 * ((own >= t) & (own < t + 1.0)) for t in (2.0, 4.0, 6.0))
    values = np.rint(height[:, None] * press).astype(np.uint8)
    np.savez(path, values=values, times=times(own), channels=skin.channels)
    path.with_suffix(".toml").write_text(f'robot = "kaspar"\npart = "{part}"\n')
    return own


@pytest.mark.parametrize("step", [0.04, 0.1])
def test_touches_are_found_where_samples_share_a_time(tmp_path, step):
    """Times rounded by the writer: what the loop leaves out must not shift the rows of a mark."""
    path, out = tmp_path / "coarse.npz", tmp_path / "t.csv"
    stamped(path, lambda own: np.floor(own / step + 1e-9) * step)
    run("label", path, "-o", out)
    rows = [line.split(",") for line in out.read_text().splitlines()[1:]]
    began = [float(row[2]) for row in rows]
    np.testing.assert_allclose(began, [2.0, 4.0, 6.0], rtol=0, atol=0.1)
    np.testing.assert_allclose([float(row[3]) for row in rows], [3.0, 5.0, 7.0], rtol=0, atol=0.11)


def test_a_table_of_touches_at_two_kilohertz_is_read_back(tmp_path):
    """Neighbouring samples lie half a millisecond apart: times need more digits."""
    path, table, out = tmp_path / "fast.npz", tmp_path / "t.csv", tmp_path / "o.npz"
    own = stamped(path, lambda own: own, rate=2000.0)
    run("label", path, "-o", table)
    rows = [line.split(",") for line in table.read_text().splitlines()[1:]]
    run("label", path, table, "--name", "poke", "-o", out)
    (after,) = skinmap.load_recordings(out)
    held = [np.flatnonzero(after.events == k)[[0, -1]] for k in range(3)]
    np.testing.assert_allclose(own[held], [[float(one) for one in row[2:4]] for row in rows])
