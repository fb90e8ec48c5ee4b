"""The second paper's tables: human hands told from other contacts by contact images.

A. Albini, S. Denei and G. Cannata, "Human hand recognition from robotic skin measurements in
human-robot physical interactions", IROS 2017: 70 % of the images train, K and the network's
training are tuned by 5-fold cross-validation on these, ten random repeats.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, MissingLibraryError, SkinWarning, UnknownNameError
from skinmap.parallel.run import task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.recognition.protocols.baxter_images import (
    HAND,
    OTHER,
    ImageSet,
    simulate_images,
    split_images,
)
from skinmap.recognition.protocols.baxter_methods import (
    METHODS,
    Bench,
    Settings,
    default_settings,
    tune,
)
from skinmap.recognition.protocols.folds import FoldKind, run_repeats
from skinmap.recognition.protocols.results import (
    BaxterResult,
    Confusion,
    MethodResult,
    SplitSpread,
)
from skinmap.touch.prepared_skin import PreparedSkin

ROBOT, PART = "baxter-forearm", "forearm"
IMAGES = 1800
LABELS = (HAND, OTHER)
# On recordings of the real robot: one split, then mean, least and most of ten repeats.
PAPER = {
    "bovw": {"mean": 0.9759, "repeats_mean": 0.9815, "min": 0.9692, "max": 0.989, "k": 130},
    "cnn": {"mean": 0.9868, "repeats_mean": 0.9833, "min": 0.9714, "max": 0.9934},
}


def evaluate_baxter(
    skin: PreparedSkin | ImageSet,
    *,
    seed: int,
    repeats: int = 10,
    images: int = IMAGES,
    network: str = "small",
    methods: Sequence[str] = tuple(METHODS),
    tuned: bool = True,
    variety: float = 0.0,
    robot: str = "",
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> BaxterResult:
    """Bags of visual words, a network and raw values on simulated touches, or on images given.

    Parameters
    ----------
    skin : PreparedSkin or ImageSet
        Of the Baxter-like forearm, or of any other part; `robot` is whose, for the result. Images
        that were given have no raw values: their pixels stand for these.
    seed : int
    repeats : int
        Random splits into 70 % and 30 %; each is made twice, by touches and plain.
    images : int
    network : {"small", "paper"}
        The paper's own size keeps the paper's settings: one training takes minutes.
    methods : sequence of str
        Some of `METHODS`.
    tuned : bool
        Whether K, learning rate, epochs and the baseline's C and gamma are chosen by 5-fold
        cross-validation on the first split's training images.
    workers : Workers
    progress : callable, optional
        Called with what was done.

    Returns
    -------
    BaxterResult
        By method; one whose library is not installed has `missing` alone.

    Raises
    ------
    InvalidArrayError, UnknownNameError
        No repeat, too few images, or a method that there is not.
    """
    if repeats < 1:
        raise InvalidArrayError(f"at least 1 repeat, got {repeats}")
    for name in methods:
        if name not in METHODS:
            raise UnknownNameError("method", name, METHODS)
    if isinstance(skin, ImageSet):
        data, part, taxels = skin, "", 0
    else:
        data = simulate_images(skin, images=images, rng=task_rng(seed, 0), variety=variety)
        part, taxels = skin.skin.part, len(skin)
    bench, found, confusion = Bench(data), dict[str, Any](), dict[str, Any]()
    for name in methods:
        settings, tried = default_settings(network), list[dict[str, Any]]()
        try:
            if tuned:
                rows = ~split_images("event", data, rng=task_rng(seed, 1, 0))
                rng = task_rng(seed, 2)
                settings, tried = tune(bench, name, settings, rows=rows, rng=rng, progress=progress)
            counts = run_repeats(
                baxter_repeat,
                [
                    {"kind": kind, "number": number}
                    for kind in ("event", "plain")
                    for number in range(repeats)
                ],
                workers=workers,
                progress=progress,
                bench=bench,
                method=name,
                settings=settings,
                seed=seed,
            )
        except MissingLibraryError as error:
            warnings.warn(f"{name} is left out: {error}", SkinWarning, stacklevel=2)
            found[name] = MethodResult(missing=str(error))
            continue
        spread, plain = _spread(counts[:repeats]), _spread(counts[repeats:])
        found[name] = MethodResult(
            mean=spread.mean,
            min=spread.min,
            max=spread.max,
            plain=plain,
            tuning=tried,
            **_settings_of(name, settings),
        )
        confusion[name] = _shares(counts[:repeats]).mean(axis=0).tolist()
    return BaxterResult(
        robot=robot,
        part=part,
        taxels=taxels,
        accuracy_is="recorded" if isinstance(skin, ImageSet) else "simulated",
        simulated=not isinstance(skin, ImageSet),
        variety=variety,
        confusion=Confusion(labels=list(LABELS), **confusion),
        images=len(data),
        touches=len(np.unique(data.events)),
        repeats=repeats,
        seed=seed,
        network=network,
        paper=PAPER,
        **found,
    )


def baxter_repeat(
    seed: int, number: int, kind: FoldKind, *, bench: Bench, method: str, settings: Settings
) -> FloatArray:
    """(2, 2) images of each label (rows) that were named each label, in one random split."""
    data = bench.data
    test = split_images(kind, data, rng=task_rng(seed, 1, number))
    named = METHODS[method](bench, ~test, test, settings, number)
    pairs = [
        [np.count_nonzero(named[data.labels[test] == true] == guess) for guess in LABELS]
        for true in LABELS
    ]
    return np.array(pairs, np.float64)


def _shares(counts: Sequence[FloatArray]) -> FloatArray:
    table = np.array(counts)
    return np.asarray(table / table.sum(axis=2, keepdims=True))


def _spread(counts: Sequence[FloatArray]) -> SplitSpread:
    """Mean, least and most of the mean of the diagonal."""
    diagonal = np.einsum("rii->ri", _shares(counts)).mean(axis=1)
    return SplitSpread(
        mean=float(diagonal.mean()), min=float(diagonal.min()), max=float(diagonal.max())
    )


def _settings_of(name: str, settings: Settings) -> dict[str, Any]:
    if name == "bovw":
        return {"k": settings.words}
    if name == "cnn":
        keys = ("network", "learning_rate", "epochs")
        return {key: getattr(settings, key) for key in keys}
    return {"C": settings.penalty, "gamma": settings.width}
