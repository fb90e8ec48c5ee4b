"""The contract of classifiers of touches, as a test that any plug-in can run on itself.

`check_classifier(make)` trains what `make()` gives on twenty planted touches (small and large
ones on a lattice of 120 taxels) and checks that

1. `make` is callable and gives something new each time: a `TouchClassifier`, or something
   with `fit`, `predict` and a known `input_kind`, that scikit-learn can `clone`;
2. before training it refuses to name anything;
3. `fit` gives back the classifier itself, leaves its input alone and sets `classes_`;
4. `predict` gives one trained label a row, the same ones when asked again and row by row;
5. `predict_proba`, where there is one, gives a row of probabilities, one for each of `classes_`,
   that sum to one and are largest where the label is;
6. it learns: at least three quarters of other planted touches get their right name;
7. untouched skin is named `no_contact`;
8. a model file gives back a classifier with the same probabilities.

An entry point of the group `skinmap.classifiers` gives a class or a function without arguments.
What that makes is a `TouchClassifier`, or anything with scikit-learn's `fit` and `predict` and
an attribute `input_kind`: "raw", "histogram", "image", "contact-geometry" or
"contact-motion".
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin, clone

from skinmap.arrays import FloatArray
from skinmap.errors import BrokenPluginError, InvalidArrayError, SkinError
from skinmap.recognition.classifier import NO_CONTACT, TouchClassifier, calibrated
from skinmap.recognition.descriptors import INPUT_KINDS, Touch, descriptor_of
from skinmap.recognition.model_file import read_model, save_classifier
from skinmap.skin.skin import skin_from_points
from skinmap.touch.prepared_skin import PreparedSkin

PITCH = 5e-3  # [m]
RADII = {"small": 6e-3, "large": 18e-3}  # of the planted touches [m]
PLACES = (27, 32, 87, 92)  # few, so that bare taxel values suffice too
LEARNT = 0.75


class LabelsOnly(ClassifierMixin, BaseEstimator):
    """Probabilities of a classifier that gives labels only: one for the label, none for others.

    The confidence of a touch is then the share of its rows that agree.
    """

    def __init__(self, estimator: Any) -> None:
        self.estimator = estimator

    def fit(self, X: ArrayLike, y: ArrayLike) -> LabelsOnly:
        """Train a copy of the classifier."""
        self.classes_ = np.unique(np.asarray(y))
        self.estimator_ = clone(self.estimator, safe=False)
        self.estimator_.fit(X, y)
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """(n,) labels."""
        return np.asarray(self.estimator_.predict(X))

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """(n, classes) of 0 and 1."""
        return (self.predict(X)[:, None] == self.classes_).astype(np.float64)


def plugged_in(name: str, thing: object) -> Callable[[], TouchClassifier]:
    """A function that makes a touch classifier of what a plug-in's entry point gave."""

    def make() -> TouchClassifier:
        if not callable(thing):
            raise InvalidArrayError(
                f"the plug-in {name!r} must be a class or a function, got {type(thing).__name__}"
            )
        return touch_classifier(name, thing())

    return make


def touch_classifier(name: str, made: Any) -> TouchClassifier:
    """A touch classifier of what a plug-in made.

    Raises
    ------
    InvalidArrayError
        No `fit` and `predict`, or no `input_kind`.
    UnknownNameError
        An input kind that there is not.
    """
    if isinstance(made, TouchClassifier):
        made.name = name
        return made
    for method in ("fit", "predict"):
        if not callable(getattr(made, method, None)):
            raise InvalidArrayError(f"the plug-in {name!r} has no method {method!r}")
    kind = getattr(made, "input_kind", None)
    if kind is None:
        raise InvalidArrayError(
            f"the plug-in {name!r} names no input_kind; the input kinds are: "
            f"{', '.join(INPUT_KINDS)}"
        )
    found = TouchClassifier(name, descriptor_of(kind), with_probabilities(made))
    found.check = check_outputs
    return found


def check_outputs(name: str, estimator: Any, x: FloatArray, y: NDArray[Any]) -> None:
    """Check what the trained estimator of a plug-in gives for some rows (n, d) of labels (n,).

    Raises
    ------
    BrokenPluginError
        Which promise is broken, and by which plug-in.
    """
    try:
        labels = np.asarray(estimator.predict(x))
        _check_answers(labels, x, y)
        classes = np.asarray(estimator.classes_)
        # Overlapping touches of a user may have a label that is not the most probable one.
        _check_probabilities(np.asarray(estimator.predict_proba(x)), labels, classes, agree=False)
    except Exception as error:
        text = str(error) if isinstance(error, BrokenPluginError) else f"fails: {error!r}"
        raise BrokenPluginError(f"the plug-in {name!r} {text}") from error


def with_probabilities(estimator: Any) -> Any:
    """The estimator itself, calibrated, or with its labels as probabilities."""
    if hasattr(estimator, "predict_proba"):
        return estimator
    if hasattr(estimator, "decision_function"):
        return calibrated(estimator)
    return LabelsOnly(estimator)


def check_classifier(make: Callable[[], Any], *, seed: int = 0) -> None:
    """Check what the module's description lists; nothing happens where all of it holds.

    Parameters
    ----------
    make : callable
        What the plug-in's entry point names: a class or a function without arguments.
    seed : int
        Of the planted touches.

    Raises
    ------
    BrokenPluginError
        Which promise is broken, and how.

    Examples
    --------
    >>> from skinmap.recognition import classifiers
    >>> check_classifier(classifiers.get("contact-geometry"))
    """
    rng = np.random.default_rng(seed)
    touches, others = planted_touches(10, rng=rng), planted_touches(8, rng=rng)
    others = [replace(one, skin=touches[0].skin) for one in others]
    made = _make(make)
    if not isinstance(made, TouchClassifier):
        _check_estimator(made, touches)
    model = touch_classifier("checked", _make(make))
    _refuses(lambda: model.predict(touches[0]), "names a touch before it is trained")
    try:
        model.fit(touches, rng=rng)
        right = [model.predict(touch).label == touch.label for touch in others]
        quiet = model.predict(replace(touches[0], samples=np.zeros_like(touches[0].samples)))
    except Exception as error:
        raise BrokenPluginError(f"fails on touches: {error!r}") from error
    _require(quiet.label == NO_CONTACT, f"untouched skin is named {quiet.label!r}")
    share = float(np.mean(right))
    _require(share >= LEARNT, f"names {share:.0%} of planted touches right, expected {LEARNT:.0%}")
    _check_model_file(model, lambda: touch_classifier("checked", make()), others)


def planted_touches(per_label: int, *, rng: np.random.Generator) -> list[Touch]:
    """Touches of two sizes at four places of a flat lattice of 120 taxels, 6 samples each."""
    row, column = np.divmod(np.arange(120), 12)
    across = column + 0.5 * (row % 2)
    flat = PITCH * np.column_stack([across, row * np.sqrt(0.75), np.zeros(120)])
    skin = PreparedSkin(skin_from_points(flat, np.tile([0.0, 0.0, 1.0], (120, 1)), part="planted"))
    touches = []
    for label, radius in RADII.items():
        for _ in range(per_label):
            gap = np.linalg.norm(flat - flat[rng.choice(PLACES)], axis=1)
            press = rng.uniform(120, 220) * np.exp(-0.5 * (gap / (0.5 * radius)) ** 2)
            samples = press * np.linspace(0.6, 1.0, 6)[:, None] + rng.normal(0.0, 1.0, (6, 120))
            counts = np.clip(samples, 0, 255).astype(np.uint8)
            touches.append(Touch(skin, counts, label, rate=50.0))
    return touches


def _make(make: Callable[[], Any]) -> Any:
    _require(callable(make), f"must be a class or a function, got {type(make).__name__}")
    try:
        one, other = make(), make()
        touch_classifier("checked", one)
    except SkinError as error:
        raise BrokenPluginError(str(error)) from error
    except Exception as error:
        raise BrokenPluginError(f"cannot be made without arguments: {error!r}") from error
    _require(one is not other, "gives the same object twice: training one would train all")
    return one


def _check_estimator(made: Any, touches: Sequence[Touch]) -> None:
    """Promises 2 to 5, on the rows of its input kind."""
    descriptor = descriptor_of(made.input_kind)
    descriptor.fit(touches, rng=np.random.default_rng(0))
    rows = [descriptor.describe(touch) for touch in touches]
    x = np.concatenate(rows)
    y = np.repeat([touch.label for touch in touches], [len(row) for row in rows])
    _refuses(lambda: made.predict(x), "predicts before it is trained")
    x_before, y_before = x.copy(), y.copy()
    try:
        made = clone(made)
        fitted = made.fit(x, y)
        labels = np.asarray(made.predict(x))
        again = np.asarray(made.predict(x))
        single = np.concatenate([np.asarray(made.predict(row[None])) for row in x[:5]])
    except Exception as error:
        raise BrokenPluginError(f"fails on rows of kind {made.input_kind!r}: {error!r}") from error
    _require(fitted is made, "fit must give back the classifier itself")
    _require(bool((x == x_before).all() and (y == y_before).all()), "fit changes its input")
    _require(hasattr(made, "classes_"), "fit sets no classes_")
    classes = np.asarray(made.classes_)
    _require(np.array_equal(np.unique(classes), np.unique(y)), f"classes_ are {classes}")
    _check_answers(labels, x, y)
    _require(np.array_equal(labels, again), "predicts other labels when it is asked again")
    _require(np.array_equal(labels[:5], single), "predicts other labels row by row")
    if hasattr(made, "predict_proba"):
        _check_probabilities(np.asarray(made.predict_proba(x)), labels, classes)


def _check_answers(labels: NDArray[Any], x: FloatArray, y: NDArray[Any]) -> None:
    _require(labels.shape == (len(x),), f"predicts {labels.shape} labels for {len(x)} rows")
    _require(bool(np.isin(labels, y).all()), "predicts a label that it was not trained on")


def _check_probabilities(
    share: FloatArray, labels: Any, classes: Any, *, agree: bool = True
) -> None:
    wanted = (len(labels), len(classes))
    _require(share.shape == wanted, f"predict_proba gives {share.shape}, expected {wanted}")
    fine = np.isfinite(share).all() and (share >= 0).all()
    _require(bool(fine), "predict_proba does not give probabilities")
    # 1e-6: probabilities may have been computed in float32.
    _require(bool((np.abs(share.sum(axis=1) - 1.0) < 1e-6).all()), "probabilities must sum to 1")
    # The columns in the order of classes_, which need not be that of the alphabet.
    column = {label: k for k, label in enumerate(classes.tolist())}
    own = share[np.arange(len(labels)), [column[label] for label in labels.tolist()]]
    right = float(np.mean(own >= share.max(axis=1) - 1e-6))
    # Calibrated pairs of classes may turn a close decision: one in ten of clear touches.
    least = 0.9 if agree else 1.0 / len(classes)
    _require(right >= least, "predict_proba is not largest where the label is")


def _check_model_file(
    model: TouchClassifier, make: Callable[[], TouchClassifier], touches: Sequence[Touch]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checked.skinmodel"
        try:
            save_classifier(model, path)
            back = read_model(path, lambda _name: make)
            pairs = [(model.probabilities(one), back.probabilities(one)) for one in touches]
        except Exception as error:
            raise BrokenPluginError(f"does not come back from a model file: {error}") from error
    same = all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in pairs)
    _require(same, "gives other probabilities once it comes back from a model file")


def _refuses(call: Callable[[], object], promise: str) -> None:
    try:
        call()
    except Exception:  # noqa: BLE001 - which one is the plug-in's own choice
        return
    raise BrokenPluginError(promise)


def _require(holds: bool, broken: str) -> None:
    if not holds:
        raise BrokenPluginError(broken)
