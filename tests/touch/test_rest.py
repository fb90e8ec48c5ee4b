from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.skin.skin import skin_from_points
from skinmap.touch.contacts.rest import ENOUGH, LOW, NOISY, Rest, felt, find_rest, usual_rest
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording


@pytest.fixture(scope="module")
def plate(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    return PreparedSkin(skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1))))


def noise(rng, count, taxels, deviation):
    return np.clip(rng.normal(0.0, deviation, (count, taxels)), 0, None)


def neighbour(skin, taxel):
    return int(skin.geometry.beside[taxel][0])


def test_levels_follow_each_taxels_own_noise(rng):
    samples = np.column_stack([noise(rng, 400, 5, 1.0), noise(rng, 400, 5, 8.0)])
    rest = find_rest(samples, quiet=np.ones(400, bool))
    np.testing.assert_array_equal(rest.begins[:5], ACTIVE)
    np.testing.assert_array_equal(rest.goes_on[:5], LOW)
    # 5 deviations of 8 counts; a deviation from 400 samples is known to 5 %, an order more here.
    np.testing.assert_allclose(rest.begins[5:], 40.0, rtol=0.25)
    assert not rest.stuck.any()


def test_a_taxel_that_hangs_is_stuck_and_says_nothing(plate, rng):
    samples = noise(rng, 60, len(plate), 1.0)
    other = neighbour(plate, 20)
    samples[:, [20, other]] = 150
    rest = find_rest(samples, quiet=np.ones(60, bool))
    assert np.flatnonzero(rest.stuck).tolist() == sorted([20, other])
    assert not felt(samples, rest, plate.geometry.beside).any()


def test_touches_that_nobody_marked_do_not_count_as_rest(rng):
    """A touch of two fifths of the time leaves the levels where noise alone puts them."""
    quiet = noise(rng, 50, 200, 2.0)
    touched = quiet.copy()
    touched[10:30, 40:60] += 120 + 5 * rng.standard_normal((20, 20))
    one, other = find_rest(quiet), find_rest(touched)
    assert not other.stuck.any()
    # The tremor of the touch is in two fifths of the steps: levels there rise by five deviations.
    assert np.abs(other.begins - one.begins).max() <= 25.0
    assert (touched[15:25, 40:60] > other.begins[40:60]).all()


def test_the_middle_of_a_touch_passes_and_its_rim_with_it(plate):
    samples = np.zeros((3, len(plate)))
    near = plate.geometry.beside[20][:3]
    samples[:, 20] = 90
    samples[:, near] = LOW + 1
    found = felt(samples, usual_rest(len(plate)), plate.geometry.beside)
    np.testing.assert_array_equal(found, samples)


def test_a_spike_on_one_taxel_is_nobodys(plate):
    samples = np.zeros((1, len(plate)))
    samples[0, 20] = 200
    far = int(np.argmax(np.linalg.norm(plate.skin.positions - plate.skin.positions[20], axis=1)))
    samples[0, far] = 200
    beside = plate.geometry.beside
    assert not felt(samples, usual_rest(len(plate)), beside).any()
    samples[0, neighbour(plate, 20)] = LOW + 1  # the same with somebody beside it
    assert np.flatnonzero(felt(samples, usual_rest(len(plate)), beside)[0]).tolist() == sorted(
        [20, neighbour(plate, 20)]
    )


def test_a_taxel_without_neighbours_is_believed_alone():
    beside = np.array([[3], [3], [3]])
    samples = np.array([[0.0, 80.0, 0.0]])
    np.testing.assert_array_equal(felt(samples, usual_rest(3), beside), samples)


def test_one_sample_is_judged_as_in_a_block(plate, rng):
    samples = noise(rng, 40, len(plate), 6.0)
    rest, beside = usual_rest(len(plate)), plate.geometry.beside
    together = felt(samples, rest, beside)
    for row, sample in enumerate(samples):
        np.testing.assert_array_equal(felt(sample[None], rest, beside)[0], together[row])
    assert together.any()
    assert not together.all()


def test_noise_alone_is_no_touch_of_a_taxel_that_is_known(plate, rng):
    samples = noise(rng, 500, len(plate), 8.0)
    known = find_rest(samples[:100], quiet=np.ones(100, bool))
    beside = plate.geometry.beside
    assert not known.noisy.all()
    assert (felt(samples[100:], known, beside) > 0).any(axis=1).mean() < 0.02
    # The control: with the levels of a quiet skin most samples are touches.
    assert (felt(samples[100:], usual_rest(len(plate)), beside) > 0).any(axis=1).mean() > 0.9


def test_noisy_taxels_are_told():
    levels = np.array([ACTIVE, NOISY + 1, NOISY + 1])
    rest = Rest(np.zeros(3), levels, levels, np.array([False, False, True]))
    assert rest.noisy.tolist() == [False, True, False]


def test_too_few_samples_teach_nothing(rng):
    samples = noise(rng, ENOUGH - 1, 4, 30.0)
    np.testing.assert_array_equal(find_rest(samples).begins, ACTIVE)
    few = np.zeros(100, bool)
    few[:3] = True
    np.testing.assert_array_equal(find_rest(noise(rng, 100, 4, 9.0), quiet=few).begins, ACTIVE)


def test_find_rest_refuses_what_is_no_table():
    with pytest.raises(InvalidArrayError, match=r"samples must have shape \(t, n\)"):
        find_rest(np.zeros(5))
    with pytest.raises(InvalidArrayError, match=r"quiet must have shape \(9,\)"):
        find_rest(np.zeros((9, 2)), quiet=np.zeros(4, bool))


def test_a_recording_knows_its_rest(rng):
    samples = np.rint(noise(rng, 80, 3, 5.0)).astype(np.uint8)
    samples[40:60, 1] = 200
    events = np.where((np.arange(80) >= 40) & (np.arange(80) < 60), 0, -1)
    recording = Recording("x", np.arange(80) / 50, samples, events, ("poke",))
    rest = recording.rest()
    assert rest.begins.max() < 60
    assert (rest.begins > ACTIVE).all()
