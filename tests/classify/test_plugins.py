"""Plug-ins: the documented example installed and run, and what the contract test finds broken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.dummy import DummyClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier

from skinmap.errors import BrokenPluginError, InvalidArrayError, UnknownNameError
from skinmap.recognition import check_classifier
from skinmap.recognition.check import LabelsOnly, planted_touches, touch_classifier
from skinmap.recognition.classifier import TouchClassifier, calibrated, classifiers

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "plugins"
RUN = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
from skinmap.recognition import check_classifier
from skinmap.recognition.check import planted_touches
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.model_file import load_classifier, save_classifier
from pathlib import Path
from nearest_touch import NearestTouch

check_classifier(NearestTouch)
assert "nearest-touch" in classifiers.names()
touches = planted_touches(8, rng=np.random.default_rng(0))
model = classifiers.get("nearest-touch")().fit(touches, rng=np.random.default_rng(0))
path = Path(sys.argv[1]) / "m.skinmodel"
save_classifier(model, path)
back = load_classifier(path)
right = [back.predict(touch).label == touch.label for touch in touches]
print(back.name, sum(right), len(right))
"""


def test_the_example_of_the_documents_is_installed_and_named_touches(tmp_path):
    source = tmp_path / "plugin"  # a copy: building leaves folders beside the source
    source.mkdir()
    for file in EXAMPLE.iterdir():
        if file.is_file():
            (source / file.name).write_text(file.read_text())
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    target = tmp_path / "installed"
    command += ["--no-build-isolation", "--target", str(target), str(source)]
    if subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True).returncode:
        pytest.skip("no pip in this environment to install the example with")
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    run = [sys.executable, "-c", RUN, str(target)]
    result = subprocess.run(run, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    name, right, touches = result.stdout.split()
    assert name == "nearest-touch"
    assert int(right) >= 0.9 * int(touches)  # the touches that it was trained on


def test_the_example_is_short():
    lines = (EXAMPLE / "nearest_touch.py").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) <= 20


class Nearest(KNeighborsClassifier):
    """A working plug-in, and what the broken ones below spoil."""

    input_kind = "contact-geometry"


class Bayes(GaussianNB):
    def __init__(self, priors=None, var_smoothing=1e-2):
        super().__init__(priors=priors, var_smoothing=var_smoothing)


class RawBayes(Bayes):
    input_kind = "raw"


class HistogramBayes(Bayes):
    input_kind = "histogram"


class ImageBayes(Bayes):
    input_kind = "image"


class GeometryBayes(Bayes):
    input_kind = "contact-geometry"


class Backwards(ClassifierMixin, BaseEstimator):
    """Its classes_ are not in the order of the alphabet; an IndexError in the old check."""

    input_kind = "contact-geometry"

    def fit(self, X, y):
        self.classes_ = np.unique(y)[::-1]
        self.centres_ = np.array([np.log1p(X[y == name]).mean(axis=0) for name in self.classes_])
        return self

    def predict_proba(self, X):
        near = np.exp(-((np.log1p(X)[:, None] - self.centres_) ** 2).mean(axis=-1))
        return near / near.sum(axis=1, keepdims=True)

    def predict(self, X):
        return self.classes_[self.predict_proba(X).argmax(axis=1)]


@pytest.mark.parametrize("make", [RawBayes, HistogramBayes, ImageBayes, GeometryBayes, Backwards])
def test_check_classifier_accepts_every_input_kind(make):
    check_classifier(make)


@pytest.mark.parametrize("name", ["contact-geometry", "histogram", "paper"])
def test_check_classifier_accepts_what_we_ship(name):
    check_classifier(classifiers.get(name))


class NoKind(KNeighborsClassifier):
    pass


class UnknownKind(KNeighborsClassifier):
    input_kind = "smell"


class NoPredict(BaseEstimator):
    input_kind = "raw"

    def fit(self, X, y):
        return self


class NeedsArguments(Nearest):
    def __init__(self, must):
        super().__init__()


class SpoilsInput(Nearest):
    def fit(self, X, y):
        X *= 2.0
        return super().fit(X, y)


class FitGivesNothing(Nearest):
    def fit(self, X, y):
        super().fit(X, y)


class ForeignLabels(Nearest):
    def predict(self, X):
        return np.full(len(X), "elbow")


class OneLabelForAll(Nearest):
    def predict(self, X):
        return super().predict(X)[:1]


class Moody(Nearest):
    def predict(self, X):
        labels = super().predict(X)
        self.turn = not getattr(self, "turn", False)
        return labels[::-1] if self.turn else labels


class BatchWise(Nearest):
    def predict(self, X):
        labels = super().predict(X)
        return labels if len(X) > 1 else self.classes_[[int(labels[0] == self.classes_[0])]]


class NotProbabilities(Nearest):
    def predict_proba(self, X):
        return 2.0 * super().predict_proba(X)


class NanProbabilities(Nearest):
    def predict_proba(self, X):
        return super().predict_proba(X) * np.nan


class WrongOrder(GeometryBayes):
    def predict_proba(self, X):
        return super().predict_proba(X)[:, ::-1]


class NoClasses(ClassifierMixin, BaseEstimator):
    input_kind = "contact-geometry"

    def fit(self, X, y):
        self.only_ = y[0]
        return self

    def predict(self, X):
        return np.full(len(X), self.only_)


class NeverTrained(Nearest):
    def predict(self, X):
        return np.full(len(X), "small")


class Guesses(DummyClassifier):
    input_kind = "contact-geometry"


ONE = Nearest()
BROKEN = {
    "names no input_kind; the input kinds are: raw, histogram": NoKind,
    "no input kind 'smell'; the input kinds are: raw, histogram, image, ": UnknownKind,
    "has no method 'predict'": NoPredict,
    "cannot be made without arguments": NeedsArguments,
    "must be a class or a function, got KNeighbors": KNeighborsClassifier(),
    "gives the same object twice": lambda: ONE,
    "fit changes its input": SpoilsInput,
    "fit must give back the classifier itself": FitGivesNothing,
    "predicts a label that it was not trained on|before it is trained": ForeignLabels,
    r"predicts \(1,\) labels for": OneLabelForAll,
    "predicts other labels when it is asked again": Moody,
    "other labels row by row": BatchWise,
    "probabilities must sum to 1": NotProbabilities,
    "does not give probabilities": NanProbabilities,
    "not largest where the label is": WrongOrder,
    "fit sets no classes_": NoClasses,
    "predicts before it is trained": NeverTrained,
    "of planted touches right, expected 75%": Guesses,
}


@pytest.mark.parametrize(("message", "broken"), BROKEN.items(), ids=[*BROKEN])
def test_check_classifier_finds_what_is_broken(message, broken):
    with pytest.raises(BrokenPluginError, match=message):
        check_classifier(broken)


def test_check_classifier_finds_touch_classifiers_that_do_not_come_back(tmp_path):
    class Local(Nearest):  # cannot be found again by its name
        pass

    with pytest.raises(BrokenPluginError, match="does not come back from a model file"):
        check_classifier(Local)


class Throws(Nearest):
    def predict_proba(self, X):
        raise RuntimeError("no camera")


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (WrongOrder, "'mine' predict_proba is not largest where the label is"),
        (NanProbabilities, "'mine' predict_proba does not give probabilities"),
        (ForeignLabels, "'mine' predicts a label that it was not trained on"),
        (Throws, r"'mine' fails: RuntimeError\('no camera'\)"),
    ],
)
def test_training_refuses_plug_ins_whose_answers_cannot_be(rng, made, message):
    with pytest.raises(BrokenPluginError, match=message):
        touch_classifier("mine", made()).fit(planted_touches(8, rng=rng), rng=rng)


def test_labels_only_shares_the_confidence_among_rows(rng):
    class Plain(BaseEstimator):
        def fit(self, X, y):
            self.split_ = X[:, 0].mean()
            return self

        def predict(self, X):
            return np.where(X[:, 0] > self.split_, "b", "a")

    x = rng.random((20, 2))
    y = np.where(x[:, 0] > x[:, 0].mean(), "b", "a")
    model = LabelsOnly(Plain()).fit(x, y)
    np.testing.assert_array_equal(model.predict_proba(x)[:, 1] == 1.0, y == "b")


def test_touch_classifier_takes_touch_classifiers_as_they_are():
    own = classifiers.get("contact-geometry")()
    assert touch_classifier("mine", own) is own
    assert own.name == "mine"


def test_calibrated_plug_ins_have_probabilities(rng):
    from sklearn.svm import LinearSVC

    machine = LinearSVC(dual=False)
    machine.input_kind = "contact-geometry"
    model = touch_classifier("linear", machine)
    assert type(model.estimator) is type(calibrated(machine))
    touches = planted_touches(8, rng=rng)
    assert isinstance(model.fit(touches, rng=rng), TouchClassifier)
    assert model.probabilities(touches[0]).sum() == pytest.approx(1.0)


def test_plug_ins_are_refused_with_a_reason():
    with pytest.raises(InvalidArrayError, match="the plug-in 'x' has no method 'fit'"):
        touch_classifier("x", object())
    with pytest.raises(UnknownNameError, match="no input kind 'smell'"):
        touch_classifier("x", UnknownKind())
