"""The Corpus of Social Touch as its authors judged it: whole subjects left out, and dealt out.

Published (M. M. Jung, R. Poppe, M. Poel, D. K. J. Heylen): 54 % of the rough variants by Bayesian
classifiers and 53 % by support vector machines (ICMI 2014), up to 60 % of all captures (Journal on
Multimodal User Interfaces 11, 2017), both with subjects left out, of 14 gestures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from skinmap.classify.classifier import DEFAULT
from skinmap.classify.descriptors import Touch
from skinmap.classify.protocols.left_out import Judged, LeftOutTrial, run_left_out
from skinmap.parallel.run import run_tasks
from skinmap.parallel.workers import ONE, Workers
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording

PUBLISHED: Mapping[str, float] = {
    "rough variants, Bayesian (2014)": 0.54,
    "rough variants, support vectors (2014)": 0.53,
    "all captures, the best of several (2017)": 0.60,
}
ALL = "all"
WAYS = ("event", "person")


def evaluate_cost(
    recording: Recording,
    skin: PreparedSkin,
    *,
    classifier: str = DEFAULT,
    folds: int = 4,
    seed: int = 0,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, Any]]:
    """Accuracy of a classifier on each variant and on all captures, with subjects left out.

    Parameters
    ----------
    recording : Recording
        From `skinmap.io.recordings.cost.read_cost`.
    skin : PreparedSkin
        The sensor.
    classifier : str
    folds : int
        Of the captures dealt out.
    seed : int
    workers : Workers
    progress : callable, optional

    Returns
    -------
    list of dict
        `variant`, `left_out` and what `run_left_out` gives: `right` and `per_class`, or `reason`.
        Captures hold no rest, so there is no control of it; `first` is of their first samples.
    """
    touches, words = [], []
    for event, label, samples in recording.touches():
        touches.append(Touch(skin, samples, label, int(recording.subjects[event])))
        words.append((recording.sessions[event], recording.people[event]))
    variants = sorted({variant for variant, _ in words})
    trials, rows = [], []
    for variant in (ALL, *(variants if len(variants) > 1 else ())):
        own = [k for k, (said, _) in enumerate(words) if variant in (ALL, said)]
        judged = _judged([touches[k] for k in own], [words[k] for k in own])
        for way in WAYS:
            trials.append(LeftOutTrial(classifier, judged, way, folds, seed, leaks=True))
            rows.append({"variant": variant, "left_out": way, "captures": len(own)})
    found = run_tasks(run_left_out, trials, workers=workers, progress=progress)
    return [row | {"chance": t.judged.chance} | one
            for row, t, one in zip(rows, trials, found, strict=True)]  # fmt: skip


def _judged(touches: Sequence[Touch], words: Sequence[tuple[str, str]]) -> Judged:
    """Captures with their subjects as people, and each subject as a session."""
    people = np.array([person for _, person in words])
    groups = {"person": people, "session": people}
    none = tuple(touch.samples[:0] for touch in touches)
    return Judged(tuple(touches), groups, none, tuple(touch.samples[:3] for touch in touches))
