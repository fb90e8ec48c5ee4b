"""The classifiers that others are compared with: on planted touches, where raw values suffice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.svm import SVC

from skinmap.errors import InvalidArrayError, NotFittedError, SkinMismatchError, UnknownNameError
from skinmap.recognition.check import check_classifier, planted_touches
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import (
    Histograms,
    PaperImages,
    RawSamples,
    Touch,
    descriptor_of,
    moments,
)
from skinmap.recognition.named_classifiers import PENALTIES, WIDTHS
from skinmap.touch.contacts.skin_geometry import pressed

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
    other = Touch(hand, np.full((3, len(hand)), 90, np.uint8), "small", rate=50.0)
    with pytest.raises(SkinMismatchError, match="touches of one part, got: planted, left_hand"):
        raw.fit([*touches, other], rng=rng)
    raw.fit(touches, rng=rng)
    with pytest.raises(SkinMismatchError, match=r"120 taxels of 'planted' .* 'left_hand' has 48"):
        raw.describe(other)
    assert raw.describe(touches[0]).max() <= 1.0


def test_contact_images_are_scaled_to_the_largest_taxel(rng):
    touch = planted_touches(1, rng=rng)[0]
    image = PaperImages().describe(touch)
    assert image.shape == (2, 6600)  # two moments of the touch
    np.testing.assert_array_equal(image, np.floor(image))
    # The largest taxel has level 255, pixels between taxels less; enlarging keeps most of that.
    held = pressed(touch.samples)
    seen = held[moments(len(held))]
    brightest = touch.skin.image_geometry.images(seen).max(axis=(1, 2)) / seen.max(axis=1)
    share = image.max(axis=1) / (255 * brightest)
    assert ((share > 0.8) & (share <= 1.0)).all()
    still = replace(touch, samples=np.zeros_like(touch.samples))
    assert PaperImages().describe(still).shape == (0, 6600)  # no division by zero


def test_input_kinds_are_known_by_name():
    with pytest.raises(UnknownNameError, match="the input kinds are: raw, histogram, image"):
        descriptor_of("smell")


@pytest.mark.parametrize("name", ["histogram", "contact-geometry", "raw-rbf"])
def test_training_on_untouched_skin_is_refused(name, rng):
    touches = [
        replace(one, samples=np.zeros_like(one.samples)) for one in planted_touches(6, rng=rng)
    ]
    with pytest.raises(InvalidArrayError, match=r"two labels or more, and of each 5 .*; got: none"):
        classifiers.get(name)().fit(touches, rng=rng)


def test_samples_of_floats_count_like_those_of_bytes_and_nan_is_refused(rng):
    touches = planted_touches(4, rng=rng)
    votes = Histograms()
    votes.fit(touches, rng=rng)
    one = touches[0]
    floats = replace(one, samples=one.samples.astype(float))
    np.testing.assert_array_equal(votes.describe(floats), votes.describe(one))
    floats.samples[-1, 3] = np.nan
    with pytest.raises(InvalidArrayError, match="NaN or infinity"):
        votes.describe(floats)
