"""Codebooks over periodic structures, and the histograms that they turn samples into.

The pattern of a taxel is its own pressure followed by those of its neighbours in the order of
its structure. Each structure has k codewords, learnt by k-means from patterns of random
touches; every taxel votes for its nearest codeword, and the votes are the histogram.

Two changes to the published method, both switched off by `literal`: codeword 0 of every
structure is pinned to rest and its votes are dropped, so that a patch of another size gives the
same counts; and k-means sees touched patterns only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray, check_finite, freeze
from skinmap.errors import InvalidArrayError, SkinMismatchError, WrongTypeError
from skinmap.neighbours.structures import Prototypes, Structures
from skinmap.summary import Summary

WORDS = 8  # codewords a structure
REST = 12.0 / 255.0  # a pattern whose largest pressure is below this is at rest
COUNTS = 255.0  # a full 8-bit sensor value
LARGEST = 1e150  # pressures above this, once scaled, have no finite square
SMALL = 1e-100  # pressures below this (or above its inverse) are scaled before they are squared
PATTERNS = 4000  # patterns of one structure that k-means sees at most


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Codebook(Summary):
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

    def __post_init__(self) -> None:
        freeze(self, words=self.words)

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
