from __future__ import annotations

import numpy as np
import pytest
from sklearn.svm import SVC
from sklearn.utils.estimator_checks import parametrize_with_checks

from skinmap.classify.intersection import IntersectionSVC, intersection_kernel
from skinmap.errors import InvalidArrayError


@parametrize_with_checks([IntersectionSVC()])
def test_intersection_svc_keeps_the_scikit_learn_contract(estimator, check):
    check(estimator)


def test_intersection_kernel_is_the_sum_of_minima():
    a, b = np.array([[1.0, 5], [0, 2]]), np.array([[2.0, 3]])
    np.testing.assert_array_equal(intersection_kernel(a, b), [[4.0], [2.0]])


def test_intersection_kernel_of_itself_is_the_number_of_votes(rng):
    votes = rng.integers(0, 9, size=(20, 6)).astype(float)
    np.testing.assert_array_equal(np.diag(intersection_kernel(votes, votes)), votes.sum(axis=1))


def test_decision_values_are_those_of_a_precomputed_kernel(rng):
    x = rng.integers(0, 12, size=(80, 10)).astype(float)
    y = (x[:, :5].sum(axis=1) > x[:, 5:].sum(axis=1)).astype(int)
    test = rng.integers(0, 12, size=(30, 10)).astype(float)
    ours = IntersectionSVC(C=3.0).fit(x, y)
    gram = intersection_kernel(x, x)
    theirs = SVC(kernel="precomputed", C=3.0).fit(gram / ours.scale_, y)
    np.testing.assert_allclose(
        ours.decision_function(test),
        theirs.decision_function(intersection_kernel(test, x) / ours.scale_),
        rtol=0,
        atol=1e-9,
    )


def test_negative_counts_are_refused(rng):
    x, y = rng.integers(0, 5, size=(20, 3)).astype(float), np.arange(20) % 2
    with pytest.raises(InvalidArrayError, match="Negative values"):
        IntersectionSVC().fit(x - 3, y)
    with pytest.raises(InvalidArrayError, match="Negative values"):
        IntersectionSVC().fit(x, y).predict(x - 9)
