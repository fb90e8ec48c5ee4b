from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.recognition.protocols.folds import make_folds, recalls

EVENTS = np.repeat(np.arange(24), 5)
LABELS = np.repeat(np.tile(["poke", "full_finger", "whole_hand"], 8), 5)


@pytest.mark.parametrize("kind", ["plain", "event"])
def test_each_row_is_tested_once(kind, rng):
    folds = make_folds(kind, LABELS, EVENTS, folds=4, rng=rng)
    tested = np.concatenate([test for _, test in folds])
    assert sorted(tested) == list(range(len(LABELS)))
    for train, test in folds:
        assert not set(train) & set(test)
        assert len(train) + len(test) == len(LABELS)


def test_event_folds_keep_touches_together_and_plain_folds_do_not(rng):
    for train, test in make_folds("event", LABELS, EVENTS, folds=4, rng=rng):
        assert not set(EVENTS[train]) & set(EVENTS[test])
        assert set(LABELS[test]) == set(LABELS)
    for train, test in make_folds("plain", LABELS, EVENTS, folds=4, rng=rng):
        assert set(EVENTS[train]) & set(EVENTS[test])


def test_folds_refuse_too_few_events_and_one_label(rng):
    with pytest.raises(InvalidArrayError, match=r"9 folds need .* 9 touch events each"):
        make_folds("event", LABELS, EVENTS, folds=9, rng=rng)
    make_folds("plain", LABELS, EVENTS, folds=9, rng=rng)  # 40 samples are enough
    with pytest.raises(InvalidArrayError, match=r"two labels .* got: 120 poke"):
        make_folds("plain", np.full(120, "poke"), EVENTS, folds=2, rng=rng)


def test_recalls_count_each_label_by_itself():
    truth, named = np.array(["a", "a", "a", "b"]), np.array(["a", "b", "a", "b"])
    found = recalls(truth, named, ["a", "b", "c"])
    assert (found["a"], found["b"]) == (pytest.approx(2 / 3), 1.0)
    assert np.isnan(found["c"])
