"""A wrench behind the skin: planted gains come back in the mean, its sum goes over the mesh."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.live.response.loads import PartForces
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin

RATE, LAG = 50.0, 20


@pytest.fixture(scope="module")
def skin():
    return skinmap.load_robot("icub").skin("left_forearm")


def pressed(skin, seed, rows=5000):
    """Pressures (rows, n) [bar] of touches, and counts that fall by planted gains."""
    rng = np.random.default_rng(seed)
    pressures, start = np.zeros((rows, len(skin))), 100
    while start < rows - 200:
        count = int(rng.integers(60, 140))
        away = np.linalg.norm(skin.positions - skin.positions[rng.integers(len(skin))], axis=1)
        shape = np.maximum(1 - (away / rng.uniform(0.012, 0.04)) ** 2, 0) * rng.uniform(0.2, 1.5)
        pressures[start : start + count] += np.outer(np.sin(np.linspace(0, np.pi, count)), shape)
        start += count + int(rng.integers(15, 50))
    counts = 240 - pressures * gains(skin) + rng.normal(0, 0.4, pressures.shape)
    return pressures, np.clip(counts.round(), 0, 255).astype(np.uint8)


def gains(skin):
    """Counts a bar."""
    return np.random.default_rng(0).uniform(25, 60, len(skin))


@pytest.fixture(scope="module")
def evidence(skin, tmp_path_factory):
    pressures, samples = pressed(skin, 3)
    forces = PartForces(PreparedSkin(skin))
    wrench = 1e5 * np.hstack([pressures @ forces.vectors, pressures @ forces.moments])
    wrench += [1, 2, -3, 0.1, 0.2, 0.05]  # the sensor's own zero
    file = tmp_path_factory.mktemp("wrench") / "wrench.npz"
    arrays = {"samples": samples, "times": np.arange(len(samples)) / RATE}
    np.savez(file, **arrays, wrench=-wrench[LAG:])  # the reaction; it begins later
    return file


def run(*words):
    return CliRunner().invoke(cli, ["calibrate", "load", *map(str, words), "--json"])


def test_a_wrench_teaches_pressures_of_a_curved_part(evidence, skin, tmp_path):
    out = tmp_path / "load"
    result = run(evidence, "--part", "left_forearm", "-o", out)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert (found["model"], found["channels"]) == ("linear", len(skin))
    assert abs(found["clocks"][0]["offset_rows"] - LAG) < 12
    calibration = LoadCalibration.read(out)
    own = calibration.answered
    assert own.mean() > 0.9
    ratio = (calibration.weights[:, 1] / np.abs(calibration.span) * gains(skin))[own]
    # A touch covers a dozen taxels: the sum holds their mean gain, hardly that of each.
    assert abs(np.median(ratio) - 1) < 0.1
    pressures, samples = pressed(skin, 7, 3000)
    values, low, high = calibration.pressures(samples)
    use = np.isfinite(values) & (pressures > 0.05)
    assert ((low <= pressures) & (pressures <= high))[use].mean() > 0.85
    # Taxels that were touched lightly answer as far as the others: 0.45 by their own counts alone.
    again = own & (pressures > 0.3) & (pressures < 1.2)
    assert np.isfinite(values)[again].mean() > 0.9
    control = values[use] / 2  # half of every gain is seen
    assert np.sqrt(np.mean((control - pressures[use]) ** 2)) > 1.1 * np.sqrt(
        np.mean((values[use] - pressures[use]) ** 2)
    )


@pytest.mark.parametrize(
    ("wrench", "words", "said"),
    [
        (None, (), "needs --part"),
        (np.zeros((5000, 3)), ("--part", "left_forearm"), "must be (u, 6)"),
        (np.zeros((5000, 6)), ("--part", "left_forearm"), "never moves"),
        (np.full((5000, 6), np.nan), ("--part", "left_forearm"), "NaN or infinity, first in row 0"),
    ],
)
def test_a_wrench_that_cannot_be_used_is_one_line(evidence, tmp_path, wrench, words, said):
    with np.load(evidence) as held:
        arrays = dict(held) | ({} if wrench is None else {"wrench": wrench})
    np.savez(tmp_path / "bad.npz", **arrays)
    result = run(tmp_path / "bad.npz", *words, "-o", tmp_path / "out")
    assert said in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_a_wrench_beside_another_load_is_named(evidence, skin, tmp_path):
    load = pressed(skin, 5)[1]
    np.savez(tmp_path / "chamber.npz", samples=load, times=np.arange(len(load)) / RATE,
             pressure_bar=np.linspace(0, 2, len(load)))  # fmt: skip
    result = run(tmp_path / "chamber.npz", evidence, "--part", "left_forearm", "-o", "none")
    assert "wrench.npz" in str(result.exception)
    assert "fitted alone" in str(result.exception)
