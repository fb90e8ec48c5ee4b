"""Recordings with one planted fault each: kind and place; clean and damaged ones."""

from __future__ import annotations

import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat

import skinmap
from benchmarks.reliability.planted_faults import PLANTS, Made, meets, sheet, track
from skinmap.cli.main import cli
from skinmap.clock_lines import align
from skinmap.errors import DataFormatError
from skinmap.io.recordings.touch_files import read_recordings
from skinmap.soundness.channel_faults import channel_faults
from skinmap.soundness.examination import examine_track, examine_tracks, mend
from skinmap.soundness.finding import HARM, KINDS
from skinmap.soundness.set_faults import DOUBTED, MISTAKEN, _tail
from skinmap.soundness.survey import survey
from skinmap.soundness.track import Track, read_track

INSOLE = Path(__file__).resolve().parents[3] / "shared" / "data" / "insole"
EASY = 3  # of each fault: a skin that the generator draws may hide it


def planted(kind: str, number: int) -> Made:
    """A recording with a fault."""
    rng = np.random.default_rng([77, number])
    made = sheet(rng)
    made.kind = kind
    PLANTS[kind](made, rng)
    return made


@pytest.mark.parametrize("kind", PLANTS)
def test_a_planted_fault_is_found_at_its_place(kind):
    several = [planted(kind, number) for number in range(EASY)]
    found = [examine_track(track(made))[0].findings for made in several]
    hits = [any(meets(one, made) for one in own) for made, own in zip(several, found, strict=True)]
    # The benchmark asks for 95 % of many; of three the generator may draw one that hides it.
    assert sum(hits) >= EASY - 1


@pytest.mark.parametrize(("robot", "part"), [("icub", "left_foot"), ("kaspar", "torso")])
@pytest.mark.parametrize("seed", [1, 2])
def test_clean_touches_that_follow_each_other_closely_have_no_finding(robot, part, seed):
    skin = skinmap.load_robot(robot).skin(part)
    made = skinmap.simulate(skin, per_gesture=5, variety=0.0, rng=seed)
    assert made.pressures.max() == 255  # some touches are as strong as the sensor tells
    own = examine_track(Track("clean", made.pressures, made.times))[0].findings
    assert [one.text for one in own] == []


def test_clean_touches_of_another_physics_have_no_finding():
    pytest.importorskip("mujoco", reason="the extra `mujoco` is not installed")
    from skinmap.physics.simulation import simulate

    skin = skinmap.load_robot("icub").skin("left_leg_upper")
    rng = np.random.default_rng(12)
    made = simulate(skin, rng=rng, per_gesture=3, variant="foam", variety=0.0)
    own = examine_track(Track("clean", made.pressures, made.times))[0].findings
    assert [one.text for one in own] == []


def test_a_module_that_hangs_has_its_own_channels_and_rows():
    skin = skinmap.load_robot("icub").skin("left_foot")
    made = skinmap.simulate(skin, per_gesture=5, variety=0.0, rng=4)
    values, channels = made.pressures.copy(), np.flatnonzero(skin.modules == skin.modules[120])
    values[400:800, channels] = values[400, channels]
    own = examine_track(Track("hung", values, made.times))[0].findings
    assert [(one.kind, one.channels) for one in own] == [("module", channels.tolist())]
    # A taxel at rest may read the same a few rows longer; all of them do not.
    ((first, last),) = own[0].rows
    assert abs(first - 400) <= 2
    assert abs(last - 799) <= 2


def test_coarse_channels_are_not_copies_of_each_other():
    values = noise(2000, 60)
    coarse = [7, 20, 41]
    values[:, coarse] = np.rint(values[:, coarse] / 4.0) * 4.0
    own = examine_track(Track("coarse", values, np.arange(2000) / 50))[0].findings
    assert "copied" not in [one.kind for one in own]


def test_every_kind_has_its_harm_and_remedy():
    assert set(HARM) == set(KINDS)


def test_a_recording_that_is_silent_at_rest_has_no_duplicates():
    values = np.zeros((1000, 20), np.uint8)
    for start in range(50, 900, 100):
        values[start : start + 40, 3:9] = (100 * np.hanning(40))[:, None]
    own = examine_track(Track("silent", values, np.arange(1000) / 50))[0].findings
    assert "duplicate" not in [one.kind for one in own]


def noise(count: int = 1000, width: int = 12) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(count, width))


def test_two_files_with_the_same_rows_are_named_together():
    values = noise()
    one = Track("a", values[:800], np.arange(800) / 50)
    two = Track("b", values[300:].astype(np.float32).astype(np.float64), np.arange(700) / 50)
    one = replace(one, values=one.values.astype(np.float32))
    result, _ = examine_tracks([one, two])
    (found,) = result.findings
    assert (found.kind, found.files, found.rows) == ("repeated_recording", ["a", "b"], [[300, 799]])
    assert not result.sound


def test_a_reference_used_twice_is_named():
    load = np.cumsum(np.random.default_rng(1).normal(size=2000))
    rng = np.random.default_rng(2)
    several = [
        Track(name, rng.normal(size=(900, 12)), np.arange(900) / 50, reference=own)
        for name, own in (("a", load[:1500]), ("b", load[200:]))
    ]
    kinds = {(one.kind, tuple(one.files)) for one in examine_tracks(several)[0].findings}
    assert ("repeated_reference", ("a", "b")) in kinds


def test_two_clocks_are_a_line():
    knots = np.random.default_rng(1).uniform(0, 1, 60)
    load = np.interp(np.arange(6000), np.arange(0, 6000, 100), knots)
    values = np.rint(np.outer(load, np.linspace(60, 120, 20)))
    rows = np.arange(5500)
    own = np.interp(rows + 80.0 - 0.01 * rows, np.arange(6000), load)
    made = Track("a", values, np.arange(6000) / 50, reference=own)
    (found,) = [one for one in examine_track(made)[0].findings if one.kind == "clocks"]
    # The bounds that recordings of a pressure chamber are judged by.
    assert abs(found.offset_rows - 80) < 12
    assert abs(found.slope + 0.01) < 0.001


def run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, ["examine", *map(str, words)])
    # What `main` turns into one line and exit code 2.
    if isinstance(done.exception, skinmap.SkinError):
        return 2, str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.output


def test_the_command_prints_files_findings_and_sound(tmp_path):
    values = noise()
    values[:, 3] = 0.0
    np.savez(tmp_path / "a.npz", samples=values, times=np.arange(1000) / 50)
    code, text = run(tmp_path / "a.npz", "--json")
    found = json.loads(text)
    assert (code, found["sound"], found["findings"]) == (3, False, [])
    (file,) = found["files"]
    assert (file["rows"], file["channels"], round(file["rate_hz"])) == (1000, 12, 50)
    (dead,) = file["findings"]
    assert (dead["kind"], dead["channels"], dead["rows"]) == ("dead", [3], None)
    assert set(dead) == {
        "kind", "file", "channels", "rows", "seconds", "confidence", "harm", "matters", "text", "do"
    }  # fmt: skip


def test_the_same_samples_are_read_from_npz_csv_and_mat(tmp_path):
    values, times = noise(), np.arange(1000) / 50
    np.savez(tmp_path / "a.npz", values=values, times=times)
    savemat(tmp_path / "a.mat", {"samples": values, "times": times})
    head = ",".join(["time", *(f"x{k}" for k in range(12))])
    table = np.column_stack([times, values])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=head, comments="")
    for name in ("a.npz", "a.mat", "a.csv"):
        found = read_track(tmp_path / name)
        np.testing.assert_allclose(found.values, values, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.times, times, rtol=0, atol=1e-12)
        assert run(tmp_path / name)[0] == 0


BAD = {
    "empty": {"samples": np.zeros((0, 5)), "times": np.zeros(0)},
    "one row": {"samples": np.zeros((1, 5)), "times": np.zeros(1)},
    "one channel": {"samples": np.zeros((50, 1)), "times": np.arange(50)},
    "all NaN": {"samples": np.full((50, 5), np.nan), "times": np.arange(50)},
    "words": {"samples": np.full((50, 5), "a"), "times": np.arange(50)},
    "channels": {"samples": np.zeros((2, 100_000), np.uint8), "times": np.arange(2)},
    "no times": {"samples": noise()},
    "text times": {"samples": noise(), "times": np.array([f"{k} s" for k in range(1000)])},
    "milliseconds": {"samples": noise(), "times": np.arange(1000) * 20.0},
    "microseconds": {"samples": noise(), "times": np.arange(1000) * 20_000},
    "nanoseconds": {"samples": noise(), "times": np.arange(1000) * 20_000_000},
    "reference only": {"pressure_bar": np.arange(50.0)},
    "no arrays": {"head": np.array(3)},
    "unlabelled events": {"samples": noise(), "events": np.full(1000, 7), "labels": ["a", "b"]},
    "sessions": {"samples": noise(), "events": np.zeros(1000, int), "labels": ["a"],
                 "sessions": ["x", "y"]},
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_named_in_one_line_or_a_finding(name, tmp_path):
    np.savez(tmp_path / "bad.npz", **BAD[name])
    code, text = run(tmp_path / "bad.npz")
    assert code in (2, 3)
    assert "bad.npz" in text
    assert code == 3 or "\n" not in text.strip()
    if "labels" in BAD[name]:
        assert "label" in text
        assert code == 2


def test_two_recordings_with_different_channels_are_named(tmp_path):
    for width in (8, 12):
        np.savez(tmp_path / f"{width}.npz", samples=noise(500, width), times=np.arange(500) / 50)
    code, text = run(tmp_path, "--json")
    (found,) = json.loads(text)["findings"]
    assert (code, found["kind"], len(found["files"])) == (3, "place", 2)


def faulty() -> dict[str, np.ndarray]:
    """Rows out of order, repeated ones, a clock that begins anew, and a dead channel."""
    values, times = noise(), np.arange(1000) / 50
    values[:, 5] = 0.0
    order = np.r_[0:100, 140:180, 100:140, 180:300, 290:1000]
    values, times = values[order], times[order]
    times[700:] -= times[700]
    return {"samples": values, "times": times}


def test_a_mended_copy_is_sound_and_invents_nothing(tmp_path):
    held = faulty()
    np.savez(tmp_path / "a.npz", **held)
    code, text = run(tmp_path / "a.npz", "--mend", tmp_path / "b.npz", "--json")
    kinds = {one["kind"] for one in json.loads(text)["files"][0]["findings"]}
    assert code == 3
    assert kinds == {"order", "duplicate", "restart", "dead"}
    assert run(tmp_path / "b.npz")[0] == 0
    with np.load(tmp_path / "b.npz") as mended:
        assert {"left 10 repeated rows out", "put the rows into the order of their times"} <= set(
            mended["mended"].tolist()
        )
        known = {row.tobytes() for row in held["samples"]}
        assert {row.tobytes() for row in mended["samples"]} == known
        assert len(mended["samples"]) == len(known)


def test_mending_writes_over_nothing_and_takes_one_recording(tmp_path):
    np.savez(tmp_path / "a.npz", **faulty())
    before = (tmp_path / "a.npz").read_bytes()
    code, text = run(tmp_path / "a.npz", "--mend", tmp_path / "a.npz")
    assert code == 2
    assert "is there already" in text
    assert (tmp_path / "a.npz").read_bytes() == before
    for given in (tmp_path, tmp_path / "a.npz"):
        code, text = run(given, "--mend", tmp_path / "a.npz", "--force")
        assert code == 2
        assert "one of those that are read" in text
    assert (tmp_path / "a.npz").read_bytes() == before
    np.savez(tmp_path / "c.npz", **faulty())
    code, text = run(tmp_path / "a.npz", tmp_path / "c.npz", "--mend", tmp_path / "b.npz")
    assert code == 2
    assert not (tmp_path / "b.npz").exists()


def test_the_page_holds_a_picture_for_each_question(tmp_path):
    load = np.interp(np.arange(3000), np.arange(0, 3000, 100), np.random.default_rng(1).random(30))
    values = np.rint(np.outer(load, np.linspace(60, 120, 20)))
    values[:, 3] = 0
    own = np.interp(np.arange(2500) + 90.0, np.arange(3000), load)
    np.savez(tmp_path / "a.npz", samples=values, times=np.arange(3000) / 50, pressure_bar=own)
    _, printed = run(tmp_path / "a.npz", "-o", tmp_path / "page")
    text = (tmp_path / "page" / "report.html").read_text()
    for one in (printed, text):
        assert re.search(r"skin row = 90\.\d \+ 1\.000\d+ x reference row \(residual \d", one)
    assert text.count("<img") == 3
    assert "never answers" in text


def test_training_is_warned_of_one_recording_under_two_names(tmp_path):
    from skinmap.cli.collection import collect

    skin = skinmap.load_robot("kaspar").skin("left_hand")
    touches = skinmap.simulate(skin, per_gesture=2, gestures=["poke"], rng=0)
    for name in ("a.npz", "b.npz"):
        skinmap.save_recordings(touches, tmp_path / name)
    (line,) = [one for one in collect([tmp_path], "kaspar").doubts() if "two names" in one]
    assert "a.npz" in line
    alone = collect([tmp_path / "a.npz"], "kaspar")
    assert alone.unsound == ()


def test_a_folder_is_examined_in_python_as_by_the_command(tmp_path):
    for name in ("a", "b"):
        np.savez(tmp_path / f"{name}.npz", **faulty())
    found = json.loads(run(tmp_path, "--json")[1])
    own = skinmap.examine(tmp_path)
    assert own[0].kind == "repeated_recording"
    assert len(own) == len(found["findings"]) + sum(len(one["findings"]) for one in found["files"])


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(DataFormatError, match="a folder without recordings"):
        skinmap.soundness.track.files_of(tmp_path)


def test_a_touch_on_a_calm_skin_shows_a_turned_sign():
    """Few channels are touched, each now and then: no median moves."""
    rng = np.random.default_rng(2)
    values = 100.0 + rng.normal(0, 1.0, (2000, 120))
    for start in range(50, 1900, 60):
        first = int(rng.integers(0, 116))
        values[start : start + 30, first : first + 4] += 60 * np.hanning(30)[:, None]
    values[:, 50:54] = 100.0
    values[:, 50:54] += rng.normal(0, 1.0, (2000, 4))
    for start in (400, 900, 1400):
        values[start : start + 30, 50:54] += 60 * np.hanning(30)[:, None]
    values[:, 51] = 200.0 - values[:, 51]
    own = examine_track(Track("calm", values.round(), np.arange(2000) / 50))[0].findings
    assert [(one.kind, one.channels) for one in own] == [("sign", [51])]


def pokes(rng, *, rows=4500, side=10):
    """(rows, side**2) presses of one finger here and there, 0 to 1, at 50 rows a second."""
    places = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    felt = np.zeros((rows, len(places)))
    begin = 100
    while begin < rows - 200:
        lasts = int(rng.integers(30, 120))
        away = ((places - rng.uniform(0, side, 2)) ** 2).sum(axis=1)
        edge = np.minimum(np.arange(lasts), np.arange(lasts)[::-1]) / 5.0
        press = rng.uniform(0.4, 1.0) * np.minimum(edge, 1.0)[:, None] * np.exp(-away / 5.0)
        felt[begin : begin + lasts] = press
        begin += lasts + int(rng.integers(20, 150))
    return felt


def test_touches_here_and_there_give_the_clock_of_a_load():
    # No channels go together as in a chamber: the load is that of all of them.
    rng = np.random.default_rng(3)
    felt = pokes(rng)
    values = np.rint(240.0 - 120.0 * felt + rng.normal(0.0, 0.7, felt.shape)).astype(np.uint8)
    whole = felt.sum(axis=1)
    seen = np.interp(np.arange(4500) * 1.003 + 30.0, np.arange(4500), whole)
    made = Track("a", values, np.arange(4500) / 50, reference=seen / seen.max())
    (found,) = [one for one in examine_track(made)[0].findings if one.kind == "clocks"]
    assert abs(found.offset_rows - 30.0) < 6.0
    assert abs(found.slope - 0.003) < 5e-4
    # The control: the load of another recording fits nowhere.
    other = pokes(np.random.default_rng(4)).sum(axis=1)
    made = Track("a", values, np.arange(4500) / 50, reference=other / other.max())
    (found,) = [one for one in examine_track(made)[0].findings if one.kind == "clocks"]
    assert "fits no part" in found.text


@pytest.mark.parametrize(
    ("step", "begin", "said", "span"),
    [
        (2.0, 0, "seconds or milliseconds", 1998.0),
        (2.0, 1.7e12, "in milliseconds", 1.998),
        (1000.0, 0, "in microseconds", 0.999),
        (1e6, 1.7e18, "in nanoseconds", 0.999),
        (5.0, 1.7e9, "", 4995.0),
    ],
)
def test_times_of_fast_skins_are_not_read_a_thousand_times_wrong(tmp_path, step, begin, said, span):
    times = int(begin) + np.arange(1000) * int(step)
    np.savez(tmp_path / "a.npz", samples=noise(), times=times)
    track = read_track(tmp_path / "a.npz")
    assert track.times is not None
    assert np.isclose(np.ptp(track.times), span)
    text = " ".join(one.text for one in examine_track(track)[0].findings)
    assert said in text if said else not text


def test_thousands_are_no_decimals(tmp_path):
    path = tmp_path / "t.tsv"
    rows = [f"{k / 50:.2f}\t{980 + k}\t1,0{k % 90 + 10}" for k in range(40)]
    path.write_text("\n".join(["time\ta\tb", *rows]))
    with pytest.raises(DataFormatError, match="thousands"):
        read_track(path)


@pytest.mark.parametrize(("step", "unit"), [(4, "milliseconds"), (4000, "microseconds")])
def test_two_hundred_a_second_and_more_are_read_right(tmp_path, step, unit):
    np.savez(tmp_path / "a.npz", samples=noise(), times=np.arange(1000) * step)
    assert read_track(tmp_path / "a.npz").unit == unit


def test_a_slow_logger_is_in_seconds_where_touches_leap(tmp_path):
    touched = np.repeat(np.random.default_rng(1).random((50, 12)) < 0.3, 2, axis=0)
    values = np.zeros((1000, 12))
    values[np.r_[0:1000:10, 1:1000:10]] = 100.0 * touched[np.r_[0:100, 0:100]]
    np.savez(tmp_path / "a.npz", samples=noise() + values, times=np.arange(1000) * 2)
    track = read_track(tmp_path / "a.npz")
    assert track.unit == ""
    assert track.times is not None
    assert track.times[1] == 2.0


def test_a_column_that_stands_twice_is_named(tmp_path):
    rows = "".join(f"{k / 50},{k % 7},{k % 5},{k % 3}\n" for k in range(60))
    (tmp_path / "a.csv").write_text("time,ch0,ch2,ch2\n" + rows)
    found = examine_track(read_track(tmp_path / "a.csv"))[0].findings
    (text,) = [one.text for one in found if one.kind == "repeated_id"]
    assert "ch2" in text


def test_decimal_commas_are_read(tmp_path):
    (tmp_path / "a.csv").write_text("time;ch0;ch1\n0,00;1,5;2\n0,02;3;-4,25\n")
    track = read_track(tmp_path / "a.csv")
    np.testing.assert_array_equal(track.values, [[1.5, 2.0], [3.0, -4.25]])
    np.testing.assert_array_equal(track.times, [0.0, 0.02])


def test_a_reference_is_laid_on_the_rows_that_a_mended_copy_has():
    rng = np.random.default_rng(3)
    felt = pokes(rng)
    values = np.rint(120.0 * felt + rng.normal(0.0, 0.7, felt.shape))
    whole = felt.sum(axis=1)
    seen = np.interp(np.arange(4300) * 1.02 + 60.0, np.arange(4500), whole)
    twice = np.sort(np.concatenate([np.arange(4500), rng.choice(4500, 110, replace=False)]))
    made = Track("a", values[twice], np.arange(4500)[twice] / 50, reference=seen)
    copy, _ = mend(made)
    assert copy.reference is not None
    known = np.isfinite(copy.reference)
    assert np.corrcoef(copy.reference[known], whole[known])[0, 1] > 0.99
    assert not any(one.matters for one in examine_track(copy)[0].findings)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_load_on_the_rows_of_the_skin_is_on_its_clock(seed):
    # Steps roll from heel to toe: most channels follow each other, and lag the load of all.
    rng = np.random.default_rng(seed)
    felt, begin = np.zeros((3000, 24)), 50
    while begin < 2900:
        lasts = int(rng.integers(28, 40))
        phase = np.arange(lasts)[:, None] / lasts
        roll = np.exp(-(((phase - np.linspace(0.2, 0.85, 24) ** 0.6) / 0.15) ** 2))
        felt[begin : begin + lasts] = rng.uniform(0.8, 1.0) * np.sin(np.pi * phase) ** 0.4 * roll
        begin += lasts + int(rng.integers(18, 26))
    values = np.rint(400.0 * felt + rng.normal(0.0, 1.0, felt.shape))
    load = felt.mean(axis=1)
    made = Track("a", values, np.arange(3000) / 50, reference=load)
    assert not [one for one in examine_track(made)[0].findings if one.kind == "clocks"]
    # Foam answers late, which is no other clock either; a reference that slips is one.
    late = Track("a", np.roll(values, 5, axis=0), made.times, reference=load)
    assert not [one for one in examine_track(late)[0].findings if one.kind == "clocks"]
    slipped = Track("a", values[20:], made.times[20:], reference=load)
    (found,) = [one for one in examine_track(slipped)[0].findings if one.kind == "clocks"]
    assert abs(found.offset_rows + 20.0) < 3.0


def test_two_long_stretches_at_one_value_are_cut_off_where_noise_moves_all_others():
    rng = np.random.default_rng(5)
    values = pokes(rng)
    channel = int(values.max(axis=0).argmax())
    values[:, channel] = 0.0
    for begin in (500, 2500):
        values[begin : begin + 80, channel] = 1.0
    values = 40.0 * values + rng.normal(0.0, 0.2, values.shape)
    kinds = [
        one.kind for one in examine_track(Track("a", values, np.arange(4500) / 50))[0].findings
    ]
    assert "clipped" not in kinds
    values[:, channel] = np.minimum(values[:, channel], 30.0)
    found = examine_track(Track("a", values, np.arange(4500) / 50))[0].findings
    assert [(one.kind, one.channels) for one in found] == [("clipped", [channel])]


def test_a_coarse_channel_is_neither_noisy_nor_cut_off():
    rng = np.random.default_rng(8)
    values = 100.0 * pokes(rng) + rng.normal(0.0, 0.5, (4500, 100))
    channel = int(np.abs(values).sum(axis=0).argmax())
    values[:, channel] = 14.0 * np.rint(values[:, channel] / 14.0)
    found = examine_track(Track("a", values, np.arange(4500) / 50))[0].findings
    assert [(one.kind, one.channels) for one in found] == [("quantised", [channel])]


def labelled(rng, *, per=15):
    """Presses, pats and strokes of a finger, in three sessions: a track and its touches' rows."""
    places = np.stack(np.meshgrid(np.arange(8), np.arange(8)), -1).reshape(-1, 2)
    names = rng.permutation(np.repeat(["poke", "pat", "stroke"], per)).tolist()
    pieces, spans = [], []
    for name in names:
        lasts, begin, angle = int(rng.integers(50, 100)), rng.uniform(1, 6, 2), rng.uniform(0, 6.3)
        way = np.array([np.cos(angle), np.sin(angle)])
        course = np.linspace(0, 1, lasts)
        at = begin + (3.0 * course[:, None] * way if name == "stroke" else 0.0)
        press = np.clip(8.0 * np.minimum(course, 1 - course), 0, 1) * rng.uniform(0.6, 1.0)
        press = press * np.abs(np.sin(9.0 * course)) if name == "pat" else press
        away = ((places[None] - np.broadcast_to(at, (lasts, 2))[:, None]) ** 2).sum(axis=-1)
        start = sum(map(len, pieces)) + 50
        spans.append([start, start + lasts - 1])
        pieces += [np.zeros((50, 64)), press[:, None] * np.exp(-away / 3.0)]
    felt = 100.0 * np.concatenate(pieces)
    values = np.rint(rng.uniform(20, 60, 64) + felt + rng.normal(0, 1, felt.shape))
    events = np.full(len(values), -1)
    for number, (first, last) in enumerate(spans):
        events[first : last + 1] = number
    sessions = tuple(f"s{3 * k // len(names)}" for k in range(len(names)))
    made = Track("a", values, np.arange(len(values)) / 50, events=events, labels=tuple(names))
    return replace(made, sessions=sessions), spans


def test_exchanged_labels_are_named_and_others_are_not():
    named = 0
    for seed in range(4):
        made, spans = labelled(np.random.default_rng(seed))
        assert not examine_track(made)[0].findings
        names = list(made.labels)
        wrong = [names.index("poke"), names.index("stroke")]
        names[wrong[0]], names[wrong[1]] = "stroke", "poke"
        (found,) = examine_track(replace(made, labels=tuple(names)))[0].findings
        assert found.kind == "labels"
        assert all(rows in [spans[k] for k in wrong] for rows in found.rows)
        named += len(found.rows)
    assert named >= 7  # of 8


def test_offsets_of_sessions_and_a_drift_are_told_apart():
    made, spans = labelled(np.random.default_rng(1))
    values = made.values.copy()
    row = np.arange(len(values))
    number = np.searchsorted([spans[15][0], spans[30][0]], row, side="right")
    offsets = np.random.default_rng(2).normal(0, 8, (3, 64))
    (found,) = examine_track(replace(made, values=values + offsets[number]))[0].findings
    assert found.kind == "rest"
    assert "sessions" in found.text
    drifted = values + np.linspace(0, 30, len(values))[:, None]
    (found,) = examine_track(replace(made, values=drifted))[0].findings
    assert found.kind == "drift"


def test_another_rate_is_one_finding_and_lost_rows_stay_lost():
    rng = np.random.default_rng(7)
    values = np.rint(40.0 + 100.0 * pokes(rng, rows=3000) + rng.normal(0.0, 1.0, (3000, 100)))
    even = np.arange(3000) / 50
    slower = np.concatenate([even[:2000], even[2000] + np.arange(1000) * 0.03])
    (found,) = examine_track(Track("a", values, slower))[0].findings
    assert (found.kind, found.rows) == ("stamps", [[2000, 2999]])
    assert "33.3 Hz" in found.text
    kept = np.concatenate([np.arange(2000), np.arange(2000, 3000, 2)])
    (found,) = examine_track(Track("a", values[kept], even[kept]))[0].findings
    assert found.kind == "lost"


@pytest.mark.skipif(not INSOLE.is_dir(), reason="the insole is not beside this checkout")
def test_a_real_chamber_accuses_the_dead_and_hardly_any_that_follow():
    with np.load(INSOLE / "calibration_dataset.npz") as held:
        counts, reference = held["counts"].astype(float), held["pressure_bar"]
    spread, skin = counts.std(axis=0), np.median(counts, axis=1)
    live = np.flatnonzero(spread > 0.5)
    follow = {k for k in live.tolist() if np.corrcoef(counts[:, k], skin)[0, 1] > 0.9}
    assert len(follow) == 237
    track = Track("a", counts, np.arange(len(counts)) / 50, reference=reference)
    found = examine_track(track)[0].findings
    accused = {channel for one in found for channel in one.channels or []}
    assert set(np.flatnonzero(spread <= 0.5).tolist()) <= accused
    assert len(accused & follow) <= 3
    # A recording that ends under load has no drift of its own.
    with np.load(INSOLE / "validation_dataset_2.npz") as held:
        counts, reference = held["counts"].astype(float), held["pressure_bar"]
    track = Track("b", counts, np.arange(len(counts)) / 50, reference=reference)
    assert not {one.kind for one in examine_track(track)[0].findings} & {"drift", "rest"}


def test_the_clock_of_hours_is_found_in_seconds():
    rng, rows = np.random.default_rng(11), 200_000
    knots = rng.uniform(0, 1, rows // 150 + 2)
    load = np.interp(np.arange(rows), np.arange(len(knots)) * 150, knots)
    counts = np.rint(np.outer(load, np.linspace(60, 120, 6))).astype(np.uint8)
    seen = np.interp(np.arange(rows) * 1.0007 + 400.0, np.arange(rows), load)
    begin = time.process_time()
    (line,) = align(counts, seen)
    assert time.process_time() - begin < 60
    at = np.array([0, rows - 1000])
    ours = at + line.offset_rows + line.slope * at
    np.testing.assert_allclose(ours, at * 1.0007 + 400.0, atol=12)


def test_rows_in_another_order_are_no_new_clock():
    times = np.arange(1000) / 50
    for seed in range(20):
        rng = np.random.default_rng(seed)
        order = np.arange(1000)
        a = int(rng.integers(50, 900))
        order[a : a + 25] = rng.permutation(order[a : a + 25])
        own = examine_track(Track("mixed", noise()[order], times[order]))[0].findings
        assert [one.kind for one in own] == ["order"]


@pytest.mark.parametrize("touched", [False, True])
def test_a_noisy_channel_is_named_whether_the_skin_is_touched_or_not(touched):
    rng = np.random.default_rng(4)
    values = rng.normal(0, 1.0, (1500, 100))
    if touched:  # a few of the channels
        for start in range(50, 1400, 100):
            values[start : start + 40, 10:16] += 80 * np.hanning(40)[:, None]
    values[:, 70] *= 12.0
    own = examine_track(Track("noisy", values, np.arange(1500) / 50))[0].findings
    assert [(one.kind, one.channels) for one in own] == [("noisy", [70])]


def test_of_hands_that_hardly_let_go_of_a_small_skin_only_a_noisy_channel_is_named():
    rng = np.random.default_rng(0)
    values, at = rng.normal(1000, 4.0, (6000, 24)), 60
    size = np.where(np.arange(24) % 3, 400.0, 30.0)
    while at < 5800:
        rows = np.hanning(rng.integers(100, 300))[: 6000 - at, None] ** 0.5
        values[at : at + len(rows)] += rows * rng.uniform(0.3, 1.0, 24) * size
        at += len(rows) + int(rng.integers(12, 30))
    times = np.arange(6000) / 50
    assert not examine_track(Track("hands", values.round(), times))[0].findings
    values[:, 7] += rng.normal(0, 40.0, 6000)
    own = examine_track(Track("hands", values.round(), times))[0].findings
    assert [(one.kind, one.channels) for one in own] == [("noisy", [7])]


def test_channels_that_answer_elsewhere_and_without_a_place_are_named():
    """Sixteen channels of a sheet carry the values of sixteen others, as two swapped plugs do."""
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(np.arange(16.0), np.arange(16.0)), -1).reshape(-1, 2)
    values = rng.normal(0, 0.5, (12000, 256))
    for start in range(20, 11950, 30):
        middle = rng.uniform(0, 15, 2) + np.linspace(0, 3, 25)[:, None]
        away = ((places[None] - middle[:, None]) ** 2).sum(axis=2)
        values[start : start + 25] += 80 * np.hanning(25)[:, None] * np.exp(-away / 2.5)
    at = np.column_stack([5e-3 * places, np.zeros(256)])
    healthy = Track("right", values, np.arange(12000) / 50, places=at)
    assert examine_track(healthy)[0].findings == []
    block = (places[:, 0] >= 1) & (places[:, 0] < 5) & (places[:, 1] >= 1) & (places[:, 1] < 5)
    one = np.flatnonzero(block)
    other = one + 10 + 16 * 10  # ten to the side and ten up
    swapped = values.copy()
    swapped[:, one], swapped[:, other] = values[:, other], values[:, one]
    lost = at.copy()
    lost[200] = np.nan
    own = examine_track(replace(healthy, values=swapped, places=lost))[0].findings
    found = {finding.kind: finding.channels for finding in own}
    assert found == {"wiring": sorted([*one.tolist(), *other.tolist()]), "place": [200]}


def test_a_robots_places_go_by_the_number_of_channels(tmp_path):
    np.savez(tmp_path / "t.npz", samples=noise(600, 240), times=np.arange(600) / 50)
    words = ["examine", str(tmp_path / "t.npz"), "--robot"]
    assert CliRunner().invoke(cli, [*words, "kaspar"]).exit_code == 0
    refused = CliRunner().invoke(cli, [*words, "baxter-forearm"])
    assert "240 channels; the taxels of" in str(refused.exception)


@pytest.mark.parametrize("swapped", [None, (311, 384), (49, 379)])
def test_two_exchanged_wires_are_named_and_sound_ones_are_not(swapped):
    skin = skinmap.load_robot("icub").skin("torso")
    made = skinmap.simulate(skin, per_gesture=25, variety=0.0, rng=0)
    values = made.pressures.copy()
    if swapped:
        values[:, list(swapped)] = values[:, list(swapped)[::-1]]
    own = examine_track(Track("wires", values, made.times, places=skin.positions))[0].findings
    found = [one.channels for one in own if one.kind == "wiring"]
    assert found == ([sorted(swapped)] if swapped else [])


def test_axes_that_swing_both_ways_are_no_turned_signs():
    rng = np.random.default_rng(3)
    values = rng.normal(0, 2, (5400, 48)) + rng.normal(0, 300, 48)
    at = 0
    while at < 5300:
        rows = int(rng.integers(30, 240))
        if rng.random() < 0.7:
            rise = np.sin(np.pi * np.arange(rows) / rows)[: 5400 - at, None]
            middle = int(rng.integers(2, 14))
            values[at : at + rows, 3 * middle - 6 : 3 * middle + 9] += rise * rng.normal(0, 150, 15)
        at += rows
    clean = Track("magnetic", values.round(), np.arange(5400) / 60)
    assert examine_track(clean)[0].findings == []
    drifting = values + np.linspace(0, 200, 5400)[:, None] * (np.arange(48) == 17)
    found = examine_track(replace(clean, values=drifting.round()))[0].findings
    assert [(one.kind, one.channels) for one in found] == [("drift", [17])]


def glove(seed: int) -> Track:
    """Two minutes of objects that are held for seconds each, with hardly a moment of rest."""
    rng = np.random.default_rng(seed)
    places = np.column_stack(np.divmod(np.arange(120), 12)).astype(float)
    load = np.zeros((3000, 120))
    at = 0
    while at < 3000:
        rows = int(rng.integers(40, 200))
        middles, widths = places[rng.integers(0, 120, 4)], rng.uniform(1, 3, 4)
        away = ((places[:, None] - middles) ** 2).sum(axis=2) / widths**2
        tremble = 1 + 0.03 * np.cumsum(rng.normal(0, 1, len(load[at : at + rows])))
        load[at : at + rows] = np.outer(tremble.clip(0.3), np.exp(-away / 2) @ rng.random(4))
        at += rows
    values = 800 + 900 * load + rng.normal(0, 3, load.shape)
    return Track("glove", values.round(), np.arange(3000) / 25)


def test_loads_that_are_held_are_neither_drift_nor_noise_nor_another_rest():
    several = [glove(seed) for seed in range(8)]
    kinds = [{one.kind for one in examine_track(track)[0].findings} for track in several]
    accused = [own for own in kinds if {"drift", "rest", "noisy", "stuck", "sign"} & own]
    assert len(accused) <= 2  # all of them before
    drifting = [
        replace(one, values=one.values + np.linspace(0, 800, 3000)[:, None].round())
        for one in several
    ]
    whole = [examine_track(one)[0].findings for one in drifting]
    named = [any(one.kind == "drift" and one.channels is None for one in own) for own in whole]
    assert sum(named) >= 6


def test_parts_of_other_times_are_examined_each_for_itself(tmp_path):
    long, short = (
        skinmap.simulate("icub", part=part, per_gesture=count, rng=5, variety=0.0)
        for part, count in (("torso", 6), ("left_foot", 1))
    )
    values = np.array(long.pressures)
    values[:, 50] = 40  # stuck
    skinmap.save_recordings([replace(long, pressures=values), short], tmp_path / "two.npz")
    found = skinmap.examine(tmp_path / "two.npz")
    alone = skinmap.examine(replace(long, pressures=values))
    assert [one.kind for one in found if "torso" in one.file] == [one.kind for one in alone]
    assert any(one.kind == "stuck" and one.channels == [50] for one in found)
    assert not [one for one in found if one.kind in ("wiring", "place")]
    result = CliRunner().invoke(cli, ["examine", str(tmp_path / "two.npz")])
    assert f"two.npz: torso: {len(values)} rows of 430 channels" in result.output


def test_taxels_that_drift_with_the_skin_are_no_temperatures():
    rng, times = np.random.default_rng(4), np.arange(6000) / 10
    drift = 15 * (times / times[-1])[:, None] * rng.uniform(0.6, 1.4, 96)
    values = drift + rng.normal(0, 0.6, drift.shape)
    for k in range(40):  # a fifth of the taxels is never touched
        values[140 * k + 100 : 140 * k + 110, rng.integers(0, 76, 40)] += 60
    counts = np.clip(np.rint(values), 0, 255)
    counts[:, 90] = np.rint(60 + 30 * np.sin(times / 90) + rng.normal(0, 0.6, len(times)))
    found = examine_track(Track("t", counts, times))[0].findings
    assert [one.channels for one in found if one.kind == "thermal"] == [[90]]  # the control


def test_parts_of_a_recording_are_examined_at_their_own_times(tmp_path):
    """Two sound parts of other rates and kinds have no finding; a loss in one is found there."""
    rng = np.random.default_rng(0)
    for part, rate, start in (("a", 100.0, 50.0), ("b", 37.0, 50.013)):
        times = start + np.arange(8 * rate) / rate
        values = np.clip(
            np.rint(rng.normal(200, 1 if part == "a" else 3, (len(times), 24))), 0, 255
        )
        kept = (times < 53) | (times > 54) | (part == "a")
        lines = [
            f"{k} {t:.6f} " + " ".join(f"{v:.0f}" for v in row) + "\n"
            for k, (t, row) in enumerate(zip(times[kept], values[kept], strict=True))
        ]
        (tmp_path / part).mkdir()
        (tmp_path / part / "data.log").write_text("".join(lines))
    found = skinmap.examine(tmp_path)
    assert [(one.kind, one.file) for one in found] == [("lost", f"{tmp_path}: b")]


@pytest.mark.parametrize("seed", range(3))
def test_steps_of_any_length_are_no_writers_scatter(seed):
    """A sensor without a rate: its deviations from even times add up, those of a writer do not."""
    rng = np.random.default_rng(seed)
    values = np.rint(40.0 + 100.0 * pokes(rng, rows=600) + rng.normal(0.0, 1.0, (600, 100)))
    honest = np.cumsum(rng.uniform(0.01, 0.04, 600))
    assert examine_track(Track("a", values, honest))[0].findings == []
    paused = honest + 3.0 * (np.arange(600) >= 300)
    assert [one.kind for one in examine_track(Track("a", values, paused))[0].findings] == ["lost"]
    late = np.maximum.accumulate(np.arange(600) / 50 + rng.exponential(0.014, 600))
    assert "stamps" in [one.kind for one in examine_track(Track("a", values, late))[0].findings]


@pytest.mark.parametrize("wrong", ["ms", "ns", "digits", "coarse"])
def test_broken_times_are_no_sound_ones(tmp_path, wrong):
    """A mapping that leaves the unit out does not make seconds of other units."""
    values = np.random.default_rng(1).normal(100, 3, (600, 8)).round(2)
    seconds = np.arange(600) / 50
    times = {"ms": seconds * 1e3, "ns": (1.76e9 + seconds) * 1e9,
             "digits": (1.76e9 + seconds).astype(np.float32).astype(float),
             "coarse": np.floor(seconds * 10 + 1e-9) / 10}[wrong]  # fmt: skip
    rows = [
        f"{time:.6f}," + ",".join(map(str, row)) for time, row in zip(times, values, strict=True)
    ]
    text = "time," + ",".join(f"ch{k}" for k in range(8)) + "\n" + "\n".join(rows)
    (tmp_path / "t.csv").write_text(text)
    (tmp_path / "t.toml").write_text('robot = "icub"\npart = "torso"\n')
    assert "stamps" in [one.kind for one in skinmap.examine(tmp_path / "t.csv") if one.matters]


@pytest.mark.parametrize("late", [0.0, 0.25, 0.5, 0.75])
def test_a_clock_that_begins_anew_between_the_steps_is_a_restart(late):
    """Sorted by time, the halves would be mixed: that they are out of order is no answer."""
    values = np.random.default_rng(2).normal(100, 3, (500, 8))
    times = (np.arange(500) - np.where(np.arange(500) < 250, 0.0, 249.0 + late)) / 50
    found = [one.kind for one in examine_track(Track("anew", values, times))[0].findings]
    assert "restart" in found
    assert "order" not in found


def test_missing_values_and_spikes_have_their_rows_and_channels():
    rng = np.random.default_rng(5)
    felt = pokes(rng)
    sound, strewn = felt + rng.normal(0.0, 0.01, felt.shape), rng.random(felt.shape) < 0.3
    times = np.arange(len(sound)) / 50

    def found(where, value):
        values = sound.copy()
        values[where] = value
        return [
            (one.kind, one.channels, one.rows)
            for one in examine_track(Track("a.npz", values, times))[0].findings
        ]

    assert found(slice(0, 0), 0) == []
    assert found(slice(1000, 2000), np.nan) == [("lost", None, [[1000, 1999]])]
    assert found(slice(9, 10), np.inf) == [("lost", None, [[9, 9]])]
    assert found((slice(1000, 2000), 7), np.nan) == [("stuck", [7], [[1000, 1999]])]
    assert found(strewn, np.nan) == [("lost", list(range(sound.shape[1])), None)]
    far, rows = 100 * sound.max(), [[700, 700], [903, 904], [4499, 4499]]
    assert found(([700, 903, 904, 4499], [3, 40, 40, 9]), far) == [("noisy", [3, 9, 40], rows)]


@pytest.mark.parametrize(("row", "value"), [(0, np.nan), (1500, 65535.0)])
def test_rows_of_no_number_or_of_spikes_repeat_none_and_stay(row, value):
    rng = np.random.default_rng(5)
    values = pokes(rng)
    values += rng.normal(0.0, 0.01, values.shape)
    values[row] = value
    track = Track("a.npz", values, np.arange(len(values)) / 50)
    assert [one.kind for one in examine_track(track)[0].findings] == [
        "lost" if row == 0 else "noisy"
    ]
    assert len(mend(track)[0].values) == len(values)


def test_grasps_that_load_neighbours_apart_exchange_no_channels():
    rng = np.random.default_rng(2)
    at = np.column_stack([np.indices((20, 16)).reshape(2, -1).T * 5e-3, np.zeros(320)])
    values = rng.normal(0.0, 1.0, (6000, 320))
    for begin in range(50, 5700, 400):
        loads = rng.uniform(0.1, 0.9, 320) * (rng.random(320) < 0.8)
        loads[: int(rng.choice([0, 100, 220]))] = 0.0
        values[begin : begin + 90] += 180.0 * np.hanning(90)[:, None] ** 0.3 * loads
    own = examine_track(Track("glove", values, np.arange(6000) / 50, places=at))[0].findings
    assert [one for one in own if one.kind == "wiring"] == []


def test_two_exchanged_boards_are_one_finding():
    rng = np.random.default_rng(4)
    felt = pokes(rng, rows=9000)
    values = felt + rng.normal(0.0, 0.005, felt.shape)
    boards = [*range(12, 19)], [*range(62, 69)]
    values[:, boards[0] + boards[1]] = values[:, boards[1] + boards[0]]
    at = np.column_stack([np.indices((10, 10)).reshape(2, -1).T * 5e-3, np.zeros(100)])
    own = examine_track(Track("boards", values, np.arange(9000) / 50, places=at))[0].findings
    (found,) = [one for one in own if one.kind == "wiring"]
    assert set(found.channels) <= set(boards[0] + boards[1])
    assert len(found.channels) >= 8
    assert " to " in found.text


def test_taps_of_one_row_are_no_spikes():
    rng = np.random.default_rng(1)
    at = np.indices((10, 10)).reshape(2, -1).T
    values = rng.normal(20.0, 1.2, (2000, 100))
    for row in range(20, 1980, 30):
        away = ((at - rng.uniform(0, 9, 2)) ** 2).sum(axis=1)
        values[row] += rng.uniform(60, 200) * np.exp(-away / 3.0)
    own = examine_track(Track("a", np.rint(values), np.arange(2000) / 20))[0].findings
    assert not any("spikes" in one.text for one in own)


@pytest.mark.parametrize("pressed", [0, 160])
def test_taps_of_one_channel_and_two_rows_are_no_spikes_and_many_spikes_are(pressed):
    rng = np.random.default_rng(1)
    values = rng.uniform(100, 200, 12) + rng.normal(size=(1200, 12))
    for row in range(40, 1160, 37):
        values[row : row + 2, rng.integers(12)] += rng.uniform(400, 1200)
    for row in (210, 610, 1010):
        values[row : row + 20, rng.integers(12)] += pressed
    assert len(survey(Track("a", np.rint(values), np.arange(1200) / 20)).spikes) == 0
    felt = pokes(rng, side=5)
    felt += rng.normal(0.0, 0.01, felt.shape)
    felt[rng.permutation(len(felt))[:200], rng.integers(0, 25, 200)] = 100 * felt.max()
    assert len(survey(Track("a", felt, np.arange(len(felt)) / 50)).spikes) == 200


@pytest.mark.parametrize("spikes", [0, 1, 8, 40])
def test_noise_around_the_half_of_slow_loads_hides_no_spikes(spikes):
    rng = np.random.default_rng(0)
    values = rng.normal(0.0, 250.0, (6000, 40))
    for row in range(50, 5600, 400):
        spread = np.exp(-((np.arange(40) - rng.uniform(0, 40)) ** 2) / 4)
        load = rng.uniform(4500, 15000) * np.hanning(380)[:, None] ** 0.5
        values[row : row + 380] += load * spread
    values[rng.choice(5000, spikes, replace=False) + 100, 20] = 56000
    found = survey(Track("a", values, np.arange(6000) / 100)).spikes
    assert len(found) == spikes
    assert np.all(found[:, 1] == 20)


def test_one_limit_of_a_mat_is_named_with_all_channels_that_reach_it():
    rng = np.random.default_rng(0)
    at = np.indices((8, 8)).reshape(2, -1).T
    values = rng.normal(200.0, 3.0, (9000, 64))
    for begin in range(400, 8000, 1900):
        away = ((at - rng.uniform(3.0, 4.0, 2)) ** 2).sum(axis=1)
        sway = 1.0 + rng.normal(size=1700).cumsum() / 4000
        rows = np.minimum(20 * np.hanning(1700), 1.0) * sway
        values[begin : begin + 1700] += 2000.0 * rows[:, None] * np.exp(-away / 8)
    cut = np.minimum(values.round(), 1100.0)
    own = examine_track(Track("mat", cut, np.arange(9000) / 50))[0].findings
    reached = np.flatnonzero((cut == 1100.0).any(axis=0)).tolist()
    assert [(one.kind, one.value, one.channels) for one in own] == [("clipped", 1100.0, reached)]


def pressed(touches: int = 80, width: int = 10, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Values (t, n) above rest, without noise, of pokes on a square of taxels; begins (k,)."""
    rng = np.random.default_rng(seed)
    places = np.stack(np.divmod(np.arange(width**2), width), axis=1)
    load, begins = np.zeros((60 * touches + 60, width**2)), 60 * np.arange(touches) + 30
    for begin in begins:
        away = ((places - rng.uniform(-0.5, width - 0.5, 2)) ** 2).sum(axis=1)
        force = rng.uniform(200, 900) * np.hanning(30)[:, None]
        load[begin : begin + 30] += force * np.exp(-away / (2 * rng.uniform(1.0, 2.0) ** 2))
    return load, begins


@pytest.mark.parametrize("noise", [0.2, 1.0, 2.5])
def test_a_dead_channel_with_noise_is_found_and_seldom_touched_ones_are_not(noise):
    load, _ = pressed()
    rng = np.random.default_rng(6)
    values = 200 + load + rng.normal(0, 2.5, load.shape)
    values[:, 44] = 203 + rng.normal(0, noise, len(load))
    values = np.rint(values).astype(int)
    own = examine_track(Track("noise", values, np.arange(len(load)) / 50))[0].findings
    assert [(one.kind, one.channels) for one in own] == [("dead", [44])]


def test_words_of_a_file_or_of_rows_are_those_of_its_touches(tmp_path):
    load, begins = pressed(12)
    values = 200 + load + np.random.default_rng(3).normal(0, 2.5, load.shape)
    events = np.full(len(load), -1)
    for number, begin in enumerate(begins):
        events[begin : begin + 30] = number
    held = {"samples": values, "times": np.arange(len(load)) / 50, "labels": ["poke"] * 12}
    days = np.where(np.arange(len(load)) < begins[6], "mon", "tue")

    def track_with(**more):
        np.savez(tmp_path / "a.npz", **held | {"events": events} | more)
        return read_track(tmp_path / "a.npz")

    assert track_with(sessions="mon").sessions == ("mon",) * 12
    assert track_with(sessions=days).sessions == ("mon",) * 6 + ("tue",) * 6
    assert track_with(robot=np.zeros((len(load), 7)), part=events).robot == ""


def test_a_mended_copy_is_read_as_touches_of_its_robot_and_part(tmp_path):
    made = skinmap.simulate("kaspar", part="left_hand", per_gesture=2, rng=0)
    rows = np.sort(np.r_[: len(made.times), 40:60])
    several = {name: getattr(made, name)[rows] for name in ("times", "pressures", "events")}
    twice = replace(made, robot="kaspar", **several)
    skinmap.save_recordings(twice, tmp_path / "a.npz")
    assert run(tmp_path / "a.npz", "--mend", tmp_path / "b.npz")[0] == 3
    (found,) = read_recordings(tmp_path / "b.npz")
    assert (found.robot, found.part, found.labels) == ("kaspar", "left_hand", made.labels)
    assert (found.pressures == made.pressures).all()
    assert CliRunner().invoke(cli, ["info", str(tmp_path / "b.npz")]).exit_code == 0


def test_a_mended_copy_of_a_mapped_table_keeps_channels_and_seconds(tmp_path):
    said = 'robot = "kaspar"\npart = "left_hand"\ntime_unit = "ms"\nchannels = {b = 3, a = 1}\n'
    (tmp_path / "mapping.toml").write_text(said)
    lines = [f"{20 * k},{k % 7},{k % 5}" for k in range(200)]
    (tmp_path / "a.csv").write_text("\n".join(["time,a,b", *lines]))
    run(tmp_path / "a.csv", "--mend", tmp_path / "b.npz")
    with pytest.warns(skinmap.errors.SkinWarning):
        ((given,), (found,)) = (read_recordings(tmp_path / name) for name in ("a.csv", "b.npz"))
    assert found.times[-1] == pytest.approx(given.times[-1])
    assert (found.pressures == given.pressures).all()


def test_copies_under_load_are_found_on_a_skin_that_is_silent_at_rest(tmp_path):
    load, _ = pressed()
    rng = np.random.default_rng(7)
    values = np.rint(load / 4 + rng.normal(0, 1.5, load.shape))
    values = np.where(values < 8, 0, np.minimum(values, 255)).astype(np.int16)
    copies = np.sort(rng.choice(np.arange(1, len(load) - 1), len(load) // 10, replace=False))
    rows = np.sort(np.r_[: len(load), copies])
    np.savez(tmp_path / "a.npz", samples=values[rows], times=np.arange(len(rows)) / 50)
    loaded = (values[rows] > 0).sum(axis=1) >= 4
    truth = np.flatnonzero((np.diff(rows, prepend=-1) == 0) & loaded)
    (one,) = [one for one in skinmap.examine(tmp_path / "a.npz") if one.kind == "duplicate"]
    found = np.concatenate([np.arange(a, b + 1) for a, b in one.rows or []])
    assert np.isin(truth, found).mean() > 0.9
    assert np.isin(found[loaded[found]], truth).all()
    assert len(found) < 1.1 * len(truth)  # the silent pattern is left alone
    run(tmp_path / "a.npz", "--mend", tmp_path / "b.npz")
    assert run(tmp_path / "b.npz")[0] == 0
    sound = examine_track(Track("s", values, np.arange(len(values)) / 50))[0].findings
    assert "duplicate" not in [one.kind for one in sound]


def test_sessions_differ_at_rest_where_labels_cover_it_but_for_the_first_rows():
    load, begins = pressed(18)
    values = 200 + load + np.random.default_rng(8).normal(0, 2.5, load.shape)
    values[begins[12] :] += 60.0
    events = np.searchsorted(begins, np.arange(len(load)), side="right") - 1
    days = ("mon",) * 6 + ("tue",) * 6 + ("wed",) * 6
    whole = Track("s", values, np.arange(len(load)) / 50, events=events, sessions=days)
    own = examine_track(whole)[0].findings
    assert any("At rest, session wed differs" in one.text for one in own)


@pytest.mark.parametrize("touches", [1, 2, 6])
def test_sessions_of_few_touches_differ_at_rest_only_where_their_rest_does(touches):
    load, begins = pressed(3 * touches)
    rng = np.random.default_rng(8)
    values = 200 + load + rng.normal(0, 2.5, load.shape)
    events = np.full(len(load), -1)
    for number, begin in enumerate(begins):
        events[begin : begin + 30] = number
    days = np.repeat(("mon", "tue", "wed"), touches)
    whole = Track("s", values, np.arange(len(load)) / 50, events=events, sessions=tuple(days))
    assert "rest" not in [one.kind for one in examine_track(whole)[0].findings]
    moved = values + 60.0 * (np.arange(len(load)) > begins[2 * touches] - 15)[:, None]
    (one,) = [
        one for one in examine_track(replace(whole, values=moved))[0].findings
        if one.kind == "rest"
    ]  # fmt: skip
    assert one.rows == [[int(begins[2 * touches]), int(begins[-1]) + 29]]


@pytest.mark.parametrize(("wrong", "matters"), [(1, False), (6, True)])
def test_one_doubtful_touch_is_a_remark_and_several_wrong_labels_matter(wrong, matters):
    made, _ = labelled(np.random.default_rng(1), per=30)
    names = np.array(made.labels)
    for word, other in (("poke", "stroke"), ("stroke", "poke")):
        names[np.flatnonzero(np.array(made.labels) == word)[:wrong]] = other
    (found,) = examine_track(replace(made, labels=tuple(names.tolist())))[0].findings
    assert (found.kind, found.matters) == ("labels", matters)


def test_coarse_channels_of_whole_numbers_are_quantised_and_no_copies():
    load, _ = pressed()
    rng = np.random.default_rng(9)
    values = 200 + load + rng.normal(0, 2.5, load.shape)
    coarse = [44, 53]
    values[:, coarse] = 149.4 * np.rint(values[:, coarse] / 149.4)
    values = np.rint(values).astype(int)
    own = examine_track(Track("coarse", values, np.arange(len(values)) / 50))[0].findings
    assert [(one.kind, one.channels) for one in own] == [("quantised", coarse)]


def test_channels_between_rows_without_a_number_are_judged_and_three_sure_labels_matter():
    load, _ = pressed(20)
    values = 200 + load + np.random.default_rng(3).normal(0, 2.5, load.shape)
    values[np.arange(len(load)) % 4 != 0] = np.nan
    looked = survey(Track("a", values, np.arange(len(load)) / 50))
    found, bad = channel_faults(looked)
    assert [one.kind for one in found] == ["lost"]
    assert not bad.any()
    chances = [_tail(wrong, count, MISTAKEN) for wrong, count in ((3, 48), (2, 48), (1, 40))]
    assert chances[0] < DOUBTED < min(chances[1:])


def test_sessions_of_a_hand_that_seldom_rests_do_not_differ_by_what_it_holds():
    rows = np.arange(3000)
    events = np.where(rows % 150 < 60, rows // 150, -1)
    days = tuple(np.repeat(("mon", "tue", "wed", "thu"), 5))
    several = [replace(glove(seed), events=events, sessions=days) for seed in range(6)]
    assert not any(one.kind == "rest" for own in several for one in examine_track(own)[0].findings)
    offset = 600 * np.random.default_rng(1).choice([0, 1], (4, 120))[rows // 750]
    moved = [replace(one, values=one.values + offset) for one in several]
    found = [one.text for own in moved for one in examine_track(own)[0].findings]
    assert sum("sessions" in one for one in found) >= 4


def test_an_untouched_channel_at_the_floor_of_the_skin_is_not_stuck():
    load, begins = pressed(80, 12)
    idle = slice(begins[30], begins[45])
    load[idle, :60] = 0.0
    level = np.random.default_rng(2).normal(0, 0.8, load.shape)
    level[idle, 3] -= 5.0  # its rest drifts below 0, where the converter ends
    values = (load + level).clip(0).round().astype(int)
    own = examine_track(Track("silent", values, np.arange(len(load)) / 50))[0].findings
    assert "stuck" not in [one.kind for one in own]
