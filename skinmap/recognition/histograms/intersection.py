"""Support vector machine with the histogram intersection kernel.

Sums of one function a bin: what an intersection-kernel SVM is, and how it is evaluated fast.

The decision value of the SVM is a sum over bins of sum_i c_i min(h_i, x), which is piecewise
linear in x with a bend at each support value h_i. Sorted support values with running sums give
it exactly for any x, and for whole counts so does a table of its values at 0, 1, 2 and so on. A
value's piece is looked up in equal buckets and only sought inside the right one.

Maji, Berg and Malik, "Classification using Intersection Kernel Support Vector Machines is
Efficient", CVPR 2008.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, MissingLibraryError
from skinmap.numba_loops import compile_loop

TABLE = 2**23  # numbers in a table at most (64 MB)
COMPILE = 2_000_000  # bins from which compiling pays by itself
BUCKETS = 4  # a bend: most values are found by one look
LINEAR = 8  # bends up to which looking at one after the other is quicker than halving
FEW = 16  # samples whose bins are looked up at once
SAMPLES = 256  # that the compiled loop works on at a time

logger = logging.getLogger(__name__)


class AdditiveFunction:
    """q sums over d bins of piecewise linear functions that are constant in the end.

    Parameters
    ----------
    bends : sequence of (u_d,) array of float
        Where each bin's function bends, rising, all above 0; functions are 0 at 0.
    slopes : sequence of (u_d, q) array of float
        Slope of each sum up to each bend.
    intercept : (q,) array of float
    """

    def __init__(
        self, bends: Sequence[FloatArray], slopes: Sequence[FloatArray], intercept: FloatArray
    ) -> None:
        self.intercept = np.asarray(intercept, np.float64)
        self.top = int(max((bend[-1] for bend in bends if len(bend)), default=0.0))
        # f = base + slope x, before each bend and behind the last: one piece more than bends.
        self.pieces = np.concatenate([_pieces(b, s) for b, s in zip(bends, slopes, strict=True)])
        self.ends = np.concatenate([np.append(bend, np.inf) for bend in bends])  # of the pieces
        self.scale, self.first, self._most = _buckets(bends)
        self.rows = self._tabulate(bends)
        self._offset = np.arange(len(bends)) * (self.top + 1)
        self._kernel: Any = None

    def __call__(self, x: FloatArray) -> FloatArray:
        """(n, q) values for x (n, d), none below 0."""
        if self._kernel is None and x.size >= COMPILE:
            self.compile()
        if self._kernel is not None:
            return np.asarray(self._kernel(x))
        if self.rows is not None and bool((x == np.floor(x)).all()):
            return _look_up(self.rows, self._offset, self.top, x) + self.intercept
        if len(x) < FEW:
            return self._together(x)
        total = np.tile(self.intercept, (len(x), 1))
        for place in range(x.shape[1]):  # the pieces of one bin stay in the fast memory
            row = np.flatnonzero(x[:, place])
            total[row] += self._values(x[row, place], np.int64(place))
        return total

    def compile(self) -> bool:
        """Use compiled code from now on; whether it can be had (numba)."""
        try:
            loop = _compiled(len(self.intercept))
        except MissingLibraryError:
            logger.info("numba is not installed: decision values are computed by numpy")
            return False
        none = np.zeros((0, len(self.intercept)))
        tables = (
            self.scale, self.first, self.ends, self.pieces,
            none if self.rows is None else self.rows, self.top, self.intercept,
        )  # fmt: skip
        self._kernel = lambda x: loop(x, *tables)
        return True

    def _together(self, x: FloatArray) -> FloatArray:
        """(n, q) values for a few x (n, d): all bins that are not empty at once."""
        row, place = np.nonzero(x)
        count = np.bincount(row, minlength=len(x))
        total = np.tile(self.intercept, (len(x), 1))
        if len(row):
            some, start = count > 0, np.cumsum(count) - count
            total[some] += np.add.reduceat(self._values(x[row, place], place), start[some], axis=0)
        return total

    def _values(self, value: FloatArray, place: IntArray | np.int64) -> FloatArray:
        """(k, q) what values (k,) of a bin or of bins (k,) add."""
        piece = self.pieces[self._found(value, place)]
        return np.asarray(piece[:, 0] + piece[:, 1] * value[:, None])

    def _found(self, value: FloatArray, place: IntArray | np.int64) -> IntArray:
        """(k,) the piece that each value (k,) lies on."""
        most = self.first.shape[1] - 3
        bucket = np.minimum(value * self.scale[place], most).astype(np.int64)
        low = self.first[place, bucket].astype(np.int64)
        if self._most > LINEAR:
            high = self.first[place, bucket + 2]
            for _ in range(self._most.bit_length()):
                middle = (low + high) >> 1
                before = (low < high) & (self.ends[middle] < value)
                low, high = np.where(before, middle + 1, low), np.where(before, high, middle)
            return low
        behind = np.flatnonzero(self.ends[low] < value)
        while len(behind):
            low[behind] += 1
            behind = behind[self.ends[low[behind]] < value[behind]]
        return low

    def _tabulate(self, bends: Sequence[FloatArray]) -> FloatArray | None:
        """(d * (top + 1), q) values at 0, 1, ... top where all bends are whole and few enough."""
        d, q = len(bends), len(self.intercept)
        whole = all(bool((bend == np.floor(bend)).all()) for bend in bends)
        if not whole or d * (self.top + 1) * q > TABLE:
            return None
        place, count = np.divmod(np.arange(d * (self.top + 1)), self.top + 1)
        return self._values(count.astype(np.float64), place)


def intersection_function(
    support: FloatArray, coefficients: FloatArray, intercept: FloatArray
) -> AdditiveFunction:
    """The function x -> coefficients (q, m) @ min-kernel(support (m, d), x) + intercept (q,)."""
    bends: list[FloatArray] = []
    slopes: list[FloatArray] = []
    for values in support.T:
        bend, which = np.unique(values, return_inverse=True)
        weight: FloatArray = np.stack(
            [np.bincount(which, c, len(bend)).astype(np.float64) for c in coefficients], 1
        )
        # Up to a bend, all support values from it on grow with x.
        rest = np.cumsum(weight[::-1], axis=0)[::-1]
        bends.append(np.asarray(bend[bend > 0], np.float64))
        slopes.append(np.asarray(rest[bend > 0], np.float64))
    return AdditiveFunction(bends, slopes, intercept)


def _pieces(bends: FloatArray, slopes: FloatArray) -> FloatArray:
    """(u + 1, 2, q) what to add on each piece so that the pieces meet, and its slope."""
    slope = np.pad(slopes, ((0, 1), (0, 0)))  # none behind the last bend
    steps = np.cumsum(-np.diff(slope, axis=0) * bends[:, None], axis=0)
    return np.stack([np.pad(steps, ((1, 0), (0, 0))), slope], 1)


def _buckets(bends: Sequence[FloatArray]) -> tuple[FloatArray, NDArray[np.int32], int]:
    """Where a search for a value begins and ends: equal buckets up to the last bend of each bin.

    Returns
    -------
    scale : (d,) array of float
        Buckets a unit.
    first : (d, k + 3) array of int
        The first piece that may hold a value of each bucket; the last one is that of two further.
    most : int
        Bends in the fullest pair of buckets.
    """
    count = BUCKETS * max((len(bend) for bend in bends), default=0) + 1
    scale = np.array([count / bend[-1] if len(bend) else 0.0 for bend in bends])
    # A hair lower than where the buckets begin: a product may be rounded up into the next one.
    edges = np.append(np.arange(count + 1) - 1e-6, [np.inf, np.inf])
    start = np.cumsum([0, *(len(bend) + 1 for bend in bends)])[:-1]
    first = np.stack(
        [begin + np.searchsorted(bend * share, edges) for bend, share, begin in
         zip(bends, scale, start, strict=True)]
    )  # fmt: skip
    return scale, first.astype(np.int32), int((first[:, 2:] - first[:, :-2]).max(initial=0))


def _look_up(rows: FloatArray, offset: IntArray, top: int, x: FloatArray) -> FloatArray:
    """(n, q) sums of table rows for whole counts (n, d); empty bins add nothing."""
    if len(x) == 1:
        count = np.minimum(x[0], top).astype(np.int64)
        return rows.take(count + offset, axis=0).sum(axis=0, keepdims=True)
    row, place = np.nonzero(x)
    column = np.minimum(x[row, place], top).astype(np.int64) + offset[place]
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(x)))])
    ones = csr_array((np.ones(len(row)), column, start), shape=(len(x), len(rows)))
    return np.asarray(ones @ rows)


@cache
def _compiled(q: int) -> Any:
    """The loop for q sums: a known number, so that the innermost loops unroll.

    Bins run outside, samples inside, in blocks: the pieces of one bin stay in the fast memory.
    """

    def loop(x, scale, first, ends, pieces, rows, top, intercept):  # type: ignore[no-untyped-def]
        total = np.empty((x.shape[0], q))
        for t in range(x.shape[0]):
            for i in range(q):
                total[t, i] = intercept[i]
        most = first.shape[1] - 3
        block = 1 if len(rows) else SAMPLES  # a table of whole counts is small
        for begin in range(0, x.shape[0], block):
            for place in range(x.shape[1]):
                for t in range(begin, min(begin + block, x.shape[0])):
                    value = x[t, place]
                    if value == 0.0:
                        continue
                    if len(rows) and value == np.floor(value):
                        row = place * (top + 1) + int(min(value, float(top)))
                        for i in range(q):
                            total[t, i] += rows[row, i]
                        continue
                    bucket = np.uint32(min(value * scale[place], float(most)))
                    low, high = np.uint32(first[place, bucket]), first[place, bucket + 2]
                    while high - low > LINEAR:
                        middle = np.uint32((low + high) // 2)
                        if ends[middle] < value:
                            low = np.uint32(middle + 1)
                        else:
                            high = middle
                    while ends[low] < value:
                        low += np.uint32(1)
                    for i in range(q):
                        total[t, i] += pieces[low, 0, i] + pieces[low, 1, i] * value
        return total

    return compile_loop(loop, error_model="numpy")


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

    It is trained on the Gram matrix by scikit-learn's SVC (800 MB for 10,000 histograms) and
    evaluated exactly, bin by bin (`AdditiveFunction`).

    Parameters
    ----------
    C : float
        Penalty, as in scikit-learn's SVC. The kernel is divided by its mean on the training
        histograms, so that C means the same for few and for many votes.
    """

    def __init__(self, C: float = 10.0) -> None:
        self.C = C

    def fit(self, X: ArrayLike, y: ArrayLike) -> IntersectionSVC:
        """Train on histograms (n, d) with labels (n,).

        Raises
        ------
        InvalidArrayError
            Negative counts: the kernel is indefinite there, and the SVM would not notice.
        """
        from sklearn.svm import SVC  # takes 0.2 s to import, and only training needs it

        histograms, labels = validate_data(self, X, y, dtype=np.float64)
        _refuse_negative(histograms)
        self.scale_ = float(histograms.sum(axis=1).mean()) or 1.0
        gram = intersection_kernel(histograms, histograms)
        svc = SVC(kernel="precomputed", C=self.C).fit(gram / self.scale_, labels)
        self.classes_ = svc.classes_
        self.support_histograms_ = histograms[svc.support_]
        self.coefficients_ = pair_coefficients(svc) / self.scale_
        self.intercept_ = np.asarray(svc.intercept_)
        self.function_ = self._make_function()
        return self

    def _make_function(self) -> AdditiveFunction:
        """What the decision values are evaluated with."""
        parts = (self.support_histograms_, self.coefficients_, self.intercept_)
        return intersection_function(*parts)

    def decision_values(self, X: FloatArray) -> FloatArray:
        """(n, q) of each pair of classes; not checked."""
        return self.function_(X)

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """(n,) or (n, classes) decision values of histograms (n, d), as of scikit-learn's SVC."""
        values = self._checked(X)
        if len(self.classes_) == 2:
            return np.asarray(values[:, 0])
        return one_vs_rest(values, len(self.classes_))

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """(n,) labels of histograms (n, d)."""
        values = self._checked(X)
        if len(self.classes_) == 2:
            return np.asarray(self.classes_[(values[:, 0] > 0).astype(np.int64)])
        first, second = _pairs(len(self.classes_))
        votes = (values > 0) @ first + (values <= 0) @ second  # as libsvm counts them
        return np.asarray(self.classes_[votes.argmax(axis=1)])

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


def pair_coefficients(svc: Any) -> FloatArray:
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
