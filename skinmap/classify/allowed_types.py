"""Which types a model file may hold: scikit-learn's, ours, and those of the plug-in it names."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable
from typing import Any

# Beside the types that skops trusts by itself; none of them can be told to call anything.
KNOWN = frozenset(
    {
        "sklearn.calibration._CalibratedClassifier",
        "sklearn.calibration._SigmoidCalibration",
        "sklearn.calibration._TemperatureScaling",
        # a grid search brings its folds and its table of results
        "sklearn.metrics._scorer._PassthroughScorer",
        "sklearn.model_selection._split.StratifiedKFold",
        "numpy.ma.MaskedArray",
        "scipy.sparse._csr.csr_array",
    }
)


def foreign_types(found: Iterable[str], estimator: Any) -> list[str]:
    """Types of a file that a model has no use for.

    Parameters
    ----------
    found : iterable of str
        Full names of the types that skops does not trust by itself.
    estimator : object
        What the classifier of the file's name is made with: its own types are expected.
    """
    expected = {_name(type(part)) for part in _parts(estimator)}
    return sorted(
        name for name in found if name not in KNOWN | expected and not _our_estimator(name)
    )


def _our_estimator(name: str) -> bool:
    """Whether a name is an estimator of this package; functions and other types are not."""
    from sklearn.base import BaseEstimator

    module, _, attribute = name.rpartition(".")
    if not module.startswith("skinmap.classify."):
        return False
    if module not in sys.modules:
        if importlib.util.find_spec(module) is None:
            return False
        importlib.import_module(module)
    thing = getattr(sys.modules[module], attribute, None)
    return isinstance(thing, type) and issubclass(thing, BaseEstimator)


def _parts(estimator: Any) -> list[Any]:
    """An estimator and those it is made with."""
    if not hasattr(estimator, "get_params"):
        return [estimator]
    inner = estimator.get_params(deep=True).values()
    return [estimator, *(part for part in inner if hasattr(part, "fit"))]


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
