"""Response: planted baselines, noise, gains and faults come back; files keep what they hold."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from calibration.commands import calibrate
from calibration.response import (
    Gain,
    Health,
    ReferenceLoads,
    ResponseCalibration,
    fit_gain,
    load_response,
    save_response,
)
from calibration.response.gain import KNOTS, BranchFollower
from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    SkinMismatchError,
    UnknownNameError,
)


def at_rest(rng, n=20, t=500, *, base=20.0, noise=1.2):
    return np.rint(base + rng.normal(0, noise, (t, n)))


def pushes(rng, n=20, *, peak=10.0, hysteresis=0.0, gain=None, noise=0.5, base=20.0, steps=200):
    """A triangle of loads on all taxels at once and the samples that answer."""
    up = np.linspace(0, peak, steps)
    load = np.concatenate([up, up[::-1]])
    gain = np.linspace(5, 15, n) if gain is None else np.asarray(gain)
    answer = np.outer(load, gain)
    answer[steps:] += hysteresis * np.outer(np.sin(np.pi * load[steps:] / peak), gain)
    samples = base + answer + rng.normal(0, noise, answer.shape)
    return ReferenceLoads(samples, np.repeat(load[:, None], n, axis=1))


def test_fit_finds_baseline_noise_and_threshold(rng):
    base = np.linspace(5, 60, 50)
    rest = base + rng.normal(0, 2.0, (2000, 50))
    response = ResponseCalibration.fit(rest)
    # A median of 2000 has a deviation of 1.25 * 2 / sqrt(2000) = 0.056; five of them.
    np.testing.assert_allclose(response.baseline, base, rtol=0, atol=0.28)
    np.testing.assert_allclose(response.noise, 2.0, rtol=0.15)
    # The 95th percentile of a normal variable is 1.645 deviations; 4 counts of margin.
    np.testing.assert_allclose(response.threshold, 4 + 1.645 * 2.0, rtol=0.1)


def test_outliers_at_rest_move_nothing(rng):
    clean = at_rest(rng)
    spoilt = clean.copy()
    spoilt[::50] = 255  # 2 % of the samples
    one, other = (ResponseCalibration.fit(rest) for rest in (clean, spoilt))
    np.testing.assert_allclose(one.baseline, other.baseline, rtol=0, atol=1.0)
    np.testing.assert_allclose(one.noise, other.noise, rtol=0, atol=1.5)


@pytest.mark.parametrize("sign", [1, -1])
def test_gains_come_back_and_equalise_taxels(rng, sign):
    """Taxels three times as sensitive as others answer alike once calibrated."""
    rest, reference = at_rest(rng), pushes(rng)
    if sign < 0:
        rest = 255 - rest
        reference = ReferenceLoads(255 - reference.samples, reference.loads)
    response = ResponseCalibration.fit(rest, reference, sign=sign)
    assert (response.health == Health.OK).all()
    samples = 20 + np.outer([0.0, 4.0, 8.0], np.linspace(5, 15, 20))
    loads = response.apply(255 - samples if sign < 0 else samples)
    np.testing.assert_allclose(loads[0], 0.0)
    # Noise of the reference and whole baselines: half a count of at least 5 counts a load.
    np.testing.assert_allclose(loads[1], 4.0, rtol=0, atol=0.2)
    np.testing.assert_allclose(loads[2], 8.0, rtol=0, atol=0.2)


def test_branches_tell_pushing_from_letting_go(rng):
    reference = pushes(rng, 4, hysteresis=2.0, noise=0.0, gain=np.full(4, 10.0))
    gain = fit_gain(reference, np.full(4, 20.0), 1)
    middle = KNOTS // 2
    assert (gain.counts[:, 1, middle] > gain.counts[:, 0, middle] + 15).all()
    answer = reference.samples - 20.0
    falling = BranchFollower(np.full(4, 0.1)).apply(answer)
    assert not falling[:195].any()
    assert falling[230:].all()  # it rises on for a while after the turn: the loop is open
    found = gain.loads(answer, falling)
    loads = reference.loads
    # Eight knots: a curve that bends by 20 counts lies off its chord by 20 pi^2 / 8 / 49 = 0.5
    # counts, 0.05 loads; letting go, where it is flat, the same counts say less of the load.
    np.testing.assert_allclose(found[:195], loads[:195], rtol=0, atol=0.05)
    assert np.sqrt(np.mean((found[230:] - loads[230:]) ** 2)) < 0.3


def test_loads_invert_the_curves(rng):
    """A law: curves give their own knots back, on both branches; flat pieces are jumps."""
    counts = np.cumsum(rng.uniform(1, 20, (6, 2, KNOTS)), axis=2)
    counts -= counts[..., :1]
    knots = np.linspace(0, 7, KNOTS)
    gain = Gain(knots, counts)
    for branch in (0, 1):
        answer = counts[:, branch].T
        found = gain.loads(answer, np.full(answer.shape, bool(branch)))
        np.testing.assert_allclose(found, np.repeat(knots[:, None], 6, axis=1), atol=1e-12)
    flat = np.broadcast_to([0.0, 10, 10, 20], (1, 2, 4))
    answers = np.array([[0.0], [5], [10], [15], [20], [25]])
    by_hand = np.interp(answers[:, 0], [0, 10, 20], [0, 1, 3])
    by_hand[-1] = 4.0  # beyond, the last slope goes on: two loads for ten counts
    np.testing.assert_allclose(Gain(np.arange(4.0), flat).loads(answers)[:, 0], by_hand)


def test_a_taxel_without_loads_shares_the_median_curve(rng):
    reference = pushes(rng, 5, gain=np.full(5, 10.0))
    loads = reference.loads.copy()
    loads[:, 4] = 0.0
    gain = fit_gain(ReferenceLoads(reference.samples, loads), np.full(5, 20.0), 1)
    assert np.isnan(gain.counts[4]).all()
    np.testing.assert_allclose(gain.loads(np.full((1, 5), 50.0)), 5.0, rtol=0, atol=0.2)


def test_health_names_planted_faults(rng):
    rest = at_rest(rng, 12)
    reference = pushes(rng, 12, gain=np.full(12, 10.0))
    samples, loads = reference.samples.copy(), reference.loads.copy()
    samples[:, 0] = rest[np.arange(400) % 500, 0]  # loaded and does not move
    rest[:, 1], samples[:, 1], loads[:, 1] = 20.0, 20.0, 0.0  # frozen, not loaded
    rest[:, 2] = 255.0
    rest[:, 3] += rng.normal(0, 15, 500)
    loads[:, 4] = 0.0
    samples[:, 4] = 20.0
    response = ResponseCalibration.fit(rest, ReferenceLoads(samples, loads))
    states = ["dead", "stuck", "saturated", "noisy", "never touched"]
    assert response.health[:5].tolist() == states
    assert (response.health[5:] == "ok").all()
    pressed = np.full((50, 12), 20.0)
    pressed[20:] = 120.0
    pressure = response.apply(pressed)[-1]
    assert (pressure[:4] == 0).all()
    assert (pressure[4:] > 0).all()
    assert set(ResponseCalibration.fit(at_rest(rng)).health) == {"never touched"}


def test_files_give_back_what_was_saved(rng, tmp_path):
    path = tmp_path / "response.npz"
    response = ResponseCalibration.fit(
        at_rest(rng),
        pushes(rng),
        rate=25.0,
        fingerprint="ab" * 32,
        modules=np.arange(20) // 10,
        thermal=np.arange(20) % 10 == 9,
    )
    save_response(response, path)
    again = load_response(path, fingerprint="ab" * 32)
    samples = at_rest(rng) + 30
    np.testing.assert_array_equal(response.apply(samples), again.apply(samples))
    assert (again.rate, again.sign, again.fingerprint) == (25.0, 1, "ab" * 32)
    np.testing.assert_array_equal(again.health, response.health)
    with pytest.raises(SkinMismatchError, match="calibrated was the skin abab"):
        load_response(path, fingerprint="cd" * 32)


def test_damaged_files_are_refused(rng, tmp_path):
    path = tmp_path / "response.npz"
    with pytest.raises(MissingFileError):
        load_response(path)
    save_response(ResponseCalibration.fit(at_rest(rng)), path)
    whole = path.read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 5):
        path.write_bytes(whole[:size])
        with pytest.raises(DataFormatError, match=r"response\.npz: not a response calibration"):
            load_response(path)
    path.write_bytes(whole)
    arrays = dict(np.load(path))
    head = json.loads(arrays["head"].tobytes())

    def write(**changes):
        arrays_ = arrays | changes
        np.savez(path, **{name: values for name, values in arrays_.items() if values is not None})

    def headed(**changes):
        return np.frombuffer(json.dumps(head | changes).encode(), np.uint8)

    for changes, words in (
        ({"head": headed(format="skinmap-response-9")}, "skinmap-response-9"),
        ({"head": headed(health=["odd"] * 20)}, "odd"),
        ({"head": headed(sign=3)}, "sign"),
        ({"noise": None}, "noise"),
        ({"noise": arrays["noise"][:-1]}, "noise must have shape"),
        ({"threshold": np.full(20, np.nan)}, "NaN"),
    ):
        write(**changes)
        with pytest.raises(DataFormatError, match=words):
            load_response(path)


def test_bad_input_is_named(rng):
    rest = at_rest(rng)
    holed = rest.copy()
    holed[7, 3] = np.nan
    with pytest.raises(InvalidArrayError, match="rest holds NaN or infinity, first in row 7"):
        ResponseCalibration.fit(holed)
    with pytest.raises(InvalidArrayError, match="at least 50 samples, got 20"):
        ResponseCalibration.fit(rest[:20])
    with pytest.raises(InvalidArrayError, match="5 taxels under load, 20 at rest"):
        ResponseCalibration.fit(rest, pushes(rng, 5))
    with pytest.raises(InvalidArrayError, match="sign must be 1 or -1"):
        ResponseCalibration.fit(rest, sign=0)
    with pytest.raises(InvalidArrayError, match="rate must be above 0"):
        ResponseCalibration.fit(rest, rate=0.0)
    with pytest.raises(InvalidArrayError, match="modules must have shape"):
        ResponseCalibration.fit(rest, modules=np.zeros(3, int))
    with pytest.raises(InvalidArrayError, match="loads must not be negative"):
        ReferenceLoads(rest, rest - 100)
    response = ResponseCalibration.fit(rest)
    with pytest.raises(SkinMismatchError, match="19 taxels, calibrated are 20"):
        response.apply(rest[:, :19])
    with pytest.raises(InvalidArrayError, match="samples holds NaN"):
        response.apply(holed)
    with pytest.raises(UnknownNameError, match="never touched"):
        ResponseCalibration(
            response.baseline, response.noise, response.threshold, 1, np.full(20, "odd")
        )


def run(*words, code=0):
    result = CliRunner().invoke(calibrate, [*map(str, words), "--json"])
    assert result.exit_code == code, (result.output, result.exception)
    return json.loads(result.stdout)


def test_response_remembers_the_skin(tmp_path, icub):
    rng = np.random.default_rng(4)
    skin = icub.skin("right_forearm")
    rest = np.rint(20 + rng.normal(0, 1.2, (300, len(skin))))
    rest[:, 3] = 255.0
    np.save(tmp_path / "rest.npy", rest)
    load = np.linspace(0, 10, 100)[:, None] * np.ones(len(skin))
    np.savez(tmp_path / "loads.npz", samples=20 + 9 * load, loads=load)
    result = run(
        "response", tmp_path / "rest.npy", "--reference", tmp_path / "loads.npz",
        "--part", "right_forearm", "-o", tmp_path / "out",
    )  # fmt: skip
    assert result["status"] == "ok"  # one unfit channel is named, not a fault of the skin
    assert result["unfit"] == [3]
    assert result["health"]["ok"] == len(skin) - 1
    assert result["files"] == ["response.npz", "report.html"]
    response = load_response(tmp_path / "out" / "response.npz", fingerprint=result["fingerprint"])
    np.testing.assert_array_equal(response.modules, skin.modules)
    np.testing.assert_allclose(response.apply(np.full((1, len(skin)), 65.0))[0, 5], 5.0, atol=0.2)


def test_the_rate_is_that_of_the_samples(tmp_path):
    """Drift is followed by seconds: at 1 kHz a rate of 50 would swallow slow presses."""
    rest, file = np.rint(20 + np.random.default_rng(5).normal(0, 1.2, (300, 20))), "rest.npz"
    np.savez(tmp_path / file, samples=rest, times=1e-3 * np.arange(300))
    assert run("response", tmp_path / file)["rate"] == pytest.approx(1000.0)
    np.savez(tmp_path / file, samples=rest, rate=200)
    assert run("response", tmp_path / file, "-o", tmp_path / "out")["rate"] == 200.0
    assert load_response(tmp_path / "out" / "response.npz").rate == 200.0
    np.savez(tmp_path / file, samples=rest)
    assert run("response", tmp_path / file)["rate"] == 50.0
    for wrong in ({"rate": -1.0}, {"rate": [50, 50]}, {"times": np.zeros(300)}):
        np.savez(tmp_path / file, samples=rest, **wrong)
        refused = CliRunner().invoke(calibrate, ["response", str(tmp_path / file)]).exception
        assert "`rate` must be one number above 0" in str(refused)


def test_a_faulty_skin_exits_3(tmp_path):
    rest = np.rint(20 + np.random.default_rng(5).normal(0, 1.2, (300, 20)))
    rest[:, :4] = 255.0
    np.savez(tmp_path / "rest.npz", samples=rest)
    result = run("response", tmp_path / "rest.npz", "-o", tmp_path / "out", code=3)
    assert result["reasons"] == ["4 of 20 channels are unfit: 4 saturated"]
    assert run("response", tmp_path / "rest.npz", "--accept")["status"] == "faulty"


def test_bad_sample_files_are_named(tmp_path):
    def fails(error, match, *words):
        result = CliRunner().invoke(calibrate, [*map(str, words), "-o", str(tmp_path / "out")])
        assert isinstance(result.exception, error), result.exception
        assert match in str(result.exception)
        assert not (tmp_path / "out").exists()

    (tmp_path / "text.npz").write_text("no arrays")
    fails(DataFormatError, "not samples", "response", tmp_path / "text.npz")
    np.save(tmp_path / "rest.npy", np.random.default_rng(0).normal(20, 1, (100, 7)))
    np.savez(tmp_path / "half.npz", samples=np.zeros((9, 7)))
    fails(
        SkinMismatchError, "the samples 7 channels",
        "response", tmp_path / "rest.npy", "--part", "torso",
    )  # fmt: skip
    fails(DataFormatError, "lacks loads", "response", tmp_path / "rest.npy",
          "--reference", tmp_path / "half.npz")  # fmt: skip


def test_a_bit_that_says_encrypted_is_refused_by_name(rng, tmp_path):
    path = tmp_path / "response.npz"
    save_response(ResponseCalibration.fit(at_rest(rng)), path)
    whole = bytearray(path.read_bytes())
    entry = whole.rfind(b"PK\x01\x02")  # of the directory; its flags stand 8 bytes on
    local = int.from_bytes(whole[entry + 42 : entry + 46], "little")
    for flags in (entry + 8, local + 6):
        whole[flags] |= 1
    path.write_bytes(whole)
    with pytest.raises(DataFormatError, match="not a response calibration"):
        load_response(path)


def test_a_sign_that_the_loads_contradict_is_refused(rng):
    """A skin that rests high and falls: without its sign all of it would be called dead."""
    falling = pushes(rng)
    turned = ReferenceLoads(255.0 - falling.samples, falling.loads)
    rest = 255.0 - at_rest(rng)
    with pytest.raises(InvalidArrayError, match="20 of 20 loaded channels fall under load"):
        ResponseCalibration.fit(rest, turned)
    found = ResponseCalibration.fit(rest, turned, sign=-1)
    assert (found.health == Health.OK).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda samples, loads: (samples, np.roll(loads, 60, axis=0)), r"come \+60 rows after"),
        (lambda samples, loads: (samples, np.ones_like(loads)), "explain"),
        (lambda samples, loads: (samples[:1], loads[:1]), "six samples under load"),
        (lambda samples, loads: (samples[:0], loads[:0]), "has no samples"),
    ],
)
def test_loads_that_do_not_go_with_the_samples_are_refused(rng, change, words):
    load = np.convolve(np.repeat(rng.uniform(0, 10, 40), 30), np.ones(15) / 15, "same")[:, None]
    samples, loads = 20 + load * np.full(20, 9.0), load * np.ones(20)
    assert ResponseCalibration.fit(at_rest(rng), ReferenceLoads(samples, loads)).gain is not None
    with pytest.raises(InvalidArrayError, match=words):
        ResponseCalibration.fit(at_rest(rng), ReferenceLoads(*change(samples, loads)))


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_a_touched_skin_does_not_rest(rng, share):
    rest = at_rest(rng)
    rows = np.arange(int(share * len(rest)))
    rest[rows] += 60 * np.sin(rows / 9)[:, None] ** 2
    with pytest.raises(InvalidArrayError, match="rest was touched"):
        ResponseCalibration.fit(rest)


def test_a_touch_at_rest_deafens_no_channel(rng, tmp_path):
    rest = at_rest(rng)
    rest[200:300, 3] += 40
    np.save(tmp_path / "rest.npy", rest)
    run = CliRunner().invoke(
        calibrate, ["response", str(tmp_path / "rest.npy"), "-o", str(tmp_path / "out")]
    )
    assert run.exit_code == 0, run.output
    assert "touched at rest, or with bursts of noise: 3;" in run.output
    threshold = load_response(tmp_path / "out" / "response.npz").threshold
    assert threshold[3] < 1.5 * np.median(threshold)  # 44 of a 95th percentile


def test_volts_and_milliseconds_are_refused(rng):
    rest = at_rest(rng)
    with pytest.raises(InvalidArrayError, match="are they volts"):
        ResponseCalibration.fit(rest / 255 * 3.3)
    with pytest.raises(InvalidArrayError, match="are `times` in seconds"):
        ResponseCalibration.fit(rest, rate=0.05)
    averaged = rest.reshape(100, 5, 20).mean(axis=1) - 20.0  # of a skin that rests near zero
    assert (ResponseCalibration.fit(averaged).health == Health.NEVER_TOUCHED).all()


def test_values_of_twelve_bits_are_no_counts(rng):
    with pytest.raises(InvalidArrayError, match="raw values are 0 to 255 counts"):
        ResponseCalibration.fit(16.0 * at_rest(rng, base=100.0))
