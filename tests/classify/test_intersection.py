from __future__ import annotations

import pickle
import sys

import numpy as np
import pytest
from sklearn.calibration import CalibratedClassifierCV
from sklearn.svm import SVC
from sklearn.utils.estimator_checks import parametrize_with_checks

from skinmap.errors import InvalidArrayError
from skinmap.recognition.histograms import intersection
from skinmap.recognition.histograms.intersection import (
    AdditiveFunction,
    IntersectionSVC,
    intersection_function,
    intersection_kernel,
)


@parametrize_with_checks([IntersectionSVC()])
def test_intersection_svc_keeps_the_scikit_learn_contract(estimator, check):
    check(estimator)


def planted(rng, n, classes, *, real=False):
    """Histograms (n, 12) of Poisson votes whose means belong to their classes."""
    mean = np.random.default_rng(1).gamma(1.0, 4.0, (classes, 12))
    labels = rng.integers(classes, size=n)
    votes = rng.poisson(mean[labels]).astype(float)
    return (votes + rng.random(votes.shape) if real else votes), np.array(list("abcdef"))[labels]


def test_intersection_kernel_is_the_sum_of_minima():
    a, b = np.array([[1.0, 5], [0, 2]]), np.array([[2.0, 3]])
    np.testing.assert_array_equal(intersection_kernel(a, b), [[4.0], [2.0]])


def test_intersection_kernel_of_itself_is_the_number_of_votes(rng):
    votes = rng.integers(0, 9, size=(20, 6)).astype(float)
    np.testing.assert_array_equal(np.diag(intersection_kernel(votes, votes)), votes.sum(axis=1))


# The loop is compiled for each number of pairs anew: one of them is enough.
@pytest.mark.parametrize(("classes", "compiled"), [(2, False), (3, False), (5, False), (3, True)])
@pytest.mark.parametrize("real", [False, True])
def test_decisions_are_those_of_scikit_learn(rng, classes, real, compiled):
    x, y = planted(rng, 150, classes, real=real)
    test, _ = planted(rng, 60, classes, real=real)
    test[:10] *= 3.0  # beyond every support value too
    ours = IntersectionSVC(C=3.0).fit(x, y)
    if compiled:
        pytest.importorskip("numba", reason="the compiled loop needs numba")
        assert ours.function_.compile()
    theirs = SVC(kernel="precomputed", C=3.0).fit(intersection_kernel(x, x) / ours.scale_, y)
    kernel = intersection_kernel(test, x) / ours.scale_
    # The promise; what is seen is about 1e-13, rounding of sums of some hundred terms.
    np.testing.assert_allclose(
        ours.decision_function(test), theirs.decision_function(kernel), rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(ours.predict(test), theirs.predict(kernel))
    one = np.concatenate([ours.decision_values(row[None]) for row in test])
    np.testing.assert_allclose(one, ours.decision_values(test), rtol=0, atol=1e-9)


def test_additive_function_is_the_sum_over_support_values(rng):
    support, c = rng.random((30, 4)), rng.normal(size=(3, 30))
    x, intercept = 2.0 * rng.random((50, 4)), rng.normal(size=3)
    expected = intersection_kernel(x, support) @ c.T + intercept
    found = intersection_function(support, c, intercept)
    assert found.rows is None  # not whole: no table
    np.testing.assert_allclose(found(x), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_support_values_on_a_heap_are_found_too(rng, compiled):
    """Hundreds of them in one bucket, and values at, beside and beyond each bend."""
    heap = 1.0 + 1e-9 * rng.random((400, 2))
    support = np.concatenate([heap, 50.0 * rng.random((20, 2)), np.full((3, 2), 100.0)])
    c, intercept = rng.normal(size=(3, len(support))), rng.normal(size=3)
    found = intersection_function(support, c, intercept)
    assert found._most > intersection.LINEAR
    if compiled:
        pytest.importorskip("numba", reason="the compiled loop needs numba")
        assert found.compile()
    x = np.concatenate(
        [support, np.nextafter(support, 0), np.nextafter(support, 200), 3.0 * support]
    )
    expected = intersection_kernel(x, support) @ c.T + intercept
    np.testing.assert_allclose(found(x), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found(x[5:7]), expected[5:7], rtol=0, atol=1e-9)


def test_whole_support_values_make_a_table_that_agrees_with_the_bends(rng):
    support, c = rng.integers(0, 9, (30, 4)).astype(float), rng.normal(size=(3, 30))
    found = intersection_function(support, c, np.zeros(3))
    assert found.rows is not None
    x = rng.integers(0, 15, (40, 4)).astype(float)
    # A hair off the whole numbers: evaluated from the bends.
    np.testing.assert_allclose(found(x), found(x + 1e-13), rtol=0, atol=1e-11)


def test_bins_without_support_values_add_nothing():
    found = AdditiveFunction([np.zeros(0), np.ones(1)], [np.zeros((0, 1)), np.ones((1, 1))], [2.0])
    np.testing.assert_array_equal(found(np.array([[5.0, 0.0], [5.0, 7.0]])), [[2.0], [3.0]])


def test_without_numba_numpy_evaluates(rng, monkeypatch):
    found = intersection_function(rng.random((5, 2)), np.ones((1, 5)), np.zeros(1))
    monkeypatch.setitem(sys.modules, "numba", None)
    intersection._compiled.cache_clear()
    assert not found.compile()
    assert found(np.ones((3, 2))).shape == (3, 1)


def test_an_svc_comes_back_from_its_state(rng):
    x, y = planted(rng, 80, 3)
    ours = IntersectionSVC().fit(x, y)
    back = pickle.loads(pickle.dumps(ours))
    np.testing.assert_array_equal(back.decision_function(x), ours.decision_function(x))


def test_negative_counts_are_refused(rng):
    x, y = rng.integers(0, 5, size=(20, 3)).astype(float), np.arange(20) % 2
    with pytest.raises(InvalidArrayError, match="Negative values"):
        IntersectionSVC().fit(x - 3, y)
    with pytest.raises(InvalidArrayError, match="Negative values"):
        IntersectionSVC().fit(x, y).predict(x - 9)


def test_eight_bit_counts_do_not_wrap(rng):
    x = rng.integers(0, 256, size=(40, 6)).astype(np.uint8)
    y = np.arange(40) % 2
    small, long = IntersectionSVC().fit(x, y), IntersectionSVC().fit(x.astype(float), y)
    np.testing.assert_array_equal(small.decision_function(x), long.decision_function(x))


def test_one_class_only_and_numbers_that_are_not_finite_are_refused(rng):
    x = rng.integers(0, 5, size=(20, 3)).astype(float)
    with pytest.raises(ValueError, match="1 class"):
        IntersectionSVC().fit(x, np.zeros(20, int))
    for bad in (np.nan, np.inf):
        broken = x.copy()
        broken[3, 1] = bad
        with pytest.raises(ValueError, match="Input X contains"):
            IntersectionSVC().fit(broken, np.arange(20) % 2)


def test_contradictory_duplicates_leave_the_classifier_unsure(rng):
    x = np.repeat(rng.integers(0, 9, size=(15, 4)).astype(float), 2, axis=0)
    y = np.arange(30) % 2  # each histogram once with either label
    model = CalibratedClassifierCV(IntersectionSVC(), cv=5, ensemble=False).fit(x, y)
    # Nothing tells the labels apart; one in each fold of 6 can be overfitted.
    np.testing.assert_allclose(model.predict_proba(x), 0.5, atol=0.2)


def test_probabilities_are_calibrated(rng):
    x, y = planted(rng, 400, 2)
    noisy = np.where(rng.random(400) < 0.2, np.where(y == "a", "b", "a"), y)
    test, truth = planted(rng, 1000, 2)
    truth = np.where(rng.random(1000) < 0.2, np.where(truth == "a", "b", "a"), truth)
    model = CalibratedClassifierCV(IntersectionSVC(C=1.0), cv=5, ensemble=False).fit(x, noisy)
    sure = model.predict_proba(test)[:, 1]
    for low in (0.0, 0.5):
        inside = (sure >= low) & (sure < low + 0.5)
        # 0.03: two standard errors of a share of some 500; 0.05 more for Platt's two numbers.
        assert abs(sure[inside].mean() - (truth[inside] == "b").mean()) < 0.08
