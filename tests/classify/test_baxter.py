from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import skinmap
from skinmap.errors import InvalidArrayError, MissingLibraryError, SkinWarning, UnknownNameError
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.images import bag_of_words
from skinmap.recognition.images.cnn import ContactImageCNN
from skinmap.recognition.model_file import load_classifier, save_classifier
from skinmap.recognition.protocols import baxter
from skinmap.recognition.protocols.baxter import (
    ACTIONS,
    GESTURES,
    LABELS,
    acted,
    default_settings,
    evaluate_baxter,
    mean_diagonal,
    simulate_images,
    split_images,
    tune,
)
from skinmap.report.result import plain
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate
from tests.classify.golden_network import golden_network


@pytest.fixture(scope="module")
def skin() -> PreparedSkin:
    return PreparedSkin(skinmap.load_robot("baxter-forearm").skin("forearm"))


@pytest.fixture(scope="module")
def data(skin):
    return simulate_images(skin, images=400, rng=np.random.default_rng(7))


def test_images_are_half_of_hands_and_one_a_touch(skin, data):
    assert len(data) == pytest.approx(400, abs=20)
    assert np.mean(data.labels == "hand") == pytest.approx(0.5, abs=0.03)
    assert set(data.gestures) == {name for names in GESTURES.values() for name in names}
    assert len(np.unique(data.events)) == len(data)
    hands = data.labels == "hand"
    # 43 people do each of seven things from two places, and five as they like.
    assert np.mean(data.actions[hands] == "free") == pytest.approx(5 / 19, abs=0.05)
    assert set(data.actions[hands]) == {*ACTIONS, "free"}
    assert set(data.actions[~hands]) == {""}
    # 255 is the largest taxel's; pixels between taxels and resizing lie below it.
    brightest = skin.image_geometry.images(data.raw).max(axis=(1, 2)) / data.raw.max(axis=1)
    assert (data.images.max(axis=(1, 2)) > 0.7 * 255 * brightest).all()
    assert np.median(brightest) > 0.8


def test_split_images_holds_30_percent_of_each_gesture(data, rng):
    for kind in ("event", "plain"):
        held = split_images(kind, data, rng=rng)
        for gesture in np.unique(data.gestures):
            assert held[data.gestures == gesture].mean() == pytest.approx(0.3, abs=0.03)
        pairs = np.empty(len(data), np.int64)
        for number, gesture in enumerate(np.unique(data.gestures)):
            own = np.flatnonzero(data.gestures == gesture)
            pairs[own] = 1000 * number + np.arange(len(own)) // 2
        twice = replace(data, events=pairs)
        held = split_images(kind, twice, rng=rng)
        shared = set(twice.events[held]) & set(twice.events[~held])
        assert bool(shared) == (kind == "plain")


def test_a_push_tips_the_grip_and_a_torque_each_finger(skin):
    at = skin.skin.positions
    near = np.linalg.norm(at - at[300], axis=1) < 0.04
    loads = np.where(near, 1.0, 0.0)[None]
    rng = np.random.default_rng(0)

    def moved(action: str) -> np.ndarray:
        out = acted(loads, skin.skin, action, rng=rng)
        return out[0] @ at / out.sum() - loads[0] @ at / loads.sum()

    assert not moved("grasp").any()
    there, back = moved("push left"), moved("push right")
    assert np.linalg.norm(there) > 3e-3
    assert there @ back < -0.9 * np.linalg.norm(there) * np.linalg.norm(back)
    across = abs(there @ moved("pull")) / np.linalg.norm(there)
    assert across < 0.3 * np.linalg.norm(there)
    # Two fingers on either side of a middle go opposite ways, and stay together as a whole.
    axis = np.linalg.svd(at - at.mean(axis=0), full_matrices=False)[2][0]
    side = (at - at[near].mean(axis=0)) @ axis
    pair = np.stack([near & (side > 0.015), near & (side < -0.015)]).astype(np.float64)
    turned = acted(pair, skin.skin, "torque clockwise", rng=rng)
    first, second = (
        turned[k] @ at / turned[k].sum() - pair[k] @ at / pair[k].sum() for k in (0, 1)
    )
    assert first @ second < -0.5 * np.linalg.norm(first) * np.linalg.norm(second)


def test_the_saved_network_names_fresh_touches(data):
    # The goal on the simulator; the network has seen touches of other seeds only.
    machine = ContactImageCNN("small").take(golden_network())
    assert mean_diagonal(data.labels, machine.predict(data.table)) >= 0.95


def test_a_network_in_a_model_file_names_touches_without_torch(skin, data, tmp_path):
    classifier = classifiers.get("cnn")()
    classifier.estimator.take(golden_network())
    save_classifier(classifier, tmp_path / "m.skinmodel")
    back = load_classifier(tmp_path / "m.skinmodel")
    right = []
    for samples, label in zip(data.raw, data.labels, strict=True):
        touch = Touch(skin, samples[None], rate=50.0)
        # The same touch has the same answer, to the last bit.
        np.testing.assert_array_equal(back.probabilities(touch), classifier.probabilities(touch))
        found = back.predict(touch)
        assert found == classifier.predict(touch)
        right.append(found.label == label)
    assert np.mean(right) >= 0.98
    quiet = Touch(skin, np.zeros((10, len(skin)), np.uint8), rate=50.0)
    assert back.predict(quiet).label == "no_contact"


def test_bags_of_words_come_back_from_a_model_file(skin, tmp_path):
    pytest.importorskip("mahotas", reason="the extra `images` is not installed")
    recording = simulate(
        skin.skin,
        rng=np.random.default_rng(3),
        per_gesture=8,
        gestures=("whole_hand", "forearm"),
        variety=0.0,
    )
    touches = [Touch(skin, samples, label, rate=50.0) for _, label, samples in recording.touches()]
    classifier = classifiers.get("bovw")().fit(touches[:12], rng=np.random.default_rng(0))
    save_classifier(classifier, tmp_path / "m.skinmodel")
    back = load_classifier(tmp_path / "m.skinmodel")
    for touch in touches[12:]:
        np.testing.assert_array_equal(back.probabilities(touch), classifier.probabilities(touch))
    assert np.mean([back.predict(touch).label == touch.label for touch in touches[12:]]) > 0.5


def test_evaluate_baxter_reports_what_it_promises(skin):
    found = evaluate_baxter(skin, seed=1, repeats=2, images=240, methods=("raw_rbf",), tuned=False)
    row = found.raw_rbf
    assert 0.5 < row.mean < 1.0
    assert row.min <= row.mean <= row.max
    assert row.plain.mean == row.mean  # one image a touch: both splits are the same
    table = np.array(found.confusion.raw_rbf)
    np.testing.assert_allclose(table.sum(axis=1), 1.0, atol=1e-12)
    assert np.diag(table).mean() == pytest.approx(row.mean)
    assert np.diag(row.plain.confusion).mean() == pytest.approx(row.plain.mean)
    assert len(row.chosen) == 2
    assert found.confusion.labels == list(LABELS)
    assert found.simulated is True
    again = evaluate_baxter(skin, seed=1, repeats=2, images=240, methods=("raw_rbf",), tuned=False)
    assert plain(again) == plain(found)


def test_bags_of_visual_words_beat_raw_values(skin):
    pytest.importorskip("mahotas", reason="the extra `images` is not installed")
    found = evaluate_baxter(
        skin, seed=1, repeats=1, images=200, methods=("bovw", "raw_rbf"), tuned=False
    )
    assert found.bovw.k == 130
    assert found.bovw.mean > found.raw_rbf.mean + 0.1


def test_tune_takes_the_best_of_what_it_tried(data):
    settings, tried = tune(
        data,
        "raw_rbf",
        default_settings("small"),
        rows=np.arange(len(data)) % 3 > 0,
        kind="event",
        rng=np.random.default_rng(0),
    )
    best = max(tried, key=lambda row: row["mean"])
    assert (settings.penalty, settings.width) == (best["penalty"], best["width"])
    assert len(tried) == 12


def test_the_papers_network_is_tuned_over_table_1(skin, monkeypatch):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    # Two rates, few epochs and folds: the whole table takes hours.
    monkeypatch.setattr(baxter, "TABLE_I", {1e-3: (97.3, 98.3), 1e3: (50.0, 49.0)})
    monkeypatch.setattr(baxter, "TABLE_I_EPOCHS", (1, 2))
    monkeypatch.setattr(baxter, "FOLDS", 2)
    few = simulate_images(skin, images=140, rng=np.random.default_rng(7))
    settings, tried = tune(
        few,
        "cnn",
        default_settings("paper"),
        rows=np.arange(len(few)) % 4 == 0,
        kind="plain",
        rng=np.random.default_rng(0),
    )
    assert [(row["learning_rate"], row["epochs"], row["paper"]) for row in tried] == [
        (1e-3, 1, 0.973),
        (1e-3, 2, 0.983),
        (1e3, 1, 0.5),
        (1e3, 2, 0.49),
    ]
    assert tried[3]["mean"] == pytest.approx(0.5, abs=0.1)  # it ran away
    best = max(tried, key=lambda row: row["mean"])
    assert (settings.learning_rate, settings.epochs) == (best["learning_rate"], best["epochs"])


def test_a_missing_library_leaves_one_method_out(skin, monkeypatch):
    def missing(*_: object, **__: object) -> None:
        raise MissingLibraryError("bags of visual words need mahotas")

    monkeypatch.setattr(bag_of_words, "import_optional", missing)
    with pytest.warns(SkinWarning, match="bovw is left out: .*mahotas"):
        found = evaluate_baxter(skin, seed=1, repeats=1, images=160, methods=("bovw",), tuned=False)
    assert plain(found.bovw) == {"missing": "bags of visual words need mahotas"}
    assert "bovw" not in plain(found.confusion)


def test_evaluate_baxter_refuses_what_it_cannot_do(skin):
    with pytest.raises(InvalidArrayError, match="at least 1 repeat"):
        evaluate_baxter(skin, seed=1, repeats=0)
    with pytest.raises(InvalidArrayError, match="20 images are too few"):
        evaluate_baxter(skin, seed=1, images=20)
    with pytest.raises(
        UnknownNameError, match="no method 'oracle'; the methods are: bovw, cnn, raw_rbf"
    ):
        evaluate_baxter(skin, seed=1, methods=("oracle",))


def test_training_without_torch_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingLibraryError, match=r"needs torch: pip install 'skinmap\[torch\]'"):
        ContactImageCNN().fit(np.zeros((4, 6600)), ["a", "b"] * 2)
