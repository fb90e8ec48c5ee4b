from __future__ import annotations

import numpy as np
import pytest
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.utils.estimator_checks import parametrize_with_checks

from skinmap.errors import InvalidArrayError
from skinmap.recognition.prediction_sets import AGES, doubt_from, early_doubt, rejection_threshold
from skinmap.recognition.rbf_machine import MARGIN, PENALTY, WIDTH, RbfMachine


@pytest.fixture(scope="module")
def clouds():
    """Four overlapping clouds of 60 points in 5 dimensions, non-negative."""
    rng = np.random.default_rng(7)
    labels = np.repeat(["a", "b", "c", "d"], 60)
    centres = rng.uniform(2, 20, (4, 5))
    rows = np.abs(np.repeat(centres, 60, axis=0) + rng.normal(0, 3, (240, 5)))
    return rows, labels


def test_decisions_are_those_of_scikit_learn(clouds):
    rows, labels = clouds
    ours = RbfMachine().fit(rows, labels)
    scaled = StandardScaler().fit_transform(np.log1p(rows))
    theirs = SVC(C=PENALTY, gamma=WIDTH / 5, decision_function_shape="ovo").fit(scaled, labels)
    expected = np.clip(theirs.decision_function(scaled), -MARGIN, MARGIN)
    np.testing.assert_allclose(ours._decisions(scaled), expected, atol=1e-9)


def test_probabilities_are_calibrated_and_lead_to_the_label(clouds):
    rows, labels = clouds
    machine = RbfMachine().fit(rows[::2], labels[::2])
    share = machine.predict_proba(rows[1::2])
    np.testing.assert_allclose(share.sum(axis=1), 1.0, rtol=1e-12)
    said = machine.predict(rows[1::2])
    np.testing.assert_array_equal(said, machine.classes_[share.argmax(axis=1)])
    right = (said == labels[1::2]).mean()
    # 120 touches: two standard errors of an accuracy near 0.9 are 0.055.
    assert share.max(axis=1).mean() == pytest.approx(right, abs=0.055)
    np.testing.assert_array_equal(machine.probabilities(rows[:3]), machine.predict_proba(rows[:3]))


def test_order_of_rows_does_not_matter_much(clouds, rng):
    rows, labels = clouds
    order = rng.permutation(len(rows))
    one, other = RbfMachine().fit(rows, labels), RbfMachine().fit(rows[order], labels[order])
    # The folds differ, and with them the calibration; the machine itself stays.
    assert (one.predict(rows) == other.predict(rows)).mean() > 0.97


def test_one_class_is_refused(clouds):
    rows, labels = clouds
    with pytest.raises(ValueError, match="one class only: 'a'"):
        RbfMachine().fit(rows[:60], labels[:60])


@parametrize_with_checks([RbfMachine()])
def test_rbf_machine_keeps_the_contract_of_scikit_learn(estimator, check):
    check(estimator)


def test_rejection_threshold_is_where_wrong_names_outnumber_right_ones():
    confidence = np.concatenate([[0.3, 0.35, 0.37, 0.4], np.linspace(0.5, 1.0, 200)])
    right = np.concatenate([[False, True, False, False], np.ones(200, bool)])
    assert rejection_threshold(confidence, right) == pytest.approx(0.45)
    assert rejection_threshold(confidence, np.ones(204, bool)) == 0.0
    assert rejection_threshold([], []) == 0.0


def test_rejection_threshold_never_loses_more_than_it_may():
    confidence = np.linspace(0, 1, 100)
    right = np.arange(100) % 3 == 0  # wrong names everywhere: rejecting all would gain most
    limit = rejection_threshold(confidence, right, lost=0.1)
    assert (right & (confidence < limit)).sum() <= 0.1 * right.sum()


def test_early_doubt_is_what_the_beginnings_are_surer_than_right_and_never_grows():
    rng = np.random.default_rng(0)

    def age(right: float) -> list[float]:
        """Shares of the true names of 300 touches named with 97 %, of which some are right."""
        return np.where(rng.random(300) < right, 0.97, 0.01).tolist()

    shares = np.linspace(0.25, 0.97, len(AGES))
    doubt = early_doubt([age(right) for right in shares], 4)
    assert doubt[0] > 0.85  # no better than chance
    assert doubt[-1] == 0.0
    assert (np.diff(doubt) <= 0).all()
    middle = len(AGES) // 2
    told = (1.0 - doubt[middle]) * 0.97 + doubt[middle] / 4.0
    assert told == pytest.approx(shares[middle], abs=0.08)


def test_where_no_held_out_touch_says_how_sure_to_be_any_name_is_as_likely():
    """The old doubt was 0 there: the fewest data, the least doubt."""
    doubt = early_doubt([[] for _ in AGES], 4)
    assert (doubt[:-1] == 0.75).all()
    assert doubt[-1] == 0.0
    late = early_doubt([[]] * 3 + [[0.97] * 300] * (len(AGES) - 3), 4)
    assert (late[:3] == 0.75).all()
    assert late[3] < 0.1


@pytest.mark.parametrize("array", [[0.5], np.full(len(AGES), 1.0), np.full(len(AGES), -0.1)])
def test_a_doubt_that_is_none_is_refused(array):
    with pytest.raises(InvalidArrayError):
        doubt_from(array)


@pytest.mark.parametrize("kinds", [2, 4])
def test_what_cannot_be_learnt_is_not_turned_round(kinds):
    """Labels without a relation to the rows: no machine names its own rows below chance."""
    for seed in range(12):
        rows = np.random.default_rng(seed).uniform(1.0, 9.0, (40, 6))
        labels = np.arange(40) % kinds
        machine = RbfMachine().fit(rows, labels)
        assert (machine.predict(rows) == labels).mean() >= 1.0 / kinds
