"""The classifiers that others are compared with: on planted touches, where raw values suffice."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.svm import SVC

from skinmap.classify.check import check_classifier, planted_touches
from skinmap.classify.classifier import classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.inputs import ContactImages, RawSamples, descriptor_of
from skinmap.classify.raw_classifiers import PENALTIES, WIDTHS
from skinmap.errors import NotFittedError, SkinMismatchError, UnknownNameError

NAMES = ("raw-rbf", "raw-intersection", "histogram-chi2", "histogram-sqrt")


@pytest.mark.parametrize("name", NAMES)
def test_baselines_keep_the_contract_and_name_planted_touches(name):
    assert name in classifiers.names()
    check_classifier(classifiers.get(name))


def test_raw_rbf_takes_the_best_of_its_grid(rng):
    touches = planted_touches(8, rng=rng)
    model = classifiers.get("raw-rbf")().fit(touches, rng=rng)
    search = model.estimator.calibrated_classifiers_[0].estimator
    assert set(search.cv_results_["param_C"]) == set(PENALTIES)
    assert set(search.cv_results_["param_gamma"]) == set(WIDTHS)
    assert isinstance(search.best_estimator_, SVC)
    assert search.best_score_ == max(search.cv_results_["mean_test_score"])


def test_raw_values_are_of_one_skin_only(rng, prepared):
    touches = planted_touches(2, rng=rng)
    raw = RawSamples()
    with pytest.raises(NotFittedError, match="no skin yet"):
        raw.describe(touches[0])
    hand = prepared("left_hand")
    other = Touch(hand, np.full((3, len(hand)), 90, np.uint8), "small")
    with pytest.raises(SkinMismatchError, match="touches of one part, got: planted, left_hand"):
        raw.fit([*touches, other], rng=rng)
    raw.fit(touches, rng=rng)
    with pytest.raises(SkinMismatchError, match=r"120 taxels of 'planted' .* 'left_hand' has 48"):
        raw.describe(other)
    assert raw.describe(touches[0]).max() <= 1.0


def test_contact_images_are_scaled_to_their_own_maximum(rng):
    touch = planted_touches(1, rng=rng)[0]
    image = ContactImages().describe(touch)
    assert image.shape == (1, 6600)
    assert image.max() == 255.0
    np.testing.assert_array_equal(image, np.floor(image))
    still = Touch(touch.skin, np.zeros_like(touch.samples))
    assert ContactImages().describe(still).shape == (0, 6600)  # no division by zero


def test_input_kinds_are_known_by_name():
    with pytest.raises(UnknownNameError, match="there is: raw, histogram, image, contact-geometry"):
        descriptor_of("smell")
