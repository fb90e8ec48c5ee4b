from __future__ import annotations

import numpy as np
import pytest
from sklearn.svm import SVC

from skinmap.classify.intersection import IntersectionSVC
from skinmap.classify.protocols import kernels
from skinmap.classify.protocols.folds import make_folds, recalls

KINDS = ("ball", "edge", "poke")


@pytest.fixture
def rows(rng):
    """120 rows of three overlapping labels, 24 events."""
    labels = np.repeat(np.tile(KINDS, 8), 5)
    centre = np.array([KINDS.index(label) for label in labels], float)
    values = np.abs(rng.normal(centre[:, None], 0.8, (len(labels), 6)))
    return values, labels, np.repeat(np.arange(24), 5)


def test_gram_matrices_train_the_machines_of_the_libraries(rows, rng, monkeypatch):
    # With one choice only, both ways are the same machine, so the same labels.
    values, labels, events = rows
    folds = make_folds("event", labels, events, folds=4, rng=rng)
    monkeypatch.setattr(kernels, "PENALTIES", (10.0,))
    kernel = kernels.rbf(values)
    distances = ((values[:, None] - values[None]) ** 2).sum(axis=2)
    gamma = kernels.WIDTHS[1] / np.median(distances[distances > 0])
    one = kernels.Kernel("rbf-svm", kernel.grams[1:2])
    named = kernels.cross_validate(one, labels, events, folds, kind="event", rng=rng)
    for train, test in folds:
        machine = SVC(C=10.0, gamma=gamma).fit(values[train], labels[train])
        np.testing.assert_array_equal(named[test], machine.predict(values[test]))
    counts = np.rint(4.0 * values)
    kernel = kernels.intersection(counts)
    named = kernels.cross_validate(kernel, labels, events, folds, kind="event", rng=rng)
    agree = []
    for train, test in folds:
        # Its own scale is that of the training rows alone, so C differs by a few per cent.
        machine = IntersectionSVC(C=10.0).fit(counts[train], labels[train])
        agree.append(np.mean(named[test] == machine.predict(counts[test])))
    assert np.mean(agree) >= 0.95


def test_plain_folds_flatter_what_remembers_events(rng):
    # Planted: samples of an event are alike, and its label says nothing of its values.
    events = np.repeat(np.arange(40), 6)
    labels = np.tile(["left", "right"], 20)[events]
    values = rng.normal(size=(40, 8))[events] + rng.normal(0.0, 0.01, (240, 8))
    shares = {}
    for kind in ("plain", "event"):
        folds = make_folds(kind, labels, events, folds=4, rng=rng)
        named = kernels.cross_validate(
            kernels.rbf(values), labels, events, folds, kind=kind, rng=rng
        )
        shares[kind] = np.mean(list(recalls(labels, named, ["left", "right"]).values()))
    assert shares["plain"] == 1.0
    # Chance is 0.5; 40 events fall within 0.3 of it with 99.99 %.
    assert abs(shares["event"] - 0.5) < 0.3
