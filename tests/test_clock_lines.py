"""Clock lines: planted lags, rates and lost rows come back; what cannot be aligned is refused."""

import numpy as np
import pytest

from skinmap.clock_lines import align, following, skin_rows
from skinmap.errors import InvalidArrayError


@pytest.fixture(scope="module")
def recording():
    """A skin of 40 taxels, a third of them falling, with a loop; one dead, one noisy."""
    rng = np.random.default_rng(3)
    knots = rng.uniform(0, 1, 160) * rng.integers(0, 2, 160)
    load = np.interp(np.arange(8000), np.arange(0, 8000, 50), knots)
    loop, now = np.empty(8000), 0.0
    for row, value in enumerate(load):
        now = min(max(now, value - 0.1), value + 0.1)
        loop[row] = now
    gains = np.where(np.arange(40) % 3, 1, -1) * rng.uniform(30, 90, 40)
    samples = 120 + np.outer(0.7 * load**0.8 + 0.3 * loop, gains) + rng.normal(0, 0.5, (8000, 40))
    samples[:, 3], samples[:, 7] = 255, rng.uniform(0, 255, 8000)
    return samples.round(), load


def test_lag_and_slope_come_back(recording):
    samples, load = recording
    rows = np.arange(7700)
    (line,) = align(samples, np.interp(60 + 1.008 * rows, np.arange(8000), load))
    truth = 60 + 1.008 * rows
    # A row is .02 s here; the lines end within three of them everywhere.
    assert np.abs(skin_rows([line], rows) - truth).max() < 3
    assert abs(line.slope - 0.008) < 5e-4
    assert line.residual_rows < 3
    assert line.unexplained < 0.02


def test_lost_rows_give_a_second_line(recording):
    samples, load = recording
    lines = align(samples, np.delete(load, np.arange(4000, 4090)))
    assert len(lines) == 2
    assert abs(lines[1].offset_rows - lines[0].offset_rows - 90) < 4
    assert abs(lines[1].first_row - 4000) < 300


def test_noise_is_not_explained(recording):
    samples, load = recording
    lines = align(samples, np.random.default_rng(5).permutation(load))
    assert min(line.unexplained for line in lines) > 0.8


def test_following_leaves_out_what_is_broken(recording):
    own = following(recording[0])
    assert set(range(40)) - set(own.tolist()) == {3, 7}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda samples, load: (samples[:300], load), "at least 400"),
        (lambda samples, load: (samples, 0 * load + 2), "never moves"),
        (lambda samples, load: (0 * samples, load), "no channel moves"),
        (lambda samples, load: (samples, np.where(load > 0.5, np.nan, load)), "NaN"),
    ],
)
def test_what_cannot_be_aligned_is_refused(recording, change, words):
    with pytest.raises(InvalidArrayError, match=words):
        align(*change(*recording))


@pytest.mark.parametrize("seed", [1, 4])
def test_a_load_that_the_skin_never_felt_does_not_turn_the_line(seed):
    # One press: nearly all of it is ramps, so that a wrong level pulls at the line.
    rng = np.random.default_rng(seed)
    at = np.array([0, 1300, 2900, 4000, 4400, 4600, 4900, 5100, 6000, 6400, 8000])
    at[1:-1] += rng.integers(-60, 60, 9)
    load = np.interp(np.arange(8000), at, [0, 0, 1, 0.9, 0.65, 0.65, 0.5, 0.5, 0.2, 0, 0])
    samples = 120 + np.outer(load, np.linspace(30, 90, 40)) + rng.normal(0, 0.5, (8000, 40))
    truth = 60 + 1.008 * np.arange(7700)
    reference = np.interp(truth, np.arange(8000), load) + rng.normal(0, 0.003, 7700)
    reference[600:1150] += 0.08
    (line,) = align(samples.round(), reference)
    # With that load in the search the line ends 90 rows and more off.
    assert np.abs(skin_rows([line], np.arange(7700)) - truth).max() < 12
    assert line.residual_rows < 12
