"""The check-up: planted faults come back, healthy skins pass, and wrong inputs are refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.calibration.person import Clumsiness, Patient, Person, parse_fault
from calibration.wiring import Baseline, Doctor, Fault, Wiring, boards_of, judge_rest, make_touch
from calibration.wiring.boards import GROUP, KINDS, compose, corrected
from calibration.wiring.examination import Case, Examination, Plan, examine_live, next_touch
from calibration.wiring.findings import _silent, findings, lines
from calibration.wiring.touches import Touch, find_touches
from skinmap.cli.main import cli
from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    OutputError,
    SkinError,
    SkinMismatchError,
    UnknownNameError,
)
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.taxels.taxel_table import read_taxels
from skinmap.live.sources.source import Block, SourceEnded, StreamInfo
from skinmap.touch.recording import Recording, load_recordings, save_recordings
from tests.calibration.asked_table import write_places

PART = "left_forearm"
WORDS = (
    "swap:3,7",
    "turn:5,240",
    "mirror:22",
    "mute:12",
    "chains:0,1",
    "reverse:0",
    "mute-chain:1",
)


@pytest.fixture(scope="module")
def boards(icub):
    return boards_of(icub, PART)


@pytest.fixture(scope="module")
def base(boards):
    return Doctor.of(boards)


@pytest.fixture(scope="module")
def patient(icub):
    return Patient(icub.skin(PART))


def person_with(words, boards, patient, seed=0):
    wiring = Wiring.as_mapped(boards)
    for word in words:
        wiring = parse_fault(word, boards).apply(wiring, boards)
    return Person(patient, np.random.default_rng(seed), wiring.sources(boards)), wiring


def examine(base, person, touches, how="poke", shuffled=None):
    """The doctor after some touches; `shuffled` gives the places made for each asked one."""
    doctor = base.again()
    rest = person.rest(300)
    doctor.rest(judge_rest(rest, base.boards))
    level = Baseline.of(rest, "pressure")
    for _ in range(touches):
        path, _ = doctor.next_place(how)
        made = path if shuffled is None else shuffled(path)
        samples = person.stroke(made) if how == "stroke" else person.poke(made[0])
        doctor.hear(make_touch(level.answers(samples), how, path))
    doctor.conclude()
    return doctor


def run(words, code=0):
    result = CliRunner().invoke(cli, ["checkup", *map(str, words), "--json"])
    assert result.exit_code == code, (result.output, result.exception)
    return json.loads(result.stdout)


def wired(result):
    """Faults of cables and modules; the simulated person's skin has dead taxels as well."""
    return [(f["kind"], f["modules"]) for f in result["faults"] if f["kind"] in KINDS]


def refused(words, error, match):
    result = CliRunner().invoke(cli, ["checkup", *map(str, words)])
    assert isinstance(result.exception, error), (result.output, result.exception)
    assert match in str(result.exception) or match in result.output


# The boards and what may happen to them.


def test_turns_and_mirrors_are_a_group():
    for after in range(6):
        for before in range(6):
            product = GROUP[compose(after, before)]
            np.testing.assert_allclose(product, GROUP[after] @ GROUP[before], atol=1e-12)


def test_turned_slots_lie_where_a_turn_carries_them(icub, boards):
    layout = icub.part(PART).layout
    felt = ~layout.thermal
    xy = layout.xy - layout.xy[felt].mean(axis=0)
    for element, slots in enumerate(boards.turns):
        gap = xy[felt] @ GROUP[element].T - xy[slots[felt]]
        # The 10-pad is drawn to 0.4 mm of a triangle's symmetry.
        assert np.linalg.norm(gap, axis=1).max() < 1e-3


def test_chains_are_connectors_of_sixteen_modules(icub):
    sizes = {"left_forearm": [16, 8], "torso": [7, 11, 15, 10]}
    for part, wanted in sizes.items():
        found = boards_of(icub, part)
        assert np.bincount(found.chains).tolist() == wanted


@pytest.mark.parametrize("word", WORDS)
def test_a_fault_twice_or_thrice_is_none(word, boards):
    if word.startswith("mute"):
        pytest.skip("what is mute stays mute")
    fault = parse_fault(word, boards)
    wiring = Wiring.as_mapped(boards)
    if word.startswith("chains"):  # 8 of the 16 modules have a counterpart on the shorter chain
        once = fault.apply(wiring, boards).sources(boards)
        assert (once == -1).sum() == 80
        return
    for _ in range(3 if word.startswith("turn") else 2):
        wiring = fault.apply(wiring, boards)
    np.testing.assert_array_equal(wiring.sources(boards), np.arange(len(boards.table)))


def test_a_rests_probabilities_are_shared_out(base):
    prior = np.exp(base.hypotheses.log_prior)
    assert prior.sum() == pytest.approx(1.0)
    assert prior[0] == pytest.approx(0.5)
    assert {fault.kind for fault in base.hypotheses.faults} == {"healthy", *KINDS}


# Touches.


@pytest.mark.parametrize("how", ["poke", "stroke"])
@pytest.mark.parametrize("word", WORDS)
def test_a_planted_fault_is_found_and_its_map_corrected(word, how, boards, base, patient):
    person, truth = person_with([word], boards, patient, seed=3)
    # Twice the pokes of the benchmark, which has the shares of what is found in fewer.
    doctor = examine(base, person, 24 if how == "poke" else 18, how)
    assert [found.fault for found in doctor.found] == [parse_fault(word, boards)]
    assert doctor.status == "faulty"
    table, moved = corrected(boards, doctor.wiring)
    places = truth.places(boards)
    rows = np.searchsorted(boards.table.channels, table.channels)
    np.testing.assert_array_equal(table.positions, places[rows])
    assert (len(moved) > 0) == (not word.startswith("mute"))


def test_two_faults_far_apart_are_found_one_after_the_other(boards, base, patient):
    words = ["swap:0,24", "turn:9,120"]
    person, _ = person_with(words, boards, patient, seed=5)
    doctor = examine(base, person, 24)
    assert {found.fault for found in doctor.found} == {parse_fault(w, boards) for w in words}


@pytest.mark.parametrize("how", ["poke", "stroke"])
def test_healthy_skins_pass(how, boards, base, patient):
    for seed in range(6):
        person, _ = person_with([], boards, patient, seed=100 + seed)
        doctor = examine(base, person, 12, how)
        assert not doctor.found
        assert doctor.status in ("healthy", "undecided")


def test_shuffled_places_name_no_fault(boards, base, patient, rng):
    """The control: answers that do not belong to their places are told from a fault."""
    for seed in range(3):
        person, _ = person_with([], boards, patient, seed=200 + seed)

        def anywhere(_):
            return patient.skin.positions[rng.integers(len(patient.skin))][None]

        doctor = examine(base, person, 12, shuffled=anywhere)
        assert doctor.status == "inconsistent"


def pressed(boards, place, dead, *, width=6e-3, force=120.0) -> Touch:
    """A round press [counts] at a place, on a skin of which one taxel is dead; no simulator's."""
    away = np.linalg.norm(boards.table.positions - place, axis=1)
    answer = np.where(np.arange(len(away)) == dead, 0.0, force * np.exp(-0.5 * (away / width) ** 2))
    return make_touch(answer[None], "poke", place[None])


@pytest.mark.parametrize("around", [True, False])
def test_a_dead_taxel_is_found_wherever_it_lies(boards, base, around):
    """Inside and at corners, poked three times: with its neighbours, or alone."""
    places = boards.table.positions
    near = np.linalg.norm(places[:, None] - places[None], axis=2) < 1.5 * boards.pitch
    count = near.sum(axis=1)  # itself too
    fewest = [int(row) for row in np.argsort(count, kind="stable") if count[row] > 2]
    for dead in (*fewest[:3], *fewest[60::60]):
        doctor = base.again()
        for row in 3 * np.flatnonzero(near[dead]).tolist() if around else [dead] * 3:
            doctor.hear(pressed(boards, places[row], dead))
        assert _silent(Case(PART, doctor)).tolist() == [dead]


def test_taxels_that_no_touch_reached_are_not_called_silent(boards, base):
    doctor = base.again()
    for _ in range(8):
        doctor.hear(pressed(boards, boards.table.positions[40], -1))
    assert len(_silent(Case(PART, doctor))) == 0


def test_pokes_of_a_palm_are_named_as_what_they_are(boards, base):
    """Places are right, and no finger presses so many channels."""
    case = Case(PART, base.again())
    for row in range(0, 60, 4):
        place = boards.table.positions[row]
        case.doctor.hear(pressed(boards, place, -1, width=25e-3))
    assert case.doctor.status == "inconsistent"
    assert case.doctor.broad == case.doctor.misfits == 15
    result = findings(Examination("made", "iCub", (case,), 30.0, ()))
    assert "press with one finger" in next(iter(lines(result)))


def test_a_repeated_place_says_less_each_time(boards, base, patient):
    person, _ = person_with([], boards, patient)
    level = Baseline.of(person.rest(300), "pressure")
    path, _ = base.again().next_place("poke")
    touch = make_touch(level.answers(person.poke(path[0])), "poke", path)
    steps = []
    doctor = base.again()
    before = doctor._log
    for _ in range(3):
        doctor.hear(touch)
        steps.append(float(np.ptp(doctor._log - before)))
        before = doctor._log
    np.testing.assert_allclose(steps, steps[0] / np.array([1.0, 2.0, 3.0]), rtol=1e-6)


def test_another_length_is_refused(base):
    touch = make_touch(np.zeros((5, 7)), "poke", np.zeros((1, 3)))
    with pytest.raises(InvalidArrayError, match="7 answers for the 240 taxels"):
        base.again().hear(touch)


def test_touches_are_cut_out_of_samples():
    answers = np.zeros((100, 4))
    answers[10:20, 1] = 80.0
    answers[50, 2] = 200.0  # one sample: a spike
    answers[70:90, 3] = 30.0
    assert find_touches(answers).tolist() == [[10, 19], [70, 89]]
    raw = 240.0 - answers
    level = Baseline.of(raw, "raw")
    assert level.answers(raw)[50].max() == 0.0
    np.testing.assert_array_equal(level.answers(raw)[10:20], answers[10:20])


# Rest.


def at_rest(rng, n, noise, samples=300):
    return np.rint(240 + rng.uniform(-5, 5, n) + rng.normal(0, noise, (samples, n)))


@pytest.mark.parametrize("noise", [0.5, 1.2, 3.0])
def test_a_rest_shows_what_is_stuck_mute_and_given_twice(noise, boards):
    for seed in range(10):
        rng = np.random.default_rng([seed, 4])
        samples = at_rest(rng, len(boards.table), noise)
        healthy = judge_rest(samples, boards)
        assert healthy.tells
        assert len(healthy.found) == len(healthy.mute) == 0
        samples[:, 5] = 255
        samples[:, 33] = samples[:, 170]
        samples[:, boards.columns[4][boards.columns[4] >= 0]] = 0
        found = judge_rest(samples, boards)
        assert sorted(found.rows("stuck") + found.rows("dead")) == [[5]]
        assert found.mute == (4,)
        assert found.rows("copied") == [[33, 170]]


def test_a_calm_rest_tells_nothing(boards):
    assert not judge_rest(np.zeros((300, len(boards.table))), boards).tells
    with pytest.raises(InvalidArrayError, match="at least 100"):
        judge_rest(np.zeros((20, len(boards.table))), boards)
    with pytest.raises(InvalidArrayError, match="5 values at rest for 240"):
        judge_rest(np.zeros((300, 5)), boards)
    with pytest.raises(InvalidArrayError, match="no channel of 'left_forearm' sends numbers"):
        judge_rest(np.full((300, len(boards.table)), np.nan), boards)


# Files and the command.


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, boards, base, patient):
    """A recording of 24 pokes on a skin with modules 3 and 7 swapped, and its places."""
    folder = tmp_path_factory.mktemp("wiring")
    person, truth = person_with(["swap:3,7"], boards, patient, seed=8)
    blocks, events, paths = [person.rest(300)], [np.full(300, -1)], []
    doctor = base.again()
    for number in range(24):
        path, _ = doctor.next_place("poke")
        samples = person.poke(path[0])
        level = Baseline.of(blocks[0], "pressure")
        doctor.hear(make_touch(level.answers(samples), "poke", path))
        paths.append(path)
        blocks += [samples, person.rest(40)]
        events += [np.full(len(samples), number), np.full(40, -1)]
    values, marks = np.concatenate(blocks), np.concatenate(events)
    times = np.arange(len(values)) / 50.0
    recording = Recording(PART, times, values, marks, ("poke",) * 24)
    save_recordings([recording], folder / "swap.npz")
    none = Recording(PART, times, values, np.full(len(values), -1), ())
    save_recordings([none], folder / "unmarked.npz")
    still = Recording(PART, times[:300], values[:300], np.full(300, -1), ())
    save_recordings([still], folder / "still.npz")
    write_places(paths, folder / "places.csv")
    return folder, truth, paths


def test_a_recording_with_places_is_examined(recorded, boards, tmp_path):
    folder, truth, _ = recorded
    out = tmp_path / "corrected.csv"
    result = run([folder / "swap.npz", "--places", folder / "places.csv", "-o", out])
    assert result["status"] == "faulty"
    assert wired(result) == [("swapped_modules", [3, 7])]
    assert result["faults"][0]["confidence"] > 0.99
    assert result["touches"] == 24
    table = read_taxels(out)
    np.testing.assert_array_equal(table.channels, boards.table.channels)
    np.testing.assert_array_equal(table.positions, truth.places(boards))
    before = out.read_bytes()
    refused([folder / "swap.npz", "--places", folder / "places.csv", "-o", out], OutputError,
            "is there already")  # fmt: skip
    assert out.read_bytes() == before
    inspected = CliRunner().invoke(
        cli, ["inspect", str(out), "--module", "triangle_10pad", "--json"]
    )
    assert inspected.exit_code == 0
    assert json.loads(inspected.stdout)["taxels"] == 240


def test_a_recording_without_places_is_judged_at_rest(recorded):
    folder, _, _ = recorded
    result = run([folder / "unmarked.npz"])
    assert (result["touches"], result["parts"][0]["rest_samples"] > 100) == (0, True)
    assert any("only the rest was judged" in note for note in result["notes"])


def test_shuffled_places_of_a_recording_exit_with_3(recorded, tmp_path):
    folder, _, paths = recorded
    order = np.random.default_rng(1).permutation(len(paths))
    write_places([paths[k] for k in order], tmp_path / "places.csv")
    result = run([folder / "swap.npz", "--places", tmp_path / "places.csv", "-o",
                  tmp_path / "map.csv"], code=3)  # fmt: skip
    assert result["status"] == "inconsistent"
    assert wired(result) == []
    assert not (tmp_path / "map.csv").exists()
    assert result["notes"][-1].startswith("no map was written")


def test_a_recording_without_touches_is_judged_by_its_rest(recorded):
    folder, _, _ = recorded
    result = run([folder / "still.npz"])
    assert result["touches"] == 0
    assert {f["kind"] for f in result["faults"]} <= {"dead", "stuck"}
    assert result["parts"][0]["rest_samples"] == 300
    assert "no touch" in result["notes"][-1]


def test_wrong_inputs_are_refused_in_a_line(recorded, tmp_path, patient):
    folder, _, paths = recorded
    swap = folder / "swap.npz"
    refused([swap, "--part", "tail"], UnknownNameError, "no part 'tail'")
    refused([swap, "--part", "torso"], UnknownNameError, "no part in")
    refused([tmp_path / "none.npz"], SkinError, "none.npz")
    refused(["sim:3", "--part", PART], SystemExit, "`sim` alone")
    refused(["sim", "--part", PART, "--plant", "mute:99"], InvalidArrayError, "itself; modules: ")
    refused([swap, "--plant", "swap:3,7"], SystemExit, "belongs to the simulated skin")
    refused(["sim", "--part", PART, "--plant", "swap:3,3"], InvalidArrayError, "with itself")
    refused(["sim", "--part", PART, "--plant", "melt:3"], UnknownNameError, "no fault 'melt'")
    refused(["sim", "--part", PART, "--plant", "dead:9999"], InvalidArrayError, "no such channel")
    refused(["sim", "--part", PART, "-o", tmp_path / "a.docx"], SystemExit, "not '.docx'")
    refused([swap, "--units", "cm"], SystemExit, "in metres")
    refused(["zmq:1", "--places", folder / "places.csv"], SystemExit, "belongs to a recording")
    write_places(paths[:5], tmp_path / "few.csv")
    refused([swap, "--places", tmp_path / "few.csv"], DataFormatError, "places for 5 touches")
    write_places([path + 0.3 for path in paths], tmp_path / "far.csv")
    refused([swap, "--places", tmp_path / "far.csv"], DataFormatError, "nearest taxel")
    with (tmp_path / "nan.csv").open("w") as file:
        csv.writer(file).writerows([["touch", "x", "y", "z"], [1, "nan", 0, 0]])
    refused([swap, "--places", tmp_path / "nan.csv"], DataFormatError, "nan")
    short = Recording(PART, np.arange(9) / 50, np.zeros((9, 7), np.uint8), np.full(9, -1), ())
    save_recordings([short], tmp_path / "short.npz")
    refused([tmp_path / "short.npz"], SkinMismatchError, "7 channels")


class Robot:
    """A live source of one part: rest, then the pokes of a recording, then Ctrl-C."""

    def __init__(self, samples, ends):
        self.info = StreamInfo("robot", (PART,), (samples.shape[1],), 50.0)
        self.samples, self.ends, self.sent = samples, ends, 0

    def read(self, timeout):
        if self.sent >= len(self.samples):
            raise self.ends
        values = self.samples[self.sent : self.sent + 10]
        self.sent += len(values)
        return Block(np.arange(len(values)) / 50.0, values, 0.0)

    def close(self):
        pass


def test_live_touches_are_heard_until_ctrl_c(boards, base, patient, icub):
    person, _ = person_with(["swap:3,7"], boards, patient, seed=8)
    samples, _ = blocks_of_touches(person, base, person.rest(250).astype(float))
    told = []
    plan = Plan(told=told.append)
    found = examine_live(Robot(samples, KeyboardInterrupt()), icub, [PART], plan)
    assert len(found.cases[0].doctor.touches) == 4
    assert "interrupted" in told
    assert found.notes[-1].startswith("interrupted")
    with pytest.raises(InvalidArrayError, match="ended before"):
        examine_live(Robot(samples, SourceEnded()), icub, [PART], plan)


def blocks_of_touches(person, base, rest, drift=lambda samples: samples, gap=48):
    """A rest, four touches where a doctor asks for them, and what comes between, drifting."""
    blocks, case = [rest], Case(PART, base.again())
    case.take_rest(rest)
    level = case.without_noisy(Baseline.of(rest, "pressure"))
    for _ in range(4):
        asked = next_touch({PART: case})
        made = person.poke(asked.path[0]) if asked.how == "poke" else person.stroke(asked.path)
        blocks.append(made.astype(float))
        case.doctor.hear(make_touch(level.answers(blocks[-1]), asked.how, asked.path))
        blocks.append(person.rest(gap + (-len(made)) % 10).astype(float))  # whole blocks of ten
    return drift(np.concatenate(blocks)), case.doctor


def test_a_channel_without_numbers_is_named_and_loses_no_touch(boards, base, patient, icub):
    person, _ = person_with([], boards, patient, seed=8)

    def holes(samples):
        samples[:, 12] = np.nan
        samples[::7, 30] = np.nan  # now and then: no fault
        return samples

    samples, _ = blocks_of_touches(person, base, holes(person.rest(250).astype(float)), holes)
    found = examine_live(Robot(samples, KeyboardInterrupt()), icub, [PART], Plan())
    assert len(found.cases[0].doctor.touches) == 4
    result = findings(found)
    channel = int(boards.table.channels[12])
    (one,) = [f for f in result.faults if channel in f.channels]
    assert one.kind == "dead"
    assert any(f"taxel {channel} of {PART}: never answers" in line for line in lines(result))


def test_a_live_baseline_follows_drift(boards, base, patient, icub):
    """Warming up by 40 counts in 50 s: more than three times what an answer is."""
    person = Person(patient, np.random.default_rng(8), clumsiness=Clumsiness(spikes=0.0))

    def warm(samples):
        return samples + np.linspace(0.0, 40.0, len(samples))[:, None]

    samples, asked = blocks_of_touches(person, base, person.rest(250).astype(float), warm, gap=500)
    found = examine_live(Robot(samples, KeyboardInterrupt()), icub, [PART], Plan())
    heard = found.cases[0].doctor.touches
    assert len(heard) == 4
    for touch, wanted in zip(heard, asked.touches, strict=True):
        # It lags by 1.2 counts, and is the largest of more samples with noise of 1.2; 12 answer.
        np.testing.assert_allclose(touch.response, wanted.response, rtol=0, atol=8.0)


def test_a_recording_that_drifts_and_has_holes_is_examined(recorded, icub, tmp_path):
    folder, _, _ = recorded
    plain = load_recordings(folder / "swap.npz")[0]
    file = McapRecording(tmp_path / "drift.mcap", parts=[PART], widths={"pressure": [240]},
                         rate=50.0, skins={PART: icub.skin(PART)})  # fmt: skip
    warm = np.linspace(0.0, 60.0, len(plain.times))
    for time, sample, drift in zip(plain.times, plain.pressures, warm, strict=True):
        values = sample + drift
        values[12] = np.nan
        file.add("pressure", time, values)
    file.close()
    result = run([tmp_path / "drift.mcap", "--places", folder / "places.csv"])
    assert result["touches"] == 24
    assert wired(result) == [("swapped_modules", [3, 7])]
    dead = [f["channels"] for f in result["faults"] if f["kind"] == "dead"]
    assert [int(icub.skin(PART).channels[12])] in dead


def test_a_faults_words_and_channels(boards):
    fault = parse_fault("swap:3,7", boards)
    assert fault.words(boards) == f"modules 3 and 7 of {PART} exchanged: swap their plugs"
    assert len(fault.channels(boards)) == 20
    assert Fault("healthy").words(boards) == "nothing is wrong"


def test_the_example_names_what_its_truth_says():
    folder = Path(__file__).parents[2] / "docs" / "examples" / "board" / "wiring"
    truth = json.loads((folder / "truth.json").read_text())
    words = [folder / "pokes.mcap", "--part", truth["part"]]
    result = run([*words, "--places", folder / "places.csv"])
    assert wired(result) == [(truth["kind"], truth["modules"])]


# The whole check-up, on the simulated person.


@pytest.mark.parametrize(
    ("plant", "kind", "channels"),
    [("mute:7", "mute_module", 10), ("swap:3,7", "swapped_modules", 20), ("dead:12", "dead", 1),
     ("noisy:31", "noisy", 1), ("stuck:101", "stuck", 1)],
)  # fmt: skip
def test_a_minute_names_the_planted_fault(plant, kind, channels):
    result = run(["sim", "--part", PART, "--plant", plant])
    assert result["status"] == "faulty"
    assert [(f["kind"], len(f["channels"])) for f in result["faults"]] == [(kind, channels)]
    assert PART in result["faults"][0]["words"]
    assert len(result["faults"][0]["place_mm"]) == 3
    assert result["skin_seconds"] < 65.0  # the last touch may end after the minute


def test_a_healthy_skin_is_green():
    result = run(["sim", "--part", PART])
    assert result["status"] == "healthy"
    assert result["faults"] == []


def test_the_page_is_one_pdf_with_real_text(tmp_path):
    run(["sim", "--part", PART, "--plant", "mute:7", "-o", tmp_path / "report.pdf"])
    data = (tmp_path / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF")
    assert data.count(b"/Type /Page\n") + data.count(b"/Type /Page ") == 1
    assert b"/FontFile2" in data  # TrueType: text stays text
    result = run(["sim", "--part", PART, "--plant", "swap:3,7", "-o", tmp_path / "both"])
    assert sorted(Path(f).name for f in result["files"]) == ["checkup.pdf", f"{PART}.csv"]
    again = ["sim", "--part", PART, "--plant", "swap:3,7", "-o", tmp_path / "both"]
    refused(again, OutputError, "is there already")


def test_the_old_name_answers(recorded):
    result = CliRunner().invoke(cli, ["wiring", str(recorded[0] / "still.npz")])
    assert result.exit_code == 0
    assert "wiring" not in cli.list_commands(None)
