"""The second paper's tables: human hands told from other contacts by contact images.

A. Albini, S. Denei and G. Cannata, "Human hand recognition from robotic skin measurements in
human-robot physical interactions", IROS 2017: 70 % of the images train, K and the network's
training are tuned by 5-fold cross-validation on these, ten random repeats.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from skinmap.recognition.protocols.results import BaxterResult, Confusion, MethodResult, SplitSpread
from skinmap.touch.prepared_skin import PreparedSkin

ROBOT, PART = "baxter-forearm", "forearm"
IMAGES = 1800
LABELS = (HAND, OTHER)
# On recordings of the real robot: one split, then mean, least and most of ten repeats.
# Of that split, in Tables II and III, the shares of hands and of others that were named right.
PAPER = {
    "bovw": {
        "mean": 0.9759, "repeats_mean": 0.9815, "min": 0.9692, "max": 0.989, "k": 130,
        "hand": 0.9692, "other": 0.9826,
    },
    "cnn": {
        "mean": 0.9868, "repeats_mean": 0.9833, "min": 0.9714, "max": 0.9934,
        "learning_rate": 1e-3, "epochs": 50, "hand": 0.9824, "other": 0.9912,
    },
}  # fmt: skip


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
        The paper's own size is tuned over the paper's Table I: hours.
    methods : sequence of str
        Some of `METHODS`.
    tuned : bool
        Whether K, learning rate, epochs and the baseline's C and gamma are chosen by 5-fold
        cross-validation on the training images of each split anew.
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
    # With one image a touch, splits by touch are the plain ones.
    kinds: tuple[FoldKind, ...] = ("event", "plain")
    if len(np.unique(data.events)) == len(data):
        kinds = ("event",)
    for name in methods:
        try:
            runs = run_repeats(
                baxter_repeat,
                [{"kind": kind, "number": number} for kind in kinds for number in range(repeats)],
                workers=workers,
                progress=progress,
                bench=bench,
                method=name,
                network=network,
                tuned=tuned,
                seed=seed,
            )
        except MissingLibraryError as error:
            warnings.warn(f"{name} is left out: {error}", SkinWarning, stacklevel=2)
            found[name] = MethodResult(missing=str(error))
            continue
        touches, plain = (_spread(half) for half in (runs[:repeats], runs[-repeats:]))
        found[name] = MethodResult(
            mean=touches.mean,
            min=touches.min,
            max=touches.max,
            plain=plain,
            tuning=runs[0].tried,
            chosen=[_settings_of(name, run.settings) for run in runs[:repeats]],
            **_settings_of(name, runs[0].settings),
        )
        confusion[name] = touches.confusion
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


@dataclass(frozen=True, eq=False, slots=True)
class Repeat:
    """One random split.

    Attributes
    ----------
    counts : (2, 2) float
        Images of each label (rows) that were named each label.
    settings : Settings
    tried : list of dict
        What tuning tried on its training images.
    """

    counts: FloatArray
    settings: Settings
    tried: list[dict[str, Any]]


def baxter_repeat(
    seed: int, number: int, kind: FoldKind, *, bench: Bench, method: str, network: str, tuned: bool
) -> Repeat:
    """The paper's procedure on one random split: tune on what trains, train, test."""
    data = bench.data
    test = split_images(kind, data, rng=task_rng(seed, 1, number))
    settings, tried = default_settings(network), list[dict[str, Any]]()
    if tuned:
        rng = task_rng(seed, 2, number)
        settings, tried = tune(bench, method, settings, rows=~test, kind=kind, rng=rng)
    named = METHODS[method](bench, ~test, test, settings, number)
    pairs = [
        [np.count_nonzero(named[data.labels[test] == true] == guess) for guess in LABELS]
        for true in LABELS
    ]
    return Repeat(np.array(pairs, np.float64), settings, tried)


def _spread(runs: Sequence[Repeat]) -> SplitSpread:
    """Mean, least and most of the mean of the diagonal, and the mean confusion."""
    table = np.array([run.counts for run in runs])
    shares = table / table.sum(axis=2, keepdims=True)
    diagonal = np.einsum("rii->ri", shares).mean(axis=1)
    return SplitSpread(
        mean=float(diagonal.mean()),
        min=float(diagonal.min()),
        max=float(diagonal.max()),
        confusion=shares.mean(axis=0).tolist(),
    )


def _settings_of(name: str, settings: Settings) -> dict[str, Any]:
    if name == "bovw":
        return {"k": settings.words}
    if name == "cnn":
        keys = ("network", "learning_rate", "epochs")
        return {key: getattr(settings, key) for key in keys}
    return {"C": settings.penalty, "gamma": settings.width}
