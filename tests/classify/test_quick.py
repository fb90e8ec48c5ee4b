from __future__ import annotations

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from skinmap.recognition.classifier import calibrated, quick_probabilities
from skinmap.recognition.histograms.intersection import IntersectionSVC


@pytest.mark.parametrize("classes", [2, 4])
def test_quick_probabilities_are_those_of_scikit_learn(rng, classes):
    mean = rng.gamma(1.0, 4.0, (classes, 8))
    y = np.arange(120) % classes
    x = rng.poisson(mean[y]).astype(float)
    machine = calibrated(IntersectionSVC()).fit(x, y)
    quick = quick_probabilities(machine)
    assert quick != machine.predict_proba
    # Two ways to write a sigmoid: a rounding or two apart.
    np.testing.assert_allclose(quick(x), machine.predict_proba(x), rtol=1e-12, atol=1e-15)


def test_other_estimators_are_asked_as_usual(rng):
    machine = LogisticRegression().fit(rng.random((10, 2)), np.arange(10) % 2)
    assert quick_probabilities(machine) == machine.predict_proba
