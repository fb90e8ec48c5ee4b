"""Classifiers of touches: a descriptor and a scikit-learn estimator under one name.

One name for every touch: touches are told apart as for any classifier, and not judged.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import BrokenPluginError, InvalidArrayError, NotFittedError, SkinMismatchError
from skinmap.geometry.proximity import median_spacing
from skinmap.recognition.catalogue import DEFAULT as DEFAULT
from skinmap.recognition.catalogue import classifiers as classifiers
from skinmap.recognition.descriptors import ContactGeometry, Descriptor, Touch
from skinmap.recognition.histograms.intersection import IntersectionSVC, one_vs_rest
from skinmap.recognition.prediction_sets import (
    AGES,
    UNKNOWN,
    SetCalibration,
    check_coverage,
    early_doubt,
    enough_names,
    felt_rows,
    held_out,
)
from skinmap.skin.skin import Skin, fingerprint
from skinmap.summary import Summary, listed
from skinmap.touch.contacts.skin_geometry import ACTIVE, pool_event
from skinmap.touch.prepared_skin import MM, PreparedSkin, SkinDifference, TrainedSkin, compare_skin

if TYPE_CHECKING:
    from skinmap.recognition.answering import ThreeAnswers
    from skinmap.recognition.answers import Answers


NO_CONTACT = "no_contact"
CALIBRATION_FOLDS = 5
CHECKED = 200  # rows of a plug-in that its answers are checked on
# Pitches of the training that a skin may have more or less; shipped robots differ by up to 1.3.
FAR = 2.0
ROWS = 1200  # training rows at most: the cost of a Gram matrix grows with the square
Probabilities = Callable[[FloatArray], FloatArray]
# Classifiers quick enough to train that `skinmap train` also calibrates sets of names.
WITH_SETS = (DEFAULT, "histogram", "histogram-chi2", "histogram-sqrt")


def learnable(touches: Sequence[Touch]) -> list[Touch]:
    """Simulated touches of the gestures that come often enough to be learnt.

    A gesture that hardly fits on a skin, such as a hand on a hand, is left out.
    """
    counts = Counter(touch.label for touch in touches)
    return [touch for touch in touches if counts[touch.label] >= CALIBRATION_FOLDS]


@dataclass(frozen=True, slots=True)
class Prediction:
    """Label of a touch, with a confidence of 0 to 1.

    `names` hold the truth as often as was asked for; None where that was not asked for. `answers`
    are of kind, motion and hand; None where nobody gave them.
    """

    label: str
    confidence: float
    names: tuple[str, ...] | None = None
    answers: Answers | None = None


class Classifier(Summary):
    """Names touches; `skinmap.train` makes one, `Classifier.load` reads one.

    Parameters
    ----------
    name : str
        Under which it was registered.
    descriptor : Descriptor
        Turns the samples of a touch into rows of numbers.
    estimator : scikit-learn classifier
        With `predict_proba`.

    Attributes
    ----------
    labels : tuple of str
        Names that it can give, once it is trained.
    trained_on : tuple of TrainedSkin
        Part and taxel positions (n, 3) [m] of the skins that it was trained on.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> gestures = ["poke", "full_finger"]
    >>> touches = skinmap.simulate(robot.skin("torso"), gestures=gestures, per_gesture=8, rng=0)
    >>> classifier = skinmap.train(touches, robot)
    >>> classifier.save("touch.skinmodel")
    >>> skinmap.Classifier.load("touch.skinmodel")
    Classifier(name=contact-geometry, labels=full_finger, poke, trained_on=torso)
    """

    def __init__(self, name: str, descriptor: Descriptor, estimator: Any) -> None:
        self.name, self.descriptor, self.estimator = name, descriptor, estimator
        self.trained_on: tuple[TrainedSkin, ...] = ()
        self.sets: SetCalibration | None = None
        self.coverage: float | None = None
        self.doubt: FloatArray | None = None
        self.own_answers: ThreeAnswers | None = None
        self._quick: tuple[Any, Callable[[FloatArray], FloatArray]] | None = None
        self._pitches: tuple[tuple[TrainedSkin, ...], list[float]] = ((), [])
        self.check: Callable[..., None] | None = None  # of a plug-in's estimator, once trained

    @property
    def labels(self) -> tuple[str, ...]:
        """Names that the classifier can give.

        Raises
        ------
        NotFittedError
            Before training.
        """
        if not hasattr(self.estimator, "classes_"):
            raise NotFittedError(f"the classifier {self.name!r} is not trained yet")
        return tuple(map(str, self.estimator.classes_))

    def fit(
        self,
        touches: Sequence[Touch],
        *,
        rng: np.random.Generator,
        sets: bool = False,
        least: int = CALIBRATION_FOLDS,
    ) -> TouchClassifier:
        """Train on labelled touches; with `sets` so that sets of names can be promised, too.

        That takes a training for each of five groups of parts or people left out, whose touches
        and their beginnings are named, so that young ones are doubted as they should be. Fewer than
        `least` touches of a label are refused; of more rows than an estimator is meant for some are
        drawn.

        Raises
        ------
        InvalidArrayError
            Fewer than two labels, or a label with fewer than five touches in contact.
        BrokenPluginError
            A plug-in that fails, or whose answers cannot be.
        """
        from skinmap.recognition.answering import ThreeAnswers

        self.own_answers = ThreeAnswers()
        skins = dict.fromkeys(touch.skin for touch in touches)
        self.trained_on = tuple(TrainedSkin(skin.skin.part, skin.skin.positions) for skin in skins)
        self.descriptor.fit(touches, rng=rng)
        self.sets = self.doubt = None
        labels = np.array([touch.label for touch in touches])
        _check_labels(labels, least)  # of all: before minutes are spent on those that are felt
        rows = [self.descriptor.describe(touch) for touch in touches]
        _check_labels(labels[np.array([len(row) > 0 for row in rows], bool)], least)
        table = np.concatenate(rows)
        named = np.repeat(labels, [len(row) for row in rows])
        most = getattr(self.estimator, "most_rows", ROWS)
        if len(table) > most:
            some = np.sort(rng.choice(len(table), most, replace=False))
            table, named = table[some], named[some]
        try:
            self.estimator.fit(table, named)
        except Exception as error:
            if self.check is None:
                raise
            raise BrokenPluginError(f"the plug-in {self.name!r} fails: {error!r}") from error
        if self.check is not None:
            some = np.linspace(0, len(table) - 1, min(len(table), CHECKED)).astype(int)
            self.check(self.name, self.estimator, table[some], named)
        self._quick = None
        if sets:
            self.sets, own = held_out(self._copy, touches, rng=rng)
            moving = getattr(self.descriptor, "moving", False)
            self.doubt = early_doubt(own, len(self.labels)) if moving else None
        return self

    @property
    def answers(self) -> ThreeAnswers | None:
        """What says kind, motion and hand beside the label: its own, else the model's that ships.

        None of a classifier that judges nothing.
        """
        from skinmap.recognition.answering import shipped_answers

        shipped = shipped_answers()
        return shipped if self.own_answers is None else self.own_answers.completed(shipped)

    def _copy(self) -> Classifier:
        """An untrained classifier that looks at the same, motion or not."""
        from sklearn.base import clone

        descriptor = copy(self.descriptor)
        if isinstance(descriptor, ContactGeometry):
            descriptor.motion = descriptor.moving
        return Classifier(self.name, descriptor, clone(self.estimator))

    def save(self, path: str | Path) -> None:
        """Write a trained classifier (`.skinmodel`).

        Parameters
        ----------
        path : str or Path
            File to write; one that is there is replaced.

        Raises
        ------
        NotFittedError
            Before training.
        OutputError
            The file cannot be written.
        """
        from skinmap.recognition.model_file import save_classifier

        save_classifier(self, path)

    @staticmethod
    def load(path: str | Path) -> TouchClassifier:
        """Read what `save` or `skinmap train` wrote; nothing in the file is executed.

        Parameters
        ----------
        path : str or Path
            A file ending in .skinmodel.

        Returns
        -------
        Classifier
            Trained.

        Raises
        ------
        MissingFileError
            No such file.
        DataFormatError
            It is no Skinmap model, or holds types that a model has no use for.
        UnknownNameError
            A classifier whose plug-in is not installed.
        """
        from skinmap.recognition.model_file import load_classifier

        return load_classifier(path)

    def promise(self, coverage: float) -> None:
        """Give `names` with each prediction that hold the truth in this share of all touches.

        Raises
        ------
        InvalidArrayError
            No share between 0 and 1.
        NotFittedError
            A model without held-out touches to promise by.
        """
        if self.sets is None:
            raise NotFittedError(
                f"this {self.name!r} model keeps no held-out touches to promise a coverage by; "
                f"`skinmap train` keeps them for {', '.join(WITH_SETS)}"
            )
        self.coverage = check_coverage(coverage)

    def prepare(self, skin: PreparedSkin) -> None:
        """Make ready to name touches on a skin one at a time, by compiled loops where numba is.

        Nothing has to be prepared; the first touches only take longer without.
        """
        if hasattr(self.descriptor, "counter"):
            self.descriptor.counter(skin, compiled=True)
        for inner in getattr(self.estimator, "calibrated_classifiers_", []):
            if isinstance(inner.estimator, IntersectionSVC):
                inner.estimator.function_.compile()

    def difference(self, skin: Skin, people: Sequence[str] = ("",)) -> SkinDifference:
        """How a skin differs from those trained on, and whether touches can be named there.

        The message also names sets that would hold all names, for touches by these people.
        """
        one_skin = bool(getattr(self.descriptor, "one_skin", False))
        found = compare_skin(self.trained_on, skin, one_skin=one_skin)
        if self.trust(skin.spacing) < 1.0:
            far = f"taxels {skin.spacing * MM:.3g} mm apart are far from those learnt"
            message = "; ".join(filter(None, (found.message, f"{far}: names are doubted")))
            found = replace(found, message=message)
        if self.sets is None or self.coverage is None:
            return found
        now, much = fingerprint(skin), f"sets of names on {skin.part!r} hold all names"
        wide = [one for one in people if np.isinf(self.sets.threshold(self.coverage, now, one))]
        if not wide:
            return found
        new = [one for one in wide if one not in self.sets.people]
        if new and np.isfinite(self.sets.threshold(self.coverage, now)):
            were = f"{' and '.join(new)} {'was' if len(new) == 1 else 'were'} not in training"
            much = f"{much} by {' and '.join(new)}: {were}; name three persons or more there"
        else:
            much += (
                ": too few parts or touches were held out in training to promise "
                f"{self.coverage:g} there"
            )
        return replace(found, message="; ".join(filter(None, (found.message, much))))

    def check_skins(self, skins: Iterable[PreparedSkin]) -> None:
        """Refuse skins on which touches cannot be named.

        Raises
        ------
        SkinMismatchError
            It reads taxels by their number, and learnt another skin.
        """
        for skin in skins:
            difference = self.difference(skin.skin)
            if not difference.may_go_on:
                raise SkinMismatchError(f"{self.name!r} cannot go on: {difference.message}")

    def trust(self, pitch: float) -> float:
        """How far names are believed on a skin of this pitch [m]: 1 up to `FAR` times those learnt.

        Beyond that it falls with the square, as the number of taxels that a touch covers.
        """
        if self._pitches[0] is not self.trained_on:
            own = [median_spacing(one.positions) for one in self.trained_on]
            self._pitches = self.trained_on, [one for one in own if one > 0.0]
        known = self._pitches[1]
        if not known:
            return 1.0
        return min(1.0, FAR * max(known) / pitch, FAR * pitch / min(known)) ** 2

    def probabilities(self, touch: Touch) -> FloatArray | None:
        """Probability of each of `labels`, the mean over rows; None without contact."""
        labels = self.labels
        rows = self.descriptor.describe(touch)
        if len(rows) == 0:
            return None
        if self._quick is None or self._quick[0] is not self.estimator:
            self._quick = (self.estimator, quick_probabilities(self.estimator))
        mean = np.asarray(self._quick[1](rows)).mean(axis=0)
        return mean.reshape(len(labels))

    def predict(self, touch: Touch, *, ended: bool = True) -> Prediction:
        """Label and confidence of a touch.

        `no_contact` where nothing is touched, `unknown` below the confidence that the estimator
        chose on held-out touches (its `reject_`, if it has one). A touch that goes on is named
        with doubt while it is young, by a classifier that looks at how touches go on: a finger
        that has just landed looks like a tap. So is every touch on a skin far coarser or finer
        than those learnt (`trust`).
        """
        share = self.probabilities(touch)
        if share is None:
            return self.no_contact(touch.skin, touch.person)
        doubted, trust = share, self.trust(touch.skin.pitch)
        if self.doubt is not None and not ended:
            felt = felt_rows(touch)
            age = (len(touch.samples) - int(felt[0])) / touch.rate if len(felt) else 0.0
            doubt = float(np.interp(age, AGES, self.doubt))
            doubted = (1.0 - doubt) * share + doubt / len(share)
        if trust < 1.0:
            doubted = trust * doubted + (1.0 - trust) / len(share)
        best = int(np.argmax(doubted))
        known = doubted[best] >= getattr(self.estimator, "reject_", 0.0)
        names = self._names(touch, share, None if ended else doubted)
        return Prediction(self.labels[best] if known else UNKNOWN, float(doubted[best]), names)

    def _names(
        self, touch: Touch, share: FloatArray, doubted: FloatArray | None
    ) -> tuple[str, ...] | None:
        """The names promised for a touch of these probabilities; of doubted ones while it goes on.

        Thresholds are of whole touches. While a touch goes on its names are at least so many that
        their doubted probabilities sum to the coverage.
        """
        if self.sets is None or self.coverage is None:
            return None
        limit = self.sets.threshold(self.coverage, touch.skin.fingerprint, touch.person)
        names = self.sets.names(share, self.labels, self.strangeness(touch), limit)
        if doubted is None:
            return names
        return max(names, enough_names(doubted, self.labels, self.coverage), key=len)

    def no_contact(self, skin: PreparedSkin, person: str = "") -> Prediction:
        """What is predicted where nothing is felt on a skin, of a person by name.

        Touches that were not felt count among those that sets are promised by, so `no_contact` is
        alone in its set unless no promise can be kept.
        """
        if self.sets is None or self.coverage is None:
            return Prediction(NO_CONTACT, 1.0)
        every = np.isinf(self.sets.threshold(self.coverage, skin.fingerprint, person))
        return Prediction(NO_CONTACT, 1.0, (NO_CONTACT, *(self.labels if every else ())))

    def strangeness(self, touch: Touch) -> float:
        """How far a touch is from all that was learnt; 0 where the estimator cannot tell."""
        rows = self.descriptor.describe(touch)
        if len(rows) == 0 or not hasattr(self.estimator, "strangeness"):
            return 0.0
        return float(self.estimator.strangeness(rows).mean())

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        trained = hasattr(self.estimator, "classes_")
        return {
            "name": self.name,
            "labels": listed(self.labels) if trained else "not trained",
            "trained_on": listed(one.part for one in self.trained_on),
        }


TouchClassifier = Classifier


def _check_labels(labels: NDArray[np.str_], least: int) -> None:
    """Refuse fewer than two labels, or fewer than `least` touches of one."""
    kinds, count = np.unique(labels, return_counts=True)
    if len(kinds) < 2 or count.min() < least:
        have = ", ".join(f"{n} {kind}" for kind, n in zip(kinds, count, strict=True))
        raise InvalidArrayError(
            f"training needs two labels or more, and of each {least} touches in contact; got: "
            f"{have or 'none'}"
        )


def calibrated(estimator: Any) -> Any:
    """Probabilities by Platt's sigmoid on held-out folds, one final model on all the data."""
    from sklearn.calibration import CalibratedClassifierCV

    return CalibratedClassifierCV(estimator, method="sigmoid", cv=CALIBRATION_FOLDS, ensemble=False)


def quick_probabilities(estimator: Any) -> Probabilities:
    """A function that gives what `estimator.predict_proba` gives for sound rows (n, d).

    Checking a row costs scikit-learn more than a small classifier does. Estimators may offer
    `probabilities` themselves; calibrated intersection SVMs are evaluated from their arrays;
    for all others it is `predict_proba`.
    """
    if hasattr(estimator, "probabilities"):
        return estimator.probabilities
    inner = getattr(estimator, "calibrated_classifiers_", [])
    if len(inner) == 1 and isinstance(inner[0].estimator, IntersectionSVC):
        curves = inner[0].calibrators
        if all(hasattr(curve, "a_") and hasattr(curve, "b_") for curve in curves):
            slope, offset = np.array([(float(c.a_), float(c.b_)) for c in curves]).T
            return _Platt(inner[0].estimator, slope, offset)
    return estimator.predict_proba


class _Platt:
    """Decision values through one sigmoid a class, as scikit-learn's calibration does it."""

    def __init__(self, svc: IntersectionSVC, slope: FloatArray, offset: FloatArray) -> None:
        self.svc, self.slope, self.offset = svc, slope, offset

    def __call__(self, rows: FloatArray) -> FloatArray:
        """(n, classes) probabilities of rows (n, d)."""
        values, classes = self.svc.decision_values(rows), len(self.svc.classes_)
        if classes > 2:
            values = one_vs_rest(values, classes)
        # tanh instead of exp: it cannot overflow.
        share = 0.5 - 0.5 * np.tanh(0.5 * (self.slope * values + self.offset))
        if classes == 2:
            return np.concatenate([1.0 - share, share], axis=1)
        total = share.sum(axis=1, keepdims=True)
        even = np.full_like(share, 1.0 / classes)
        return np.divide(share, total, out=even, where=total > 0)


class GivenName(Classifier):
    """Calls every touch by one name.

    Parameters
    ----------
    label : str
    """

    def __init__(self, label: str) -> None:
        named = SimpleNamespace(classes_=np.array([label]))
        super().__init__("given name", ContactGeometry(), named)

    def difference(self, skin: Skin, people: Sequence[str] = ()) -> SkinDifference:
        """None: there is nothing that it learnt."""
        return SkinDifference("", True)

    @property
    def answers(self) -> None:
        """None: nothing is judged."""
        return

    def probabilities(self, touch: Touch) -> FloatArray | None:
        """(1,) certainty; None without contact."""
        return np.ones(1) if (pool_event(touch.samples) > ACTIVE).any() else None
