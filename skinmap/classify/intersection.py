"""Support vector machine with the histogram intersection kernel."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, hstack
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray
from skinmap.classify.additive import AdditiveFunction, intersection_function
from skinmap.errors import InvalidArrayError, SkinWarning

GRAM_LIMIT = 10_000  # training histograms up to which the Gram matrix is made (800 MB)
LEVELS = 64  # steps a bin at most


class UnaryCode(TransformerMixin, BaseEstimator):
    """Each bin cut into steps, and how far each step is filled.

    Counts up to `levels` are cut at every whole number, and the products of their codes are the
    intersection kernel itself; else the steps end at quantiles of the training values, and
    only values within one step are told apart less sharply.

    Maji and Berg, "Max-Margin Additive Classifiers for Detection", ICCV 2009.
    """

    def __init__(self, levels: int = LEVELS) -> None:
        self.levels = levels

    def fit(self, X: FloatArray, y: ArrayLike | None = None) -> UnaryCode:
        """Choose the steps of each bin of histograms (n, d)."""
        ends = []
        for values in X.T:
            seen = np.unique(values[values > 0])
            if len(seen) and seen[-1] <= self.levels and (seen == np.floor(seen)).all():
                seen = np.arange(1.0, seen[-1] + 1.0)
            elif len(seen) > self.levels:
                share = np.linspace(0.0, 1.0, self.levels)
                seen = np.unique(np.quantile(seen, share, method="nearest"))
            ends.append(seen)
        self.ends_ = np.concatenate(ends)
        self.start_ = np.concatenate([[0], np.cumsum([len(end) for end in ends])])
        return self

    def transform(self, X: FloatArray) -> csr_array:
        """(n, steps) code of histograms (n, d)."""
        blocks = []
        for place, values in enumerate(X.T):
            end = self.ends_[self.start_[place] : self.start_[place + 1]]
            begin = np.concatenate([[0.0], end[:-1]])[: len(end)]
            filled = np.clip(values[:, None] - begin, 0.0, end - begin)
            blocks.append(csr_array(filled / np.sqrt(end - begin)))
        return csr_array(hstack(blocks, format="csr"))

    def function(self, weights: FloatArray, intercept: FloatArray) -> AdditiveFunction:
        """The function x -> weights (q, steps) @ code(x) + intercept (q,)."""
        bends, slopes = [], []
        for first, last in zip(self.start_[:-1], self.start_[1:], strict=True):
            end = self.ends_[first:last]
            width = np.diff(end, prepend=0.0)
            bends.append(end)
            slopes.append((weights[:, first:last] / np.sqrt(width)).T)
        return AdditiveFunction(bends, slopes, intercept)


def intersection_kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) sums of the smaller of each two bins, for histograms (n, d) and (m, d).

    Swain and Ballard, "Color Indexing", International Journal of Computer Vision 7(1), 1991.
    """
    from scipy.spatial.distance import cdist

    # min(x, y) = (x + y - |x - y|) / 2: one compiled pass without a table of all bins, exact for
    # counts, as their sums are whole numbers far below 2^53.
    sums = a.sum(axis=1)[:, None] + b.sum(axis=1)[None]
    return np.asarray(0.5 * (sums - cdist(a, b, "cityblock")))


class IntersectionSVC(ClassifierMixin, BaseEstimator):
    """SVM on histograms (n, d) of non-negative counts.

    It is trained on the Gram matrix by scikit-learn's SVC and evaluated exactly, bin by bin
    (`AdditiveFunction`). Above `gram_limit` histograms a linear SVM is trained on a code whose
    products are the kernel (`UnaryCode`); a `SkinWarning` says so.

    Parameters
    ----------
    C : float
        Penalty, as in scikit-learn's SVC. The kernel is divided by its mean on the training
        histograms, so that C means the same for few and for many votes.
    gram_limit : int
        Training histograms up to which the Gram matrix is made.
    """

    def __init__(self, C: float = 10.0, gram_limit: int = GRAM_LIMIT) -> None:
        self.C, self.gram_limit = C, gram_limit

    def fit(self, X: ArrayLike, y: ArrayLike) -> IntersectionSVC:
        """Train on histograms (n, d) with labels (n,).

        Raises
        ------
        InvalidArrayError
            Negative counts: the kernel is indefinite there, and the SVM would not notice.
        """
        histograms, labels = validate_data(self, X, y, dtype=np.float64)
        _refuse_negative(histograms)
        self.scale_ = float(histograms.sum(axis=1).mean()) or 1.0
        self.one_vs_one_ = len(histograms) <= self.gram_limit
        if self.one_vs_one_:
            self._fit_gram(histograms, labels)
        else:
            warnings.warn(
                f"{len(histograms)} histograms are more than {self.gram_limit}: trained on a "
                "feature map of the kernel, one class against the rest, not on its Gram matrix",
                SkinWarning,
                stacklevel=2,
            )
            self._fit_linear(histograms, labels)
        self.function_ = self._make_function()
        return self

    def _fit_gram(self, histograms: FloatArray, labels: NDArray[Any]) -> None:
        from sklearn.svm import SVC  # takes 0.2 s to import, and only training needs it

        gram = intersection_kernel(histograms, histograms)
        svc = SVC(kernel="precomputed", C=self.C).fit(gram / self.scale_, labels)
        self.classes_ = svc.classes_
        self.support_histograms_ = histograms[svc.support_]
        self.coefficients_ = _pair_coefficients(svc) / self.scale_
        self.intercept_ = np.asarray(svc.intercept_)

    def _fit_linear(self, histograms: FloatArray, labels: NDArray[Any]) -> None:
        from sklearn.svm import LinearSVC

        self.code_ = UnaryCode().fit(histograms)
        features = self.code_.transform(histograms) / np.sqrt(self.scale_)
        linear = LinearSVC(C=self.C, loss="hinge", random_state=0, max_iter=20_000, tol=1e-3)
        linear.fit(features, labels)
        self.classes_ = linear.classes_
        self.coefficients_ = linear.coef_ / np.sqrt(self.scale_)
        self.intercept_ = np.asarray(linear.intercept_)

    def _make_function(self) -> AdditiveFunction:
        """What the decision values are evaluated with."""
        if self.one_vs_one_:
            parts = (self.support_histograms_, self.coefficients_, self.intercept_)
            return intersection_function(*parts)
        return self.code_.function(self.coefficients_, self.intercept_)

    def decision_values(self, X: FloatArray) -> FloatArray:
        """(n, q) of each pair of classes, or of each class above `gram_limit`; not checked."""
        return self.function_(X)

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """(n,) or (n, classes) decision values of histograms (n, d), as of scikit-learn's SVC."""
        values = self._checked(X)
        if len(self.classes_) == 2:
            return np.asarray(values[:, 0])
        return one_vs_rest(values, len(self.classes_)) if self.one_vs_one_ else values

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """(n,) labels of histograms (n, d)."""
        values = self._checked(X)
        if len(self.classes_) == 2:
            return np.asarray(self.classes_[(values[:, 0] > 0).astype(np.int64)])
        if self.one_vs_one_:
            first, second = _pairs(len(self.classes_))
            values = (values > 0) @ first + (values <= 0) @ second  # as libsvm counts its votes
        return np.asarray(self.classes_[values.argmax(axis=1)])

    def _checked(self, X: ArrayLike) -> FloatArray:
        check_is_fitted(self)
        histograms = validate_data(self, X, dtype=np.float64, reset=False)
        _refuse_negative(histograms)
        return self.decision_values(histograms)

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be made again."""
        state = dict(super().__getstate__())
        state.pop("function_", None)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make it again."""
        super().__setstate__(state)
        if hasattr(self, "classes_"):
            self.function_ = self._make_function()

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        return tags


def one_vs_rest(values: FloatArray, classes: int) -> FloatArray:
    """(n, classes) votes of the pairs (n, q), ties broken by their values: as SVC does it."""
    first, second = _pairs(classes)
    votes = (values >= 0) @ first + (values < 0) @ second
    sure = values @ (first - second)
    return np.asarray(votes + sure / (3.0 * (np.abs(sure) + 1.0)))


def _pairs(classes: int) -> tuple[FloatArray, FloatArray]:
    """(q, classes) which class is first and which second in each pair."""
    one, other = np.triu_indices(classes, 1)
    return np.eye(classes)[one], np.eye(classes)[other]


def _pair_coefficients(svc: Any) -> FloatArray:
    """(q, m) coefficient of each support vector in the decision of each pair of classes."""
    dual, count = svc.dual_coef_, svc.n_support_
    if len(svc.classes_) == 2:
        return np.asarray(dual)
    owner = np.repeat(np.arange(len(count)), count)
    one, other = np.triu_indices(len(count), 1)
    # Row j - 1 of the coefficients of class i < j is for the pair (i, j), and row i of j's.
    first = np.where(owner == one[:, None], dual[other - 1], 0.0)
    return np.asarray(first + np.where(owner == other[:, None], dual[one], 0.0))


def _refuse_negative(histograms: FloatArray) -> None:
    if histograms.size and histograms.min() < 0:
        raise InvalidArrayError(
            f"Negative values in data: histograms count votes, got {histograms.min()}"
        )
