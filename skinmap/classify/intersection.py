"""Support vector machine with the histogram intersection kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.svm import SVC
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError

CHUNK = 2**22  # numbers at a time while a kernel is computed


def intersection_kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) sums of the smaller of each two bins, for histograms (n, d) and (m, d).

    Swain and Ballard, "Color Indexing", International Journal of Computer Vision 7(1), 1991.
    """
    kernel = np.empty((len(a), len(b)))
    step = max(1, CHUNK // max(1, b.size))
    for start in range(0, len(a), step):
        block = a[start : start + step]
        kernel[start : start + step] = np.minimum(block[:, None], b[None]).sum(axis=2)
    return kernel


class IntersectionSVC(ClassifierMixin, BaseEstimator):
    """SVM on histograms (n, d) of non-negative counts.

    Parameters
    ----------
    C : float
        Penalty, as in scikit-learn's SVC. The kernel is divided by its mean on the training
        histograms, so that C means the same for few and for many votes.
    """

    def __init__(self, C: float = 10.0) -> None:
        self.C = C

    def fit(self, X: ArrayLike, y: ArrayLike) -> IntersectionSVC:
        """Train on the Gram matrix of histograms (n, d) with labels (n,)."""
        histograms, labels = validate_data(self, X, y)
        self._refuse_negative(histograms)
        gram = intersection_kernel(histograms, histograms)
        self.scale_ = float(np.diag(gram).mean()) or 1.0
        self.svc_ = SVC(kernel="precomputed", C=self.C).fit(gram / self.scale_, labels)
        self.support_histograms_ = histograms[self.svc_.support_]
        self.n_train_ = len(histograms)
        self.classes_ = self.svc_.classes_
        return self

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """(n,) or (n, classes) decision values of histograms (n, d)."""
        check_is_fitted(self)
        return np.asarray(self.svc_.decision_function(self._kernel(X)))

    def predict(self, X: ArrayLike) -> Any:
        """(n,) labels of histograms (n, d)."""
        check_is_fitted(self)
        return self.svc_.predict(self._kernel(X))

    def _kernel(self, X: ArrayLike) -> FloatArray:
        """Kernel against all training histograms; only the support columns are ever read."""
        histograms = validate_data(self, X, reset=False)
        self._refuse_negative(histograms)
        kernel = np.zeros((len(histograms), self.n_train_))
        support = intersection_kernel(histograms, self.support_histograms_)
        kernel[:, self.svc_.support_] = support / self.scale_
        return kernel

    @staticmethod
    def _refuse_negative(X: FloatArray) -> None:
        if X.size and X.min() < 0:
            # The kernel is indefinite there, and the SVM would not notice.
            raise InvalidArrayError(f"Negative values in data: histograms count votes, {X.min()}")

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        return tags
