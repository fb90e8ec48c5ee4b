"""Recordings under cross-validation: folds by touch event, and the leak of plain folds beside.

Groups left out of the training: sessions, people, places of the skin, parts, and the control.

The control asks whether the same classifier names the touches by what they cannot show: the skin
before anybody touched it, and the first samples of each stretch.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError, SkinError
from skinmap.parallel.run import task_rng
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.evaluate import likeliest
from skinmap.recognition.prediction_sets import LEARNT
from skinmap.recognition.protocols.folds import (
    Fold,
    FoldKind,
    Names,
    averaged,
    make_folds,
    run_repeats,
    shares,
)
from skinmap.recognition.protocols.results import AccuracyRow, LeakRow, LeftOutRow, Meaning
from skinmap.touch.contacts.skin_geometry import pool_event
from skinmap.touch.prepared_skin import PreparedSkin

FOLDS = 4
LETTER = r"[^\W\d_]"
KINDS: tuple[FoldKind, ...] = ("plain", "event")


def check_spelling(labels: Sequence[str]) -> None:
    """Refuse labels that differ in spelling only: in case, or in blanks, `_` and `-` of words.

    Numbers, signs and marks tell labels apart: `press 1.5 N` and `press 15 N`, `roll<` and `roll>`.

    Raises
    ------
    InvalidArrayError
    """
    plain: dict[str, str] = {}
    for label in labels:
        folded = normalize("NFC", normalize("NFC", label).casefold())
        spaced = re.sub(rf"[\s_]+|(?<={LETTER})-+(?={LETTER})", " ", folded).strip()
        letters = re.sub(f"(?<={LETTER}) +(?={LETTER})", "", spaced)
        if letters in plain:
            raise InvalidArrayError(
                f"labels {plain[letters]!r} and {label!r} differ in spelling only: "
                "the recordings do not match"
            )
        plain[letters] = label


def evaluate_recordings(
    touches: Sequence[Touch],
    *,
    names: Sequence[str],
    seeds: Sequence[int],
    folds: int = FOLDS,
    optional: bool = False,
    **who: Any,
) -> tuple[list[AccuracyRow], list[LeakRow], dict[str, str]]:
    """Cross-validate classifiers on labelled touches.

    Parameters
    ----------
    touches : sequence of Touch
        Labelled.
    names : sequence of str
        Classifiers.
    seeds : sequence of int
        One repetition each: other folds.
    folds : int
    optional : bool
        Whether a classifier that cannot run on these touches is named in `skipped` instead.
    who
        `workers` and `progress` of `run_tasks`.

    Returns
    -------
    list of AccuracyRow
        For each classifier and kind of folds.
    list of LeakRow
        By how much plain folds flatter each classifier that names better than chance in either.
    dict of str to str
        Classifiers that were skipped, and why.

    Raises
    ------
    InvalidArrayError
        Fewer touches of a label than folds.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.recognition import recorded_touches
    >>> from skinmap.touch.prepared_skin import PreparedSkin
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("left_hand"))
    >>> kinds = ["poke", "full_finger"]
    >>> played = skinmap.simulate(skin.skin, per_gesture=10, gestures=kinds, rng=0)
    >>> table, leak, skipped = evaluate_recordings(
    ...     recorded_touches(skin, played), names=["raw-intersection"], seeds=[0], folds=2
    ... )
    >>> [(row.folds, row.touches) for row in table], skipped
    ([('plain', 20), ('event', 20)], {})
    """
    labels = np.array([touch.label for touch in touches])
    # Refuses what cannot be folded before anything is computed.
    _touch_folds(labels, folds, task_rng(0))
    for name in names:
        classifiers.get(name)
    trials = [
        {"classifier": name, "kind": kind, "seed": seed}
        for name in names
        for kind in KINDS
        for seed in seeds
    ]
    found = run_repeats(run_trial, trials, touches=tuple(touches), folds=folds, **who)
    table: list[AccuracyRow] = []
    skipped: dict[str, str] = {}
    for place in range(0, len(found), len(seeds)):
        name, repeats = str(trials[place]["classifier"]), found[place : place + len(seeds)]
        rows = [one for one in repeats if isinstance(one, AccuracyRow)]
        if len(rows) == len(repeats):
            table.append(averaged(rows))
            continue
        why = next(one for one in repeats if isinstance(one, str))
        if not optional:
            raise InvalidArrayError(f"{name}: {why}")
        skipped[name] = why
    means = {(row.classifier, row.folds): row.mean for row in table}
    even = 1.0 / len(np.unique(labels))
    least = even + AT_CHANCE * float(np.sqrt(even * (1.0 - even) / len(labels)))
    leak = [
        LeakRow(classifier=name, points=100.0 * (mean - honest))
        for (name, kind), mean in means.items()
        if kind == "plain" and (honest := means.get((name, "event"))) is not None
        if max(mean, honest) > least
    ]
    return table, leak, skipped


def _touch_folds(labels: Names, folds: int, rng: np.random.Generator) -> list[Fold]:
    return make_folds("event", labels, np.arange(len(labels)), folds=folds, rng=rng)


def run_trial(
    classifier: str, kind: FoldKind, seed: int, *, touches: Sequence[Touch], folds: int
) -> AccuracyRow | str:
    """Share named right of each label, or why the classifier cannot run on these touches."""
    try:
        named, labels = _cross_validate(classifier, kind, touches, folds, task_rng(seed))
    except SkinError as error:
        return str(error)
    return AccuracyRow(
        folds=kind,
        features=classifier,
        classifier=classifier,
        touches=len(touches),
        **shares(labels, named, np.unique(labels).tolist()),
    )


def _cross_validate(
    classifier: str, kind: FoldKind, touches: Sequence[Touch], folds: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    labels = np.array([touch.label for touch in touches])
    if kind == "event":
        splits = _touch_folds(labels, folds, rng)
        sides = [([touches[i] for i in a], [touches[i] for i in b]) for a, b in splits]
    else:
        sides = _split_samples(touches, folds, rng)
    named, truth = [], []
    for number, (train, test) in enumerate(sides, 1):
        try:
            model = classifiers.get(classifier)().fit(train, rng=rng)
        except InvalidArrayError as error:
            raise InvalidArrayError(f"fold {number} of {folds}: {error}") from None
        named += [likeliest(model, touch).label for touch in test]
        truth += [touch.label for touch in test]
    return np.array(named), np.array(truth)


def _split_samples(
    touches: Sequence[Touch], folds: int, rng: np.random.Generator
) -> list[tuple[list[Touch], list[Touch]]]:
    """Samples dealt out to folds whatever touch they are of: a touch is on both sides."""
    deals = [rng.permutation(len(touch.samples)) % folds for touch in touches]
    sides = []
    for fold in range(folds):
        pairs = list(zip(touches, deals, strict=True))
        train = [_some(touch, deal != fold) for touch, deal in pairs]
        test = [_some(touch, deal == fold) for touch, deal in pairs if (deal == fold).any()]
        sides.append((train, test))
    return sides


def _some(touch: Touch, chosen: BoolArray) -> Touch:
    """A touch with some of its samples (k,), which take as long as all of them."""
    rate = touch.rate * float(chosen.mean())
    return replace(touch, samples=touch.samples[chosen], rate=rate)


Way = Literal["event", "session", "person", "place", "part"]
NAIVE: Way = "event"
MAX_GROUPS = 10  # more groups than that are left out several at a time
REGIONS = 4  # places of a part
AT_CHANCE = 2.33  # standard deviations above chance that one draw in a hundred exceeds
PERHAPS = 0.1  # a figure that chance gives less often may be more than chance
SURE = 0.01  # a control so unlikely to come by chance is a leak
RIDGE = 10.0  # of standardised values; flat for a factor of ten around here on simulated rest


@dataclass(frozen=True, eq=False, slots=True)
class Judged:
    """Touches to judge by.

    Attributes
    ----------
    touches : tuple of Touch
    groups : mapping of str to (m,) array of str
        Session, person, place and part of each; an empty word where that is not known.
    before, first : tuple of (k, n) uint8
        What the skin read before each touch, and in the first samples of its stretch.
    """

    touches: tuple[Touch, ...]
    groups: Mapping[str, Names]
    before: tuple[NDArray[np.uint8], ...]
    first: tuple[NDArray[np.uint8], ...]

    @property
    def labels(self) -> Names:
        """(m,) names."""
        return np.array([touch.label for touch in self.touches])

    @property
    def chance(self) -> float:
        """Share of the label that is most frequent."""
        return float(np.unique(self.labels, return_counts=True)[1].max() / len(self.touches))


def places_of(touches: Sequence[Touch], *, regions: int = REGIONS) -> Names:
    """Region of the skin that each touch is centred in: parts are cut into pieces of equal width.

    A region's middle is the taxel farthest from the middles before it, the first one farthest
    from the part's centre; each touch is of the region whose middle its heaviest taxel is nearest.
    """
    middles: dict[PreparedSkin, FloatArray] = {}
    found = []
    for touch in touches:
        if touch.skin not in middles:
            middles[touch.skin] = _farthest(touch.skin.skin.positions, regions)
        load = pool_event(touch.samples)
        if not load.any():
            found.append("")
            continue
        where = load @ touch.skin.skin.positions / load.sum()
        nearest = int(np.linalg.norm(middles[touch.skin] - where, axis=1).argmin())
        found.append(f"{touch.skin.skin.part} {nearest + 1}")
    return np.array(found)


def _farthest(points: FloatArray, count: int) -> FloatArray:
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    gap = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        gap = np.minimum(gap, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(gap.argmax()))
    return np.asarray(points[chosen])


def group_folds(way: Way, groups: Names, labels: Names) -> list[Fold]:
    """Rows to train on and rows to test on, each group on one side only.

    Parameters
    ----------
    way : {"session", "person", "place", "part"}
        What the groups are, for messages.
    groups : (n,) array of str
        Group of each touch; an empty word where it is not known.
    labels : (n,) array of str

    Returns
    -------
    list of (train, test)
        Row numbers of each fold; every label that is tested is trained on. More than ten groups
        are left out several at a time.

    Raises
    ------
    InvalidArrayError
        Groups that are not known, one group only, or a label of one group only: nothing could
        be learnt for it.

    Examples
    --------
    >>> people = np.array(["ada", "ada", "bob", "bob"])
    >>> folds = group_folds("person", people, np.array(["poke", "rub"] * 2))
    >>> [people[test].tolist() for _, test in folds]
    [['ada', 'ada'], ['bob', 'bob']]
    """
    kinds, number = np.unique(groups, return_inverse=True)
    unknown = int((groups == "").sum())
    if unknown:
        raise InvalidArrayError(f"the {way} of {unknown} touches is not known")
    if len(kinds) < 2:
        raise InvalidArrayError(f"all touches are of one {way} ({kinds[0]}): none can be left out")
    if alone := _of_one_group(groups, labels):
        named = ", ".join(f"{label} ({where})" for label, where in alone.items())
        raise InvalidArrayError(
            f"touches of one {way} only: {named}; left out, nothing is left to learn them from"
        )
    fold = number if len(kinds) <= MAX_GROUPS else _dealt(number, labels)
    every = np.arange(len(labels))
    return [(every[fold != k], every[fold == k]) for k in range(int(fold.max()) + 1)]


def _of_one_group(groups: Names, labels: Names) -> dict[str, str]:
    """Labels that one group alone has, and which."""
    having = {label: np.unique(groups[labels == label]) for label in np.unique(labels).tolist()}
    return {label: str(own[0]) for label, own in having.items() if len(own) == 1}


def _nested(groups: Names, right: BoolArray, labels: Names) -> bool:
    """Whether no group has two labels, and too few groups are named right for that not to matter.

    Touches of such a group are right or wrong together.
    """
    own = [groups == one for one in np.unique(groups)]
    if any(len(np.unique(labels[rows])) > 1 for rows in own):
        return False
    held = np.array([str(labels[rows][0]) for rows in own])
    chance = float(np.unique(held, return_counts=True)[1].max() / len(held))
    return not _no_chance(np.array([right[rows].mean() > 0.5 for rows in own]), chance)


def _dealt(number: IntArray, labels: Names) -> IntArray:
    """Fold of each row: groups dealt out so that folds are of about equal size.

    The groups of a label are never all in one fold: nothing would be left to learn it from. Where
    that cannot be, each group is a fold of its own.
    """
    sizes = np.bincount(number)
    having = {label: set(number[labels == label].tolist()) for label in np.unique(labels).tolist()}
    fold, load = np.full(len(sizes), -1), np.zeros(MAX_GROUPS)
    for group in np.argsort(-sizes, kind="stable").tolist():
        full = set()
        for groups in having.values():
            others = {int(fold[one]) for one in groups - {group}}
            if group in groups and len(others) == 1:  # the last one of a label
                full |= others
        free = [k for k in np.argsort(load, kind="stable").tolist() if k not in full]
        if not free:
            return number
        fold[group] = free[0]
        load[free[0]] += sizes[group]
    return fold[number]


def run_left_out(classifier: str, way: Way, *, judged: Judged, folds: int, seed: int) -> LeftOutRow:
    """Accuracy of a classifier under a split, of the controls under the same, and what that means.

    Controls are what the same classifier names at rest (`control`) and in the first samples
    (`first`), and what raw values name at rest (`raw`).
    """
    labels, rng, own = judged.labels, task_rng(seed), judged.groups.get(way)
    row = LeftOutRow(
        classifier=classifier,
        left_out=way,
        groups=len(labels) if own is None else len(np.unique(own)),
        chance=judged.chance,
    )
    try:
        splits = _touch_folds(labels, folds, rng) if own is None else group_folds(way, own, labels)
        named = _named(classifier, judged.touches, splits, rng)
    except SkinError as error:
        return replace(row, verdict=str(error))
    units = _units(judged, splits)
    rest, first = (_at(judged.touches, one) for one in (judged.before, judged.first))
    said = {
        "control": _names_of_nothing(classifier, rest, splits, rng),
        "first": _names_of_nothing(classifier, first, splits, rng),
        "raw": _raw_names(rest, labels, splits),
    }
    controls = {name: control_of(own, labels, units, judged.chance) for name, own in said.items()}
    meaning, verdict = meaning_of(named, controls, way, judged)
    return replace(
        row,
        **shares(labels, named, np.unique(labels).tolist()),
        right=float((named == labels).mean()),
        meaning=meaning,
        verdict=verdict,
        control=controls["control"].share,
        first=controls["first"].share,
        raw=controls["raw"].share,
    )


def _units(judged: Judged, splits: Sequence[Fold]) -> IntArray | None:
    """(m,) what is independent of each other where no session is on both sides of a split.

    All touches of one label and session have the same rest before them: they are right or wrong
    together. None where sessions are on both sides, which is what a control is there to find.
    """
    sessions = judged.groups["session"]
    if any(np.isin(sessions[test], sessions[train]).any() for train, test in splits):
        return None
    pairs = np.char.add(np.char.add(sessions, "\n"), judged.labels)
    return np.asarray(np.unique(pairs, return_inverse=True)[1]).reshape(-1)


def _named(
    classifier: str, touches: Sequence[Touch], splits: Sequence[Fold], rng: np.random.Generator
) -> Names:
    """What each touch is named by a model of the other side of its split."""
    named = np.full(len(touches), "", dtype=object)
    for train, test in splits:
        learnt = [touches[k] for k in train.tolist()]
        model = classifiers.get(classifier)().fit(learnt, rng=rng, least=LEARNT)
        for k in test.tolist():
            named[k] = likeliest(model, touches[k]).label
    return named.astype(str)


def _at(touches: Sequence[Touch], samples: Sequence[NDArray[np.uint8]]) -> list[Touch]:
    """The same touches with other samples: nothing is taken away from what the skin read."""
    return [replace(touch, samples=own) for touch, own in zip(touches, samples, strict=True)]


def _names_of_nothing(
    classifier: str, touches: Sequence[Touch], splits: Sequence[Fold], rng: np.random.Generator
) -> Names | None:
    """Names of touches that show nothing; None where there is nothing to learn from."""
    some = np.array([len(touch.samples) > 0 for touch in touches])
    if not some.any():
        return None
    kept = [(train[some[train]], test[some[test]]) for train, test in splits]
    try:
        return _named(classifier, touches, kept, rng)
    except (SkinError, ValueError):
        return None


def _raw_names(touches: Sequence[Touch], labels: Names, splits: Sequence[Fold]) -> Names | None:
    """Names by a linear classifier of the mean raw values, of each skin its own."""
    from sklearn.linear_model import RidgeClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    named = np.full(len(touches), "", dtype=object)
    for skin in dict.fromkeys(touch.skin for touch in touches):
        own = np.array([touch.skin is skin and len(touch.samples) > 0 for touch in touches])
        rows = np.zeros((len(touches), len(skin)))
        for k in np.flatnonzero(own).tolist():
            rows[k] = touches[k].samples.mean(axis=0)
        for train, test in splits:
            train, test = train[own[train]], test[own[test]]
            if len(test) == 0 or len(np.unique(labels[train])) < 2:
                continue
            model = make_pipeline(StandardScaler(), RidgeClassifier(RIDGE))
            named[test] = model.fit(rows[train], labels[train]).predict(rows[test])
    return named.astype(str) if (named != "").any() else None


Leak = Literal["yes", "perhaps", "no"]


class Control(NamedTuple):
    """Share named right of what shows no touch, NaN where nothing is seen, and what that says."""

    share: float
    leak: Leak


def control_of(
    named: Names | None, labels: Names, units: IntArray | None, chance: float
) -> Control:
    """Whether so many right names can hardly come by chance (one-sided binomial test).

    Parameters
    ----------
    named : (m,) array of str, or None
        Empty words are not tested.
    labels : (m,) array of str
    units : (m,) array of int, optional
        Touches that are right or wrong together; each alone by default. Where the touches alone
        would be no chance but the units may be, it leaks `perhaps`: there are too few of them.
    chance : float
    """
    if named is None:
        return Control(float("nan"), "no")
    some = named != ""
    right = (named == labels)[some]
    share = float(right.mean())
    if not _no_chance(right, chance):
        return Control(share, "no")
    if units is None:
        return Control(share, "yes")
    own = units[some]
    together = np.array([right[own == unit].mean() > 0.5 for unit in np.unique(own)])
    return Control(share, "yes" if _no_chance(together, chance) else "perhaps")


def _no_chance(right: BoolArray, chance: float, *, sure: float = SURE) -> bool:
    from scipy.stats import binomtest

    test = binomtest(int(right.sum()), len(right), chance, alternative="greater")
    return bool(test.pvalue < sure)


def at_chance(named: Names, labels: Names) -> tuple[Meaning, str] | None:
    """A figure that names drawn without a look at the touches give as well; None for a better one.

    Chance is the share named right if names and labels, as frequent as they are, were independent:
    with uneven labels a figure below the share of the most frequent one may still mean something.

    Parameters
    ----------
    named, labels : (m,) array of str

    Examples
    --------
    >>> labels = np.array(["poke", "rub"] * 20)
    >>> at_chance(labels, labels)
    >>> at_chance(labels[::-1], labels)[1]
    'is far below chance: labels are exchanged, or confounded with the groups'
    """
    right = named == labels
    share = float(right.mean())
    chance = sum(float((labels == one).mean() * (named == one).mean()) for one in np.unique(labels))
    if share < chance / 2 and _no_chance(~right, 1.0 - chance):
        return "no", "is far below chance: labels are exchanged, or confounded with the groups"
    if _no_chance(right, chance):
        return None
    if share > chance and _no_chance(right, chance, sure=PERHAPS):
        return "doubtful", "is doubtful: of so few touches that may be chance; record more"
    return "no", "is not above chance"


def meaning_of(
    named: Names, controls: Mapping[str, Control], way: Way, judged: Judged
) -> tuple[Meaning, str]:
    """Whether a figure says something of touches, and why, in one line.

    Parameters
    ----------
    named : (m,) array of str
        What the touches were named.
    controls : mapping of str to Control
        `control`, `first` and `raw`.
    way : str
        What was left out.
    judged : Judged
    """
    split = "touches dealt out" if way == NAIVE else f"a {way} left out"
    right, labels = named == judged.labels, judged.labels
    figure = f"{100 * right.mean():.1f} % with {split}"
    chance = f"chance is {100 * judged.chance:.1f} %"
    if (none := at_chance(named, labels)) is not None:
        alone = () if way == "session" else _of_one_group(judged.groups["session"], labels)
        only = f"; {', '.join(alone)} recorded in one session only" if alone else ""
        return none[0], f"{figure} {none[1]}; {chance}{only}"
    who = {
        "control": "the same classifier names {} before the touches",
        "first": "the same classifier names {} of the first samples",
        "raw": "raw values before the touches name {}",
    }
    said = {name: who[name].format(f"{100 * controls[name].share:.1f} %") for name in who}
    for name in ("control", "first"):
        if controls[name].leak == "yes":
            return "no", f"{figure} means nothing: {said[name]}, {chance}"
    doubt = ""
    if controls["raw"].leak == "yes":
        doubt = f"{said['raw']}, {chance}" + "; leave sessions out" * (way != "session")
    elif unsure := [name for name in who if controls[name].leak == "perhaps"]:
        doubt = f"{said[unsure[0]]}, {chance}; of so few sessions that may be chance: record more"
    elif way in ("session", "person") and _nested(judged.groups[way], right, labels):
        doubt = (
            f"each {way} recorded one label only, so {way} and touch cannot "
            f"be separated; record several labels in each {way}"
        )
    elif way != "session" and (alone := _of_one_group(judged.groups["session"], labels)):
        doubt = (
            f"{', '.join(alone)} recorded in one session only, so session "
            "and touch cannot be separated; record each label in two sessions or more"
        )
    if doubt:
        return "doubtful", f"{figure} is doubtful: {doubt}"
    if not any(len(samples) for samples in judged.before):
        return "doubtful", f"{figure} has no control: nothing was recorded before the touches"
    raw, control = controls["raw"].share, controls["control"].share
    values = "raw values were never seen on that skin" if raw != raw else said["raw"]
    own = "the same classifier sees nothing there" if control != control else said["control"]
    return "yes", f"{figure} means something: {values}, {own}, {chance}"
