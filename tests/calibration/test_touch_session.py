"""Touches one by one: the same as all at once, and what to touch next from the first on."""

from __future__ import annotations

import numpy as np

from calibration import Touch, TouchSession, locate_by_touch


def at(bent, taxel):
    return Touch(bent.places[taxel], 1e-3, np.array([taxel]), np.ones(1))


def test_each_touch_says_what_to_touch_next_and_all_are_as_one_call(bent):
    session = TouchSession(bent.layout, bent.vertices, bent.faces, seed=3)
    after = session.add(at(bent, 0))
    away = np.linalg.norm(bent.layout - bent.layout[0], axis=1)
    assert after.tolist() == [np.argmax(away)]  # the far end tells most
    assert session.found is None
    for _ in range(5):
        after = session.add(at(bent, int(after[0])))
    whole = locate_by_touch(
        bent.layout, bent.vertices, bent.faces, session.touches, rng=np.random.default_rng(3)
    )
    assert session.found is not None
    assert np.array_equal(session.found.positions, whole.positions)
    assert np.array_equal(after, whole.next_taxels)
    assert len({int(touch.channels[0]) for touch in session.touches}) == 6
