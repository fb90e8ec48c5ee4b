"""Knobs of classifiers: each does what it says, and what makes no sense is refused."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.neighbours.structures import RADIUS
from skinmap.recognition.descriptors import PaperImages, Touch
from skinmap.recognition.model_file import load_classifier, save_classifier
from skinmap.recognition.training import read_size, tuned_classifier
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.simulator import simulate


@pytest.fixture(scope="module")
def touches():
    skin = PreparedSkin(skinmap.load_robot("kaspar").skin("right_hand"))
    recording = simulate(
        skin.skin, rng=np.random.default_rng(3), per_gesture=6, gestures=FOUR[:2], variety=0.0
    )
    return [Touch(skin, samples, label, rate=50.0) for _, label, samples in recording.touches()]


def trained(touches, **knobs):
    model = tuned_classifier("histogram", knobs)
    return model.fit(touches, rng=np.random.default_rng(0))


def shares(model, touches):
    return np.array([model.probabilities(touch) for touch in touches])


def test_default_knobs_change_nothing(touches):
    plain = shares(trained(touches), touches)
    same = trained(touches, radius_mm=1e3 * RADIUS, words=8, rotations=6, distance="euclidean")
    np.testing.assert_array_equal(shares(same, touches), plain)


@pytest.mark.parametrize(
    ("knobs", "structures"),
    [({"words": 3}, None), ({"radius_mm": 12.0}, "other"), ({"rotations": 1}, "more")],
)
def test_knobs_reach_the_codebook(touches, knobs, structures):
    plain, tuned = trained(touches).descriptor.codebook, trained(touches, **knobs).descriptor
    book = tuned.codebook
    assert book.words.shape[1] == knobs.get("words", 8)
    assert book.prototypes.rotations == knobs.get("rotations", 6)
    if structures == "more":  # those that differ by a turn are apart
        assert len(book.prototypes) > len(plain.prototypes)
    if structures == "other":  # more neighbours
        assert book.prototypes.filled.sum(axis=1).max() > plain.prototypes.filled.sum(axis=1).max()


@pytest.mark.parametrize("knobs", [{"radius_mm": 11.0, "distance": "geodesic"}, {"rotations": 1}])
def test_a_model_file_keeps_its_knobs(touches, tmp_path, knobs):
    model = trained(touches, **knobs)
    save_classifier(model, tmp_path / "a.skinmodel")
    read = load_classifier(tmp_path / "a.skinmodel")
    kept = read.descriptor
    assert kept.radius == (knobs["radius_mm"] * 1e-3 if "radius_mm" in knobs else None)
    assert kept.distance == knobs.get("distance", "euclidean")
    np.testing.assert_array_equal(shares(read, touches), shares(model, touches))


def test_image_size_reaches_descriptor_and_estimator():
    model = tuned_classifier("cnn", {"image_size": "33x50"})
    assert isinstance(model.descriptor, PaperImages)
    assert model.descriptor.size == model.estimator.image_shape == (33, 50)


def test_images_of_a_size_come_out_and_go_into_arrays(touches):
    small = PaperImages((20, 30))
    assert small.describe(touches[0]).shape == (2, 600)
    again = PaperImages()
    again.from_arrays(small.to_arrays())
    assert again.size == (20, 30)
    with pytest.raises(InvalidArrayError, match="sides are 1 to 1024"):
        again.from_arrays({"size": np.array([0, 10**9])})


@pytest.mark.parametrize(
    ("name", "knobs", "kind", "message"),
    [
        ("nobody", {}, UnknownNameError, "no classifier 'nobody'"),
        ("histogram", {"depth": 3}, UnknownNameError, "no knob of classifiers 'depth'"),
        ("histogram", {"distance": "taxi"}, UnknownNameError, "euclidean, geodesic"),
        ("histogram", {"rotations": 5}, UnknownNameError, "1, 4, 6"),
        ("histogram", {"radius_mm": float("nan")}, InvalidArrayError, "radius_mm must be 0.1"),
        ("histogram", {"words": 1}, InvalidArrayError, "words must be 2 to 250, got 1"),
        ("histogram", {"image_size": "66x100"}, InvalidArrayError, "does not concern"),
        ("contact-geometry", {"words": 8}, InvalidArrayError, "words does not concern"),
        ("cnn", {"image_size": "0x50"}, InvalidArrayError, "rows x columns of 1 to 1024"),
    ],
)
def test_nonsense_is_refused(name, knobs, kind, message):
    with pytest.raises(kind, match=message):
        tuned_classifier(name, knobs)


@pytest.mark.parametrize("text", ["66", "66x", "x100", "6 6x100", "-6x10", "66x100x3", None])
def test_only_rows_by_columns_is_a_size(text):
    with pytest.raises(InvalidArrayError, match="image_size wants"):
        read_size(text)
