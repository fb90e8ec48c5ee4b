"""Codebooks over periodic structures, and the histograms that they turn samples into.

The pattern of a taxel is its own pressure followed by those of its neighbours in the order of
its structure. Each structure has k codewords, learnt by k-means from patterns of random
touches; every taxel votes for its nearest codeword, and the votes are the histogram.

Two changes to the published method, both switched off by `literal`: codeword 0 of every
structure is pinned to rest and its votes are dropped, so that a patch of another size gives the
same counts; and k-means sees touched patterns only.

Votes are counted fast. The distance of a pattern from a codeword is the sum of squared differences,
place by place in the order of the structure. Every way of counting below either computes that sum
in that order (so that all agree to the last bit) or proves that rounding cannot have changed the
nearest word. Ties go to the word of the smaller number, so to rest before all others.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray, Frozen, IntArray, check_finite
from skinmap.errors import InvalidArrayError, MissingLibraryError, SkinMismatchError, WrongTypeError
from skinmap.neighbours.structures import Prototypes, Structures
from skinmap.numba_loops import compile_loop
from skinmap.summary import Summary

WORDS = 8  # codewords a structure
REST = 12.0 / 255.0  # a pattern whose largest pressure is below this is at rest
COUNTS = 255.0  # a full 8-bit sensor value
LARGEST = 1e150  # pressures above this, once scaled, have no finite square
SMALL = 1e-100  # pressures below this (or above its inverse) are scaled before they are squared
PATTERNS = 4000  # patterns of one structure that k-means sees at most


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Codebook(Frozen, Summary):
    """Codewords of s structures.

    Attributes
    ----------
    prototypes : Prototypes
        The structures that taxels of any skin are matched with.
    words : (s, k, p) float
        Codewords over the taxel and its p - 1 neighbour places, pressures 0 to 1; NaN where a
        structure has fewer words.
    literal : bool
        Whether resting words count.
    scale : float
        Power of two that samples are multiplied with before they are compared: 1 unless the
        squares of what the book was learnt from would leave the range of float64.
    """

    prototypes: Prototypes
    words: FloatArray
    literal: bool
    scale: float = 1.0

    @property
    def bins(self) -> int:
        """Length of a histogram."""
        dropped = 0 if self.literal else len(self.prototypes)
        return self.words.shape[0] * self.words.shape[1] - dropped

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "structures": len(self.prototypes),
            "words": self.words.shape[1],
            "bins": self.bins,
            "method": "paper" if self.literal else "rest-dropped",
        }


def patterns(structures: Structures, s: int, samples: FloatArray) -> FloatArray:
    """(t, m, p) patterns of the m members of structure s in samples (t, n) of 0 to 1."""
    members = np.flatnonzero(structures.labels == s)
    order = np.column_stack([members, structures.neighbours[members]])
    return np.where(order >= 0, samples[:, np.maximum(order, 0)], 0.0)


def check_samples(samples: ArrayLike, n_taxels: int) -> FloatArray:
    """Samples (t, n) as pressures; whole numbers are counts of 0 to 255 and become 0 to 1.

    Raises
    ------
    InvalidArrayError, SkinMismatchError
        Not numbers, NaN or infinity; samples of another number of taxels.
    """
    array = np.asarray(samples)
    if array.ndim == 2 and array.shape[1] != n_taxels:
        raise SkinMismatchError(f"samples of {array.shape[1]} taxels for a skin of {n_taxels}")
    values = check_finite(array, "samples", (None, n_taxels))
    return values / COUNTS if array.dtype.kind in "iu" else values


def _scale(largest: float) -> float:
    """1, or the power of two that brings a largest pressure far from 1 to between 0.5 and 1."""
    if largest == 0.0 or SMALL <= largest <= 1.0 / SMALL:
        return 1.0
    # Below 2^-1022 the power itself would overflow; what is left then is still above 2^-53.
    return float(np.ldexp(1.0, int(min(-np.frexp(largest)[1], 1022))))


def learn_codebook(
    skins: Sequence[tuple[Structures, ArrayLike]],
    *,
    rng: np.random.Generator | int,
    words: int = WORDS,
    literal: bool = False,
) -> Codebook:
    """Learn codewords from samples of one or several skins that share their prototypes.

    Parameters
    ----------
    skins : sequence of (Structures, (t, n) array-like)
        Of each skin its structures and t samples of its n taxels: pressures of 0 to 1, or whole
        numbers (of any integer type), which are counts of 0 to 255.
    rng : numpy.random.Generator or int
        Chooses patterns and starts of k-means; a number is its seed.
    words : int
        Codewords a structure, rest included.
    literal : bool
        The method as published: rest neither pinned nor dropped.

    Returns
    -------
    Codebook
        Up to `words` codewords of each structure.

    Raises
    ------
    InvalidArrayError
        No skin, fewer than two codewords, skins whose structures are not the same, or samples
        that are not finite numbers.
    SkinMismatchError
        Samples of another number of taxels.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> structures = skinmap.find_structures(skinmap.flatten(skinmap.build_surface(skin)))
    >>> touches = skinmap.simulate(skin, per_gesture=2, rng=0)
    >>> book = skinmap.learn_codebook([(structures, touches.pressures)], words=4, rng=0)
    >>> book.bins == 3 * len(book.prototypes)
    True
    """
    rng = np.random.default_rng(rng)
    if not skins or words < 2:
        raise InvalidArrayError(f"a codebook needs a skin and 2 words, got {len(skins)}, {words}")
    if not all(isinstance(one, tuple | list) and isinstance(one[0], Structures) for one in skins):
        raise WrongTypeError("skins of a codebook are pairs (Structures, samples), in this order")
    prototypes = skins[0][0].prototypes
    if any(structures.prototypes is not prototypes for structures, _ in skins):
        raise InvalidArrayError("all skins of a codebook must share the same prototypes")
    checked = [(structures, check_samples(x, len(structures.labels))) for structures, x in skins]
    if not sum(len(x) for _, x in checked):
        raise InvalidArrayError("a codebook needs samples, got 0")
    scale = _scale(max(float(np.abs(x).max(initial=0.0)) for _, x in checked))
    scaled = [(structures, x * scale) for structures, x in checked]
    width = prototypes.offsets.shape[1] + 1
    book = np.full((len(prototypes), words, width), np.nan)
    for s in range(len(prototypes)):
        seen = np.concatenate([patterns(st, s, x).reshape(-1, width) for st, x in scaled])
        centres = _centres(seen, words, literal, rng)
        book[s, : len(centres)] = centres
    return Codebook(prototypes, book, literal, scale)


def _centres(seen: FloatArray, words: int, literal: bool, rng: np.random.Generator) -> FloatArray:
    from sklearn.cluster import KMeans

    rest = np.zeros((1, seen.shape[1]))
    if not literal:
        seen = seen[seen.max(axis=1, initial=0.0) >= REST]
        words -= 1
    if len(seen) > PATTERNS:
        seen = seen[rng.choice(len(seen), PATTERNS, replace=False)]
    distinct = np.unique(seen, axis=0)
    if len(distinct) > words:
        seed = int(rng.integers(2**31))
        distinct = KMeans(words, n_init=1, random_state=seed).fit(seen).cluster_centers_
    return distinct if literal else np.concatenate([rest, distinct])


def codebook_arrays(book: Codebook) -> dict[str, NDArray[Any]]:
    """A codebook as plain arrays, to be written to a file."""
    shapes = book.prototypes
    numbers = [float(book.literal), book.scale, shapes.tolerance, float(shapes.rotations)]
    return {
        "words": book.words,
        "offsets": shapes.offsets,
        "filled": shapes.filled,
        "required": shapes.required,
        "numbers": np.array(numbers),
    }


def codebook_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Codebook:
    """What `codebook_arrays` was given.

    Raises
    ------
    InvalidArrayError
        Arrays that do not fit together.
    """
    words, offsets = np.asarray(arrays["words"]), np.asarray(arrays["offsets"])
    filled, required = np.asarray(arrays["filled"], bool), np.asarray(arrays["required"], bool)
    literal, scale, tolerance, rotations = map(float, arrays["numbers"])
    s, k = filled.shape
    fits = words.ndim == 3 and (words.shape[0], words.shape[2]) == (s, k + 1)
    fits = fits and offsets.shape == (s, k, 2) and required.shape == (s, k) and scale > 0
    if not fits or not np.isfinite(offsets).all() or np.isinf(words).any():
        raise InvalidArrayError("the arrays of a codebook do not fit together")
    shapes = Prototypes(offsets, filled, required, tolerance, int(rotations))
    return Codebook(shapes, words, bool(literal), scale)


CHUNK = 2**13  # patterns at a time, to stay in the cache
SPARSE = 0.3  # share of taxels near a touch below which the rest of them are skipped
NEVER = np.finfo(float).max  # cost of a word that is not there; infinity would spoil a product
BLOCK = 64  # taxels that are compared together: a vector unit's width, many times over
COMPILE = 2_000_000  # patterns from which compiling pays by itself (about two seconds)

logger = logging.getLogger(__name__)


class VoteCounter:
    """Counts votes on one skin for one codebook; the tables are made once.

    Parameters
    ----------
    codebook : Codebook
    structures : Structures
        Of the skin, against the prototypes of the codebook.
    compiled : bool, optional
        Whether to use numba; by default where it is installed and the samples are many.
        Without numba the same votes are counted more slowly.

    Raises
    ------
    SkinMismatchError
        Structures that do not fit the codebook.
    """

    def __init__(
        self, codebook: Codebook, structures: Structures, *, compiled: bool | None = None
    ) -> None:
        s, k, p = codebook.words.shape
        if structures.neighbours.shape[1] + 1 != p:
            raise SkinMismatchError(
                f"structures of {structures.neighbours.shape[1]} neighbours for a codebook of "
                f"{p - 1}"
            )
        self.codebook, self.n_taxels = codebook, len(structures.labels)
        # A word that a structure lacks is infinitely far from everything.
        words = np.where(np.isnan(codebook.words), np.inf, codebook.words)
        able = np.asarray(np.isfinite(words[:, :, 0]).any(axis=1))
        voters = np.flatnonzero((structures.labels >= 0) & able[structures.labels])
        self.taxels = voters[np.argsort(structures.labels[voters], kind="stable")]
        self.labels = structures.labels[self.taxels]
        self.start = np.searchsorted(self.labels, np.arange(s + 1))
        order = np.column_stack([self.taxels, structures.neighbours[self.taxels]])
        # Empty places read a zero that stands behind the last taxel.
        order = np.where(order < 0, self.n_taxels, order).T
        index = np.vstack([order, np.full(len(voters), self.n_taxels + 1)])
        self.index = np.ascontiguousarray(index)
        self.words = words
        rest = _nearest(np.zeros((p, s)), words.transpose(2, 1, 0))
        self.rest = np.where(able, rest, 0)
        self._cell = self.labels * k
        # A place of ones behind the last one brings in |c|^2.
        there = np.where(np.isfinite(words), words, 0.0)
        lacking = ~np.isfinite(words[:, :, :1])
        square = np.where(lacking, NEVER, (there**2).sum(axis=2, keepdims=True))
        self._products = np.concatenate([-2.0 * there, square], axis=2)
        self._largest = float(np.abs(there).max(initial=0.0))
        self._kernel: Any = self._compile() if compiled else None
        self._may_compile = compiled is None

    @property
    def compiled(self) -> bool:
        """Whether compiled code counts."""
        return self._kernel is not None

    def count(self, samples: ArrayLike) -> IntArray:
        """(t, bins) votes for samples (t, n): pressures of 0 to 1, or whole counts.

        Raises
        ------
        InvalidArrayError, SkinMismatchError
            NaN, infinity or numbers without a finite square; another number of taxels.
        """
        pressures = check_samples(samples, self.n_taxels)
        if self._may_compile and len(pressures) * len(self.taxels) >= COMPILE:
            self._kernel, self._may_compile = self._compile(), False
        votes = np.zeros((len(pressures), *self.words.shape[:2]), np.int64)
        if self._kernel is not None:
            if not self._kernel(pressures, votes):
                raise self._too_large(pressures)
            return self._counted(votes)
        step = max(1, CHUNK // max(1, len(self.taxels)))
        for first in range(0, len(pressures), step):
            self._add_votes(pressures[first : first + step], votes[first : first + step])
        return self._counted(votes)

    def count_one(self, sample: ArrayLike) -> IntArray:
        """(bins,) votes for one sample (n,), with as little around it as can be."""
        array = np.asarray(sample)
        if array.shape != (self.n_taxels,):
            raise SkinMismatchError(f"a sample {array.shape} for a skin of {self.n_taxels} taxels")
        if self._kernel is None or array.dtype.kind not in "fu":
            return self.count(array[None])[0]
        values = array / COUNTS if array.dtype.kind == "u" else array.astype(np.float64, copy=False)
        votes = np.zeros((1, *self.words.shape[:2]), np.int64)
        if not self._kernel(values[None], votes):
            raise self._too_large(values[None])
        return self._counted(votes)[0]

    def _too_large(self, pressures: FloatArray) -> InvalidArrayError:
        fine = np.abs(pressures * self.codebook.scale) <= LARGEST
        row, taxel = np.argwhere(~fine)[0]
        return InvalidArrayError(
            f"sample {row} holds {pressures[row, taxel]} at taxel {taxel}: "
            "expected pressures of 0 to 1"
        )

    def _counted(self, votes: IntArray) -> IntArray:
        kept = votes if self.codebook.literal else votes[:, :, 1:]
        return kept.reshape(len(votes), self.codebook.bins)

    def _add_votes(self, pressures: FloatArray, votes: IntArray) -> None:
        """Add the votes of samples (t, n) to votes (t, s, k), all structures together."""
        t, (s, k) = len(pressures), votes.shape[1:]
        columns = np.zeros((self.n_taxels + 2, t))
        np.multiply(pressures.T, self.codebook.scale, out=columns[:-2])
        largest = max(float(columns.max()), -float(columns.min()))
        if not largest <= LARGEST:
            raise self._too_large(pressures)
        columns[-1] = 1.0  # brings in the words' own squares
        near_share = np.count_nonzero(pressures) * len(self.index) / max(1, t * len(self.taxels))
        if t > 1 and near_share < SPARSE:  # one sample is quicker whole
            near = np.bitwise_or.reduce((columns[:-1] != 0).take(self.index[:-1], axis=0), axis=0)
            position, sample = np.nonzero(near)
            seen = columns[self.index[:, position], sample]
            start = np.searchsorted(position, self.start)
            cell = self._cell[position] + sample * (s * k)
            voted = np.bincount(self._cell[position] // k + sample * s, minlength=t * s)
            votes[:, np.arange(s), self.rest] += np.diff(self.start) - voted.reshape(t, s)
        else:
            seen = columns.take(self.index, axis=0).reshape(len(self.index), -1)
            start = self.start * t
            cell = (self._cell[:, None] + np.arange(t) * (s * k)).ravel()
        word = self._nearest(seen, start, largest)
        votes += np.bincount(cell + word, minlength=votes.size).reshape(votes.shape)

    def _nearest(self, seen: FloatArray, start: IntArray, largest: float) -> NDArray[np.uint8]:
        """(m,) nearest word of each pattern (p + 1, m); those of structure s begin at start[s].

        |x - c|^2 = |x|^2 + |c|^2 - 2 x.c, and the first term is the same for all words. Where
        the best words are closer than rounding can be off, the distances are summed as they
        stand.
        """
        _, k, p = self.words.shape
        cost = np.empty((k, seen.shape[1]))
        for product, first, last in zip(self._products, start[:-1], start[1:], strict=True):
            np.matmul(product, seen[:, first:last], out=cost[:, first:last])
        # Higham, Accuracy and Stability of Numerical Algorithms, 2002, section 3.1: a sum of p
        # products is off by at most p eps times the sum of their sizes; both ways, with a margin.
        size = (largest + self._largest) ** 2
        close = cost <= cost.min(axis=0) + 8.0 * (p + 4) * np.finfo(float).eps * p * size
        number = np.arange(k, dtype=np.uint8)[:, None]
        word = np.bitwise_or.reduce(close.view(np.uint8) * number, axis=0)
        if np.count_nonzero(close) > close.shape[1]:
            unsure = np.flatnonzero(np.count_nonzero(close, axis=0) > 1)
            label = np.searchsorted(start, unsure, side="right") - 1
            word[unsure] = _nearest(seen[:-1, unsure], self.words[label].transpose(2, 1, 0))
        return word

    def _compile(self) -> Any:
        try:
            return _vote_kernel(self)
        except MissingLibraryError:
            logger.info("numba is not installed: votes are counted by numpy")
            return None


def _nearest(seen: FloatArray, words: FloatArray) -> IntArray:
    """(m,) number of the word (p, k, m) or (p, k, 1) that is nearest to each pattern (p, m)."""
    cost = np.zeros(words.shape[1:])
    step = np.empty_like(cost)
    for place, values in enumerate(seen):
        np.subtract(values, words[place], out=step)
        np.multiply(step, step, out=step)
        cost += step
    return cost.argmin(axis=0)


def histograms(codebook: Codebook, structures: Structures, samples: ArrayLike) -> IntArray:
    """Votes of the taxels for codewords, sample by sample.

    Taxels without a structure do not vote. Ties go to the word of the smaller number, so to rest
    before all others. For many calls on one skin, a `VoteCounter` is kept.

    Parameters
    ----------
    codebook : Codebook
    structures : Structures
        Of a skin of n taxels, by the codebook's prototypes.
    samples : (t, n) array-like
        Pressures of 0 to 1, or counts of 0 to 255 as whole numbers.

    Returns
    -------
    (t, bins) array of int
        Histograms.

    Raises
    ------
    SkinMismatchError
        Samples of another number of taxels.
    InvalidArrayError
        Samples that are not finite numbers.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> structures = skinmap.find_structures(skinmap.flatten(skinmap.build_surface(skin)))
    >>> touches = skinmap.simulate(skin, per_gesture=2, rng=0)
    >>> book = skinmap.learn_codebook([(structures, touches.pressures)], words=4, rng=0)
    >>> skinmap.histograms(book, structures, touches.pressures[:5]).shape == (5, book.bins)
    True
    """
    return VoteCounter(codebook, structures).count(samples)


def _vote_kernel(counter: VoteCounter) -> Callable[[FloatArray, IntArray], bool]:
    """A function that adds the votes of samples (t, n) to votes (t, s, k), where it can.

    It says no where a sample holds something whose square is not finite.

    Raises
    ------
    MissingLibraryError
        Without numba.
    """
    loop = _compiled(counter.words.shape[2])
    order = counter.index[:-1]
    index = order.astype(np.uint32)
    reverse, position = _readers(order, counter.n_taxels)
    start, words, rest = counter.start, np.ascontiguousarray(counter.words), counter.rest

    scale = counter.codebook.scale

    def count(samples: FloatArray, votes: IntArray) -> bool:
        done = loop(samples, scale, index, start, words, rest, reverse, position, votes)
        return bool(done)

    return count


def _readers(index: IntArray, n_taxels: int) -> tuple[IntArray, IntArray]:
    """Which positions read each taxel: those of taxel i are position[start[i] : start[i + 1]]."""
    read = index.ravel()
    where = np.tile(np.arange(index.shape[1]), len(index))[np.argsort(read, kind="stable")]
    count = np.bincount(read, minlength=n_taxels + 1)[:n_taxels]
    return np.concatenate([[0], np.cumsum(count)]), where


@cache
def _compiled(p: int) -> Any:
    """The loop for patterns of p places: a known number, so that the sum unrolls."""

    def loop(samples, scale, index, start, words, rest, reverse, position, votes):  # type: ignore[no-untyped-def]
        n, m = samples.shape[1], index.shape[1]
        sample = np.zeros(n + 1)  # empty places read the zero behind the last taxel
        seen, best = np.empty((p, BLOCK)), np.empty(BLOCK)
        word = np.empty(BLOCK, np.uint32)
        near, todo = np.zeros(m, np.uint8), np.zeros(m, np.int64)
        for t in range(len(samples)):
            touched = fine = 0
            for i in range(n):
                sample[i] = samples[t, i] * scale
                touched += sample[i] != 0.0
                fine += abs(sample[i]) <= LARGEST
            if fine < n:
                return False
            sparse = touched * p < m // 2
            if sparse:
                near[:] = 0
                for i in range(n):
                    if sample[i] != 0.0:
                        for j in range(reverse[i], reverse[i + 1]):
                            near[position[j]] = 1
            for s in range(len(words)):
                first, last = start[s], start[s + 1]
                if sparse:
                    last = first
                    for a in range(start[s], start[s + 1]):
                        todo[last] = a
                        last += near[a]
                    votes[t, s, rest[s]] += start[s + 1] - last
                while first < last:
                    size = min(BLOCK, last - first)
                    for i in range(p):
                        for b in range(size):
                            a = todo[first + b] if sparse else first + b
                            seen[i, b] = sample[index[i, a]]
                    best[:] = np.inf
                    word[:] = 0
                    for j in range(words.shape[1]):
                        for b in range(size):
                            d = 0.0
                            for i in range(p):
                                step = seen[i, b] - words[s, j, i]
                                d += step * step
                            nearer = d < best[b]
                            best[b] = d if nearer else best[b]
                            word[b] = j if nearer else word[b]
                    for b in range(size):
                        votes[t, s, word[b]] += 1
                    first += size
        return True

    return compile_loop(loop, error_model="numpy")
