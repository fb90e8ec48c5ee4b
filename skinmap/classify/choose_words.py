"""How many codewords a structure: chosen by cross-validation on labelled touches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from skinmap.classify.intersection import IntersectionSVC
from skinmap.errors import InvalidArrayError
from skinmap.touch.histogram import Mode, PatchSamples, StructureHistogram

CANDIDATES = (2, 4, 8, 16)
FOLDS = 4


def choose_words(
    touches: Sequence[PatchSamples],
    labels: ArrayLike,
    *,
    rng: np.random.Generator,
    groups: ArrayLike | None = None,
    candidates: Sequence[int] = CANDIDATES,
    mode: Mode = "rest-dropped",
) -> tuple[int, dict[int, float]]:
    """The number of codewords with which an intersection SVM names most held-out touches right.

    Codebooks are learnt anew on the training touches of each fold.

    Parameters
    ----------
    touches : sequence of PatchSamples
        One touch, or one sample, each.
    labels : (n,) array-like of str
    rng : numpy.random.Generator
    groups : (n,) array-like of int, optional
        Event of each sample where touches have several: kept on one side of every fold.
    candidates : sequence of int
        Numbers to try.
    mode : {"rest-dropped", "paper"}

    Returns
    -------
    int
        The smallest of the best: within one standard error of the best mean.
    dict of int to float
        Mean accuracy of each candidate.

    Raises
    ------
    InvalidArrayError
        A label with fewer than two touches (or events).
    """
    from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold
    from sklearn.pipeline import make_pipeline

    names = np.asarray(labels)
    events = np.arange(len(names)) if groups is None else np.asarray(groups)
    least = min((len(np.unique(events[names == name])) for name in np.unique(names)), default=0)
    if least < 2:
        raise InvalidArrayError(f"choosing words needs two touches of each label, got {least}")
    seed = int(rng.integers(2**31))
    folds = StratifiedGroupKFold(min(FOLDS, least), shuffle=True, random_state=seed)
    machine = make_pipeline(StructureHistogram(mode=mode, random_state=seed), IntersectionSVC())
    grid = {"structurehistogram__words": sorted(candidates)}
    search = GridSearchCV(machine, grid, cv=folds, refit=False, error_score="raise")
    search.fit(list(touches), names, groups=events)
    mean, spread = search.cv_results_["mean_test_score"], search.cv_results_["std_test_score"]
    best = int(np.argmax(mean))
    error = spread[best] / np.sqrt(folds.get_n_splits())
    smallest = int(np.flatnonzero(mean >= mean[best] - error)[0])
    words = sorted(candidates)
    return words[smallest], dict(zip(words, map(float, mean), strict=True))
