"""Loads: planted pressures come back in bar with intervals that hold, zeros move, files refuse."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from calibration.response.load_fit import Pressed, fit_load
from skinmap.cli.main import cli
from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    SkinError,
    SkinMismatchError,
    SkinWarning,
)
from skinmap.touch.load_calibration import LoadCalibration

N, RATE = 24, 50.0
DEAD, STRAY = 5, 9


def chamber(seed, *, shift=0.0, rows=9000, top=3.0, rest=400):
    """Counts (t, N) of foam with a loop under a chamber's pressure (t,): taxel 5 dead, 9 stray.

    `shift` moves the zero of all taxels [bar], as another day does.
    """
    day = np.random.default_rng(seed)
    skin = np.random.default_rng(0)  # the same skin every day
    knots = day.uniform(0, top, (rows - 2 * rest) // 150 + 1)
    knots[0], knots[-1] = 0.0, 0.0
    knots[len(knots) // 2] = top
    pressure = np.zeros(rows)
    pressure[rest:-rest] = np.interp(
        np.arange(rows - 2 * rest), np.linspace(0, rows - 2 * rest, len(knots)), knots
    )
    loop, now = np.empty(rows), 0.0
    for row, value in enumerate(pressure):
        now = min(max(now, value - 0.2), value + 0.2)
        loop[row] = now
    gains, base = skin.uniform(18, 40, N), skin.uniform(235, 245, N)
    felt = 0.8 * pressure + 0.2 * loop + shift
    bent = felt - 0.06 * felt**2
    counts = base - np.outer(bent, gains) + day.normal(0, 0.4, (rows, N))
    counts[:, DEAD], counts[:, STRAY] = 240, day.integers(0, 255, rows)
    return np.clip(counts.round(), 0, 255).astype(np.uint8), pressure


@pytest.fixture(scope="module")
def fit():
    samples, pressure = chamber(1)
    return fit_load([Pressed("own.npz", samples, RATE, pressure)])


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def write(name, seed=1, *, drop=(), shift=0.0, **arrays):
        samples, pressure = chamber(seed, shift=shift)
        held = {"samples": samples, "times": np.arange(len(samples)) / RATE,
                "pressure_bar": pressure} | arrays  # fmt: skip
        np.savez(tmp_path / name, **{key: held[key] for key in held if key not in drop})
        return str(tmp_path / name)

    return write


def run(*words, code=0):
    result = CliRunner().invoke(cli, [str(word) for word in words])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def refused(*words):
    """The one line of a refusal."""
    result = CliRunner().invoke(cli, [str(word) for word in words])
    assert result.exit_code
    if isinstance(result.exception, SkinError):  # the program prints it and exits with 2
        return str(result.exception)
    assert result.exit_code == 2
    return result.stderr


def test_hysteresis_is_found_and_faults_are_left_out(fit):
    assert fit.calibration.model == "hysteresis"
    assert (fit.dead, fit.stray) == ([DEAD], [STRAY])
    assert fit.held_out["hysteresis"] < 0.75 * fit.held_out["cubic"] < fit.held_out["linear"]
    own = np.delete(np.arange(N), [DEAD, STRAY])
    # A count is 3 bar / 60 counts = .05 bar here, its rounding .015; the running mean trails .25 s.
    assert np.median(fit.calibration.error[own]) < 0.06


def taps(seed, *, rows=6000):
    """Counts (t, 12) that follow a pressure (t,) of taps at once, and that pressure."""
    rng, pressure = np.random.default_rng(seed), np.zeros(rows)
    for start in range(200, rows - 100, 60):
        pressure[start : start + int(rng.integers(6, 25))] = rng.uniform(0.3, 2.0)
    gains = np.random.default_rng(0).uniform(30, 60, 12)
    counts = 240 - np.outer(pressure, gains) + rng.normal(0, 0.4, (rows, 12))
    return np.clip(counts.round(), 0, 255).astype(np.uint8), pressure


def test_brief_loads_keep_their_height(tmp_path):
    samples, pressure = taps(1)
    fit = fit_load([Pressed("taps.npz", samples, RATE, pressure)])
    assert fit.calibration.mean_s < 0.1
    (tmp_path / "load.npz").write_bytes(fit.calibration.to_bytes())
    other, truth = taps(2)
    felt = LoadCalibration.read(tmp_path).pressures(other)[0][truth > 0]
    truth_then = truth[truth > 0][:, None]
    assert np.nanmedian(np.abs(felt - truth_then)) < 0.05
    # The control: half a second's mean, which slow loads in coarse counts want, misses them.
    blunt = replace(fit.calibration, mean_s=0.5).pressures(other)[0][truth > 0]
    assert np.nanmedian(np.abs(blunt - truth_then)) > 0.3


def test_slow_loads_in_coarse_counts_are_averaged(fit):
    assert fit.calibration.mean_s >= 0.1


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_another_day_is_zeroed_and_intervals_hold(fit, shift):
    samples, pressure = chamber(2, shift=shift, top=2.4)
    values, low, high = fit.calibration.pressures(samples, np.arange(len(samples)) / RATE)
    own = np.delete(np.arange(N), [DEAD, STRAY])
    assert np.isnan(values[:, [DEAD, STRAY]]).all()
    error = np.sqrt(np.nanmean((values[:, own] - pressure[:, None]) ** 2, axis=0))
    assert error.mean() < 0.10
    inside = (low <= pressure[:, None]) & (pressure[:, None] <= high)
    assert inside[:, own].mean() > 0.85
    assert np.nanmean(high - low) < 0.6
    if shift:  # the control: without a zero the day is off by its shift
        kept, *_ = fit.calibration.pressures(samples, zero="none")
        assert np.sqrt(np.nanmean((kept[:, own] - pressure[:, None]) ** 2)) > 0.2


def test_intervals_hold_where_gains_differ_from_day_to_day(fit):
    rng, own, held = np.random.default_rng(8), np.delete(np.arange(N), [DEAD, STRAY]), []
    for day in range(8):
        samples, pressure = chamber(20 + day, top=2.4)
        rest = samples[:300].mean(axis=0)
        gain = 1.0 + rng.normal(0, 0.026) + rng.normal(0, 0.026, N)
        _, low, high = fit.calibration.pressures(np.rint(rest + (samples - rest) * gain))
        known = np.isfinite(low[:, own])
        pressed = known & (pressure > 1.0)[:, None]
        inside = (low <= pressure[:, None]) & (pressure[:, None] <= high)
        held.append(inside[:, own][pressed].mean())
    assert 0.85 <= np.mean(held) <= 0.98


def test_above_the_calibrated_range_is_refused(fit):
    samples, pressure = chamber(3, top=4.0)
    values, *_ = fit.calibration.pressures(samples)
    assert np.isnan(values[pressure > 3.4]).all()
    assert np.nanmax(values) < 3.2
    own = np.delete(np.arange(N), [DEAD, STRAY])
    # Within the range they answer: a hard press does not condemn a skin for its session.
    assert np.isfinite(values[pressure < 2.7][:, own]).mean() > 0.97


def test_a_taxel_that_dies_later_is_refused_for_its_session(fit):
    samples, _ = chamber(2)
    samples[:, 3] = 240
    values, *_ = fit.calibration.pressures(samples)
    assert np.isnan(values[:, 3]).all()
    assert np.isfinite(values[:, 4]).any()


def test_rest_after_load_alone_sets_no_zero(fit):
    samples, _ = chamber(2)
    begun = samples[3000:]
    while fit.calibration.session(begun, RATE).zeroed:  # begin higher
        begun = begun[37:]
    np.testing.assert_array_equal(fit.calibration.session(begun, RATE).shift, np.zeros(N))


def test_a_stream_reads_what_a_recording_reads(fit):
    samples, _ = chamber(2)
    whole, low, high = fit.calibration.pressures(samples[:300], zero="none")
    stream = fit.calibration.stream(fit.calibration.rate)
    rows = [stream.update(sample) for sample in samples[:300]]
    np.testing.assert_allclose([row[0] for row in rows], whole, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose([row[2] for row in rows], high, rtol=1e-5, atol=1e-5)
    assert np.all(np.isnan(low) == np.isnan(whole))


def test_counts_that_rise_fit_as_well(fit):
    samples, pressure = chamber(1)
    rising = fit_load([Pressed("r.npz", 255 - samples, RATE, pressure)])
    np.testing.assert_allclose(
        rising.calibration.error, fit.calibration.error, rtol=1e-6, equal_nan=True
    )


@pytest.mark.parametrize("factor", [3.0, 1.35, 0.7])
def test_recordings_that_contradict_each_other_are_named(factor):
    samples, pressure = chamber(1)
    other, more = chamber(2)
    evidence = [Pressed("a.npz", samples, RATE, pressure)]
    with pytest.raises(InvalidArrayError, match=r"a\.npz and b\.npz contradict each other"):
        fit_load([*evidence, Pressed("b.npz", other, RATE, factor * more)])


def test_recordings_ten_percent_apart_contradict_nobody():
    samples, pressure = chamber(1)
    other, more = chamber(2)
    evidence = [Pressed("a.npz", samples, RATE, pressure)]
    fit_load([*evidence, Pressed("b.npz", other, RATE, 1.1 * more)])


@pytest.mark.parametrize("counts", [-20, 20])
def test_rest_that_moves_is_warned_of(files, tmp_path, counts):
    """Foam that keeps a part of its load does the same: the fit stays, its user decides."""
    warming = np.linspace(0, counts, 9000)[:, None].round()
    path = files("warm.npz", samples=np.clip(chamber(1)[0] + warming, 0, 255))
    with pytest.warns(SkinWarning, match=r"warm\.npz: rest moves by"):
        run("calibrate", "load", path, "-o", tmp_path / "out")


def test_rest_that_stands_is_not(files, tmp_path):
    run("calibrate", "load", files("calm.npz"), "-o", tmp_path / "calm")  # no warning


def test_falling_and_rising_counts_contradict_each_other():
    samples, pressure = chamber(1)
    other, more = chamber(2)
    with pytest.raises(InvalidArrayError, match=r"b\.npz contradicts a\.npz: under load"):
        fit_load(
            [Pressed("a.npz", samples, RATE, pressure), Pressed("b.npz", 255 - other, RATE, more)]
        )


def test_channels_in_another_order_contradict_each_other():
    samples, pressure = chamber(1)
    other, more = chamber(2)
    evidence = [Pressed("a.npz", samples, RATE, pressure), Pressed("b.npz", other, RATE, more)]
    fit_load(evidence)
    gains = np.random.default_rng(2).permutation(np.linspace(0.75, 1.25, N))  # of another day
    away = other - np.median(other[:300], axis=0)
    other = np.clip(other + away * (gains - 1.0), 0, 255).round().astype(np.uint8)
    fit_load([evidence[0], replace(evidence[1], samples=other)])
    evidence[1] = replace(evidence[1], samples=other[:, ::-1])
    with pytest.raises(InvalidArrayError, match=r"a\.npz and b\.npz .* in the same order"):
        fit_load(evidence)


def test_files_come_back(fit, tmp_path):
    file = tmp_path / "load.npz"
    file.write_bytes(fit.calibration.to_bytes())
    samples, _ = chamber(2)
    for path in (file, tmp_path):
        again = LoadCalibration.read(path)
        np.testing.assert_array_equal(
            again.pressures(samples)[0], fit.calibration.pressures(samples)[0]
        )
    with pytest.raises(MissingFileError):
        LoadCalibration.read(tmp_path / "none")
    file.write_bytes(file.read_bytes()[:500])
    with pytest.raises(DataFormatError, match="not a calibration of loads"):
        LoadCalibration.read(file)
    with pytest.raises(SkinMismatchError, match="23 taxels, calibrated are 24"):
        fit.calibration.pressures(samples[:, 1:])


def test_commands_from_evidence_to_predictions(files, tmp_path):
    evidence, other = files("own.npz"), files("other.npz", 2, shift=0.2)
    out = tmp_path / "load"
    found = json.loads(run("calibrate", "load", evidence, "-o", out, "--json").stdout)
    assert (found["status"], found["model"], found["answered"]) == ("ok", "hysteresis", N - 2)
    assert found["files"] == ["load.npz", "report.html"]
    (clock,) = found["clocks"]
    assert abs(clock["offset_rows"]) < 15
    assert "rows" in run("calibrate", "load", evidence, "-o", out).stdout
    words = ("evaluate", "--protocol", "load", out, other, "--json", "--predictions")
    first, second = tmp_path / "p.npz", tmp_path / "q.npz"
    (row,) = json.loads(run(*words, first).stdout)["rows"]
    assert row["rms_bar"] < 0.12
    assert row["holds"] > 0.85
    assert {"recording", "width_bar", "refused"} <= set(row)
    noise = np.random.default_rng(3).normal(0, 0.003, 9000)  # of the reference at rest
    files("other.npz", 2, shift=0.2, pressure_bar=chamber(2)[1] + noise)
    (noisy,) = json.loads(run(*words, second).stdout)["rows"]
    assert noisy["holds"] > row["holds"] - 0.01
    for pressure in (np.zeros(9000), np.random.default_rng(0).uniform(0, 3, 9000)):
        files("other.npz", 2, shift=0.2, pressure_bar=pressure)
        (row,) = json.loads(run(*words, second, "--force").stdout)["rows"]
        assert row["rms_bar"] is None
        with np.load(first) as before, np.load(second) as after:
            for name in ("pressure_bar", "low", "high", "times"):
                np.testing.assert_array_equal(before[name], after[name])
            assert before["pressure_bar"].shape == (9000, N)
    shown = CliRunner().invoke(cli, [str(one) for one in words[:5]]).stdout
    assert "other.npz: not judged: at the best lag" in shown
    files("other.npz", samples=chamber(2)[0][:40], pressure_bar=chamber(2)[1][400:440],
          times=np.arange(40) / RATE)  # fmt: skip
    (row,) = json.loads(run(*words, second, "--force").stdout)["rows"]
    assert row["unexplained"] is None
    assert "40 samples and 40 rows of a reference" in row["reason"]
    files("other.npz", 2, shift=0.2)
    kept = LoadCalibration.read(out)
    zeroed = json.loads(run("calibrate", "rest", other, "-o", out, "--json").stdout)
    assert abs(zeroed["shared_bar"] - 0.2) < 0.08
    assert not np.array_equal(LoadCalibration.read(out).shift, kept.shift)
    run("calibrate", "rest", other, "-o", out, "--zero", "none")
    np.testing.assert_array_equal(LoadCalibration.read(out).shift, np.zeros(N))


def test_units_are_one(files, tmp_path):
    _, pressure = chamber(1)
    for name, scale in (("pressure_kpa", 1e2), ("pressure_pa", 1e5)):
        file = files("unit.npz", drop=("pressure_bar",), **{name: scale * pressure})
        words = ("calibrate", "load", file, "-o", tmp_path / name, "--json")
        assert abs(json.loads(run(*words).stdout)["top_bar"] - 3.0) < 0.01


def test_a_mass_on_its_footprint_is_a_pressure(files, tmp_path):
    _, pressure = chamber(1)
    held, area = np.arange(0, 24, 2), 30.0
    mass = pressure * 1e5 * area * 1e-6 * len(held) / 9.80665
    named = {"mass_kg": mass, "footprint": held}
    file = files("mass.npz", drop=("pressure_bar",), **named)
    words = ("calibrate", "load", file, "-o", tmp_path / "out", "--json")
    assert "needs --area-mm2" in refused(*words)
    found = json.loads(run(*words, "--area-mm2", area).stdout)
    assert abs(found["top_bar"] - 3.0) < 0.01
    own = LoadCalibration.read(tmp_path / "out").answered
    np.testing.assert_array_equal(np.flatnonzero(own), held)
    # Taxels without a load are sound, as far as is known; a calibration of a third is refused.
    assert (found["status"], found["dead"], found["stray"]) == ("ok", [], [])
    np.testing.assert_array_equal(found["unloaded"], np.arange(1, 24, 2))
    files("mass.npz", drop=("pressure_bar",), **(named | {"footprint": held[:8]}))
    found = json.loads(run(*words, "--area-mm2", area, "--force", code=3).stdout)
    assert found["status"] == "low_coverage"
    assert "on 16 of 24 taxels" in found["reasons"][0]


@pytest.mark.parametrize("scale", [102.0, 1000.0], ids=["grams", "millinewtons"])
def test_forces_that_no_skin_feels_are_in_another_unit(files, tmp_path, scale):
    force = scale * chamber(1)[1] * 1e5 * 30e-6 * N
    file = files("f.npz", drop=("pressure_bar",), force_n=force, channels=np.arange(N))
    words = ("calibrate", "load", file, "-o", tmp_path / "out", "--area-mm2", 30)
    assert "1 kg is 9.81 N, 1 N is 1000 mN" in refused(*words)


def test_a_load_cell_reads_zero_at_rest_and_its_contact_is_uneven(files, tmp_path):
    force = chamber(1)[1] * 1e5 * 30e-6 * N  # to 216 N
    words = ("calibrate", "load", tmp_path / "f.npz", "-o", tmp_path / "out", "--area-mm2", 30)
    for shown, told in ((force + 22, "10 % of its range"), (force - 22, "while the skin rests"),
                        (216 - force, "fall under load")):  # fmt: skip
        files("f.npz", drop=("pressure_bar",), force_n=shown, channels=np.arange(N))
        assert told in refused(*words)
    files("f.npz", drop=("pressure_bar",), force_n=force + 6, channels=np.arange(N))
    found = json.loads(run(*words, "--json").stdout)
    assert found["rest_bar"] == pytest.approx({"f.npz": 6 / 72}, abs=1e-5)
    assert found["top_bar"] == pytest.approx(3.0 + 6 / 72, abs=0.01)  # noted, and not taken off
    assert found["top_n"] == pytest.approx(222.0)
    # A pad that presses unevenly: the interval of a single taxel holds it.
    found = LoadCalibration.read(tmp_path / "out").pressures(chamber(1)[0])
    value, low, high = (one[:, 0][found[0][:, 0] > 2.0] for one in found)
    assert np.median((high - low) / value) == pytest.approx(2 * 1.645 * 0.2, rel=0.1)


@pytest.mark.parametrize(
    ("arrays", "drop", "words"),
    [
        ({"pressure_bar": chamber(1)[1] + 1.013}, (), "an absolute pressure"),
        ({"times": 20.0 * np.arange(9000)}, (), "0.05 samples a second"),
        (
            {"times": 2e-4 * np.arange(2000), "samples": chamber(1)[0][:2000]},
            (),
            "too short for rest",
        ),
        ({"pressure_bar": np.full(9000, 1.0)}, (), "never moves"),
        ({"pressure_bar": np.zeros(0)}, (), "pressure_bar is empty"),
        ({"pressure_bar": chamber(1)[1] * 1e5}, (), "reaches 3e+05 bar"),
        ({"pressure_pa": chamber(1)[1]}, ("pressure_bar",), "reaches 3e-05 bar"),
        ({"pressure_psi": np.ones(9000)}, ("pressure_bar",), "another unit"),
        ({"pressure_mmHg": np.ones(9000)}, ("pressure_bar",), "another unit"),
        ({"pressure_bar": np.linspace(0, 3, 900)}, (), "900 rows for 9000 samples"),
        ({}, ("times",), "no array 'times'"),
        ({}, ("pressure_bar",), "needs one reference"),
        ({"samples": np.full((9000, 4), np.nan)}, (), "hold NaN"),
        ({"samples": np.full((9000, 4), 255)}, (), "no channel moves"),
        ({"pressure_bar": np.random.default_rng(1).uniform(0, 3, 9000)}, (), "do not align"),
        ({"mass_kg": np.linspace(0, 5, 9000)}, ("pressure_bar",), "needs `footprint"),
        ({"prints": np.ones(3)}, ("pressure_bar",), "prints need `events (t,)`"),
        ({"pressure_bar": np.linspace(0, 300000, 9000)}, (), "another unit"),
        ({"pressure_bar": np.linspace(0, 44, 9000)}, (), "psi"),
        ({"pressure_bar": np.linspace(0, -3, 9000)}, (), "a load is positive"),
        ({"pressure_bar": np.r_[np.nan, np.ones(8999)]}, (), "NaN or infinity, first in row 0"),
        ({"channels": np.arange(12)}, (), "12 of 24 channels"),
        ({"samples": np.maximum(chamber(1)[0], 210)}, (), "are saturated"),
        ({"samples": np.maximum(chamber(1)[0], 228)}, (), "23 channels stand at one end"),
    ],
)
def test_bad_evidence_is_one_line(files, tmp_path, arrays, drop, words):
    file = files("bad.npz", drop=drop, **arrays)
    line = refused("calibrate", "load", file, "-o", tmp_path / "out")
    assert words in line
    assert "\n" not in line
    assert not (tmp_path / "out").exists()


def test_times_of_a_reference_are_advised_where_there_are_none(files, tmp_path):
    noise = np.random.default_rng(1).uniform(0, 3, 9000)
    for more, advised in (({}, True), ({"reference_times": np.arange(9000) / RATE}, False)):
        line = refused(
            "calibrate", "load", files("bad.npz", pressure_bar=noise, **more), "-o", tmp_path / "o"
        )
        assert "do not align" in line
        assert ("give reference_times" in line) == advised


def test_options_that_make_no_sense_are_refused(files, tmp_path):
    file = files("own.npz")
    words = ("calibrate", "load", file, "-o", tmp_path / "out")
    assert "--area-mm2" in refused(*words, "--area-mm2", "0")
    assert "240 taxels, the samples 24 channels" in refused(*words, "--part", "left_forearm")
    assert "expected a calibration" in refused("calibrate", "rest", file, "-o", tmp_path / "none")
    assert "MODEL RECORDING" in refused("evaluate", "--protocol", "load", file)
    assert not (tmp_path / "out").exists()


def test_tables_are_read(tmp_path, files):
    samples, pressure = chamber(1)
    table = np.column_stack([np.arange(9000) / RATE, pressure, samples])
    head = ",".join(["time", "pressure_bar", *(f"c{k}" for k in range(N))])
    np.savetxt(tmp_path / "own.csv", table, delimiter=",", header=head, comments="", fmt="%.4f")
    words = ("calibrate", "load", tmp_path / "own.csv", "-o", tmp_path / "out", "--json")
    assert json.loads(run(*words).stdout)["answered"] == N - 2
    head = head.replace("pressure_bar", "force_n")
    np.savetxt(tmp_path / "cell.csv", table, delimiter=",", header=head, comments="", fmt="%.4f")
    line = refused("calibrate", "load", tmp_path / "cell.csv", "-o", tmp_path / "cell")
    assert "needs `channels (k,)`" in line
    assert "only an .npz file" in line


def bag(path, topics):
    """A recording of ROS 2 in MCAP: by topic its type, times [ns] and messages."""
    from mcap.writer import Writer

    from skinmap.io.ros2.messages import definition, full_name, write

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, (kind, stamps, messages) in topics.items():
            schema = writer.register_schema(full_name(kind), "ros2msg", definition(kind))
            channel = writer.register_channel(topic, "cdr", schema)
            for stamp, fields in zip(stamps, messages, strict=True):
                data = write(kind, *fields)
                writer.add_message(channel, int(stamp), data, int(stamp))
        writer.finish()
    return path


def skin_topic(samples):
    """Samples as a bag has them, from 7 s on."""
    from skinmap.io.ros2.messages import build

    layout = build("std_msgs/MultiArrayLayout", [], 0)
    stamps = 7e9 + 1e9 * np.arange(len(samples)) / RATE
    return "std_msgs/UInt8MultiArray", stamps, [(layout, row) for row in samples]


def chamber_topic(pressure, *, later=0.0, above=101_325.0):
    """An absolute pressure with a clock of its own, at half the rate."""
    from skinmap.io.ros2.messages import header

    stamps = (7e9 + 1e9 * (np.arange(0, len(pressure), 2) / RATE + later)).astype(np.int64)
    values = 1e5 * pressure[::2] + above
    messages = [(header(int(t), "bag"), float(v), 0.0) for t, v in zip(stamps, values, strict=True)]
    return "sensor_msgs/FluidPressure", stamps + 10**12, messages  # recorded much later


def test_a_bag_teaches_what_its_arrays_do(files, tmp_path):
    samples, pressure = chamber(1, rows=4500)
    topics = {"/skin": skin_topic(samples), "/bag/pressure": chamber_topic(pressure, later=0.4)}
    own = bag(tmp_path / "own.mcap", topics)
    found = json.loads(run("calibrate", "load", own, "-o", tmp_path / "out", "--json").stdout)
    arrays = files(
        "same.npz", samples=samples, times=np.arange(4500) / RATE, pressure_bar=pressure[::2],
        reference_times=np.arange(0, 4500, 2) / RATE + 0.4,
    )  # fmt: skip
    same = json.loads(run("calibrate", "load", arrays, "-o", tmp_path / "in", "--json").stdout)
    assert found["answered"] == same["answered"] == N - 2
    assert found["top_bar"] == pytest.approx(same["top_bar"], abs=1e-3)
    assert found["error_bar"] == pytest.approx(same["error_bar"], rel=0.02)


def test_a_bag_without_one_skin_and_one_reference_is_one_line(tmp_path):
    samples, pressure = chamber(1, rows=900)
    skin, load = skin_topic(samples), chamber_topic(pressure)
    force = ("std_msgs/Float64", skin[1], [(float(one),) for one in pressure])
    for name, topics, words in (
        ("skin", {"/skin": skin}, "needs one reference"),
        ("load", {"/load": load}, "no array 'samples'"),
        ("twice", {"/left": skin, "/right": skin, "/load": load}, "two topics of samples"),
        ("both", {"/skin": skin, "/load": load, "/cell/force_n": force}, "force_n"),
    ):
        line = refused("calibrate", "load", bag(tmp_path / f"{name}.mcap", topics), "-o", "out")
        assert words in line
        assert "\n" not in line


def test_taxels_whose_rest_moved_far_are_named(fit, tmp_path):
    (tmp_path / "load.npz").write_bytes(fit.calibration.to_bytes())
    rest = chamber(1)[0][:200].astype(float)
    rest[:, [3, 7]] -= 25
    np.savez(tmp_path / "rest.npz", samples=rest, times=np.arange(200) / RATE)
    words = ["calibrate", "rest", tmp_path / "rest.npz", "-o", tmp_path / "load.npz"]
    assert "(does something press?): 3, 7\n" in run(*words).stdout
    assert json.loads(run(*words, "--json").stdout)["far"] == [3, 7]


def test_a_recording_of_ours_renews_the_rest(files, tmp_path):
    from skinmap.io.mcap.writing import McapRecording

    run("calibrate", "load", files("own.npz"), "-o", tmp_path / "out")
    file = McapRecording(tmp_path / "rest.mcap", parts=["a"], widths={"raw": [N]}, rate=RATE)
    for row, sample in enumerate(chamber(2, shift=0.1)[0][:300]):
        file.add("raw", row / RATE, sample)
    file.close()
    words = ("calibrate", "rest", tmp_path / "rest.mcap", "-o", tmp_path / "out")
    assert json.loads(run(*words, "--json").stdout)["samples"] == 300
    # A hand that lies on all of the skin is no rest.
    files("pressed.npz", samples=chamber(2, shift=1.2)[0][:300], times=np.arange(300) / RATE,
          drop=("pressure_bar",))  # fmt: skip
    kept = (tmp_path / "out" / "load.npz").read_bytes()
    line = refused("calibrate", "rest", tmp_path / "pressed.npz", "-o", tmp_path / "out")
    assert "at most 12 % are a rest" in line
    assert (tmp_path / "out" / "load.npz").read_bytes() == kept


def slots(seed, warmer, *, wander=True):
    """Counts of eight modules of twelve slots, temperatures in slots 6 and 10, and the load."""
    rng, rows, n = np.random.default_rng(seed), 6000, 96
    load = np.repeat(rng.uniform(0, 2, rows // 60) * (rng.random(rows // 60) > 0.4), 60)
    load[:400] = load[-200:] = 0.0
    warm = warmer + wander * 6 * np.sin(np.linspace(0, 9, rows))[:, None] * np.ones(8)
    warm = warm + rng.normal(0, 1, 8) + rng.normal(0, 0.2, warm.shape)
    gains, drifts = np.random.default_rng(7).normal([[30.0], [-0.8]], [[4.0], [0.2]], (2, n))
    own = np.arange(n) // 12
    counts = 235 - np.outer(load, gains) + drifts * warm[:, own] + rng.normal(0, 0.4, (rows, n))
    thermal = np.isin(np.arange(n) % 12, (6, 10))
    counts[:, thermal] = 120 + warm[:, own[thermal]]
    channel = np.where(thermal, -1, 12 * own + 6)
    return {
        "samples": counts.round().clip(0, 255).astype(np.uint8), "times": np.arange(rows) / 50,
        "pressure_bar": load, "temperature_channel": channel,
    }  # fmt: skip


def test_temperatures_of_modules_are_taken_out(tmp_path):
    np.savez(tmp_path / "chamber.npz", **slots(1, 0))
    plain = {k: v for k, v in slots(1, 0).items() if k != "temperature_channel"}
    np.savez(tmp_path / "plain.npz", **plain)
    other = slots(2, 12)
    rms = {}
    for name in ("chamber", "plain"):
        out = tmp_path / name
        words = ["calibrate", "load", str(tmp_path / f"{name}.npz"), "-o", str(out)]
        assert CliRunner().invoke(cli, words).exit_code == 0
        found = LoadCalibration.read(out)
        values, low, high = found.pressures(other["samples"], other["times"], zero="none")
        known = np.isfinite(values)
        wanted = np.broadcast_to(other["pressure_bar"][:, None], values.shape)
        rms[name] = float(np.sqrt(((values - wanted)[known] ** 2).mean()))
        if name == "chamber":
            assert known.any(axis=0).sum() == 80
            assert ((low <= wanted) & (wanted <= high))[known].mean() > 0.9
    assert rms["chamber"] < 0.06
    assert rms["plain"] > 3 * rms["chamber"]  # the control


@pytest.mark.parametrize("channel", [np.full(5, 1), np.full(96, 96), np.full(96, 0.5)])
def test_channels_of_temperatures_are_checked(channel, tmp_path):
    np.savez(tmp_path / "c.npz", **(slots(1, 0) | {"temperature_channel": channel}))
    words = ["calibrate", "load", str(tmp_path / "c.npz"), "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(cli, words)
    assert "temperature_channel must be 96 channels" in str(result.exception)


def test_a_touch_of_a_few_taxels_is_no_part_of_their_rest():
    from skinmap.touch.load_calibration import calm_rests

    rng, times = np.random.default_rng(0), np.arange(1000) / 50
    counts = rng.normal(10, 0.6, (len(times), 60)).round()
    counts[(times > 2.5) & (times < 14), :5] += 80  # most of what is looked at
    counts[times > 16] += 100 * np.sin(0.7 * (times[times > 16] - 16))[:, None]
    level = np.median((counts - 10) / 100, axis=1)
    before, _ = calm_rests(counts, level, 50.0, up=np.ones(60))
    assert np.abs(before - 10).max() <= 1.0  # 80 before


def test_times_explain_lost_rows_bursts_and_other_rates(files, tmp_path):
    samples, _ = chamber(1)
    rows = np.arange(9000)
    once = {"pressure_bar": chamber(1)[1], "reference_times": rows / RATE}
    plain = fit_error(files("plain.npz", **once), tmp_path)
    gaps = (rows < 2000) | (rows > 2150)
    gaps &= (rows < 5000) | (rows > 5400)
    slower = (rows < 4000) | (rows % 2 == 0)
    for kept in (gaps, slower):
        file = files("lost.npz", samples=samples[kept], times=rows[kept] / RATE, **once)
        assert fit_error(file, tmp_path) < 1.2 * plain
    bursts = rows // 2 * 2 / RATE + rows % 2 * 0.001
    assert fit_error(files("burst.npz", times=bursts, **once), tmp_path) < 1.2 * plain


def fit_error(file, tmp_path):
    """Median error [bar] of a fit on one file, whose clocks are one."""
    words = ("calibrate", "load", file, "-o", tmp_path / "out", "--json", "--force")
    found = json.loads(run(*words).stdout)
    (clock,) = found["clocks"]
    assert abs(clock["slope_percent"]) < 0.2
    return found["error_bar"]["median"]


def test_each_sample_has_one_prediction_where_rows_were_lost(files, tmp_path):
    run("calibrate", "load", files("own.npz"), "-o", tmp_path / "out")
    samples, pressure = chamber(2)
    kept = (np.arange(9000) < 4000) | (np.arange(9000) > 4200)
    file = files("lost.npz", samples=samples[kept], times=np.flatnonzero(kept) / RATE,
                 pressure_bar=pressure[kept])  # fmt: skip
    words = ("evaluate", "--protocol", "load", tmp_path / "out", file, "--json", "--predictions")
    (row,) = json.loads(run(*words, tmp_path / "p.npz").stdout)["rows"]
    assert row["rms_bar"] < 0.12
    with np.load(tmp_path / "p.npz") as found:
        assert found["pressure_bar"].shape == (kept.sum(), N)
