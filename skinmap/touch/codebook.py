"""Codebooks over periodic structures, and the histograms that they turn samples into.

The pattern of a taxel is its own pressure followed by those of its neighbours in the order of
its structure. Each structure has k codewords, learnt by k-means from patterns of random
touches; every taxel votes for its nearest codeword, and the votes are the histogram.

Two changes to the published method, both switched off by `literal`: codeword 0 of every
structure is pinned to rest and its votes are dropped, so that a patch of another size gives the
same counts; and k-means sees touched patterns only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.neighbours.structures import Prototypes, Structures

WORDS = 8  # codewords a structure
REST = 12.0 / 255.0  # a pattern whose largest pressure is below this is at rest
PATTERNS = 4000  # patterns of one structure that k-means sees at most


@dataclass(frozen=True, eq=False, slots=True)
class Codebook:
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
    """

    prototypes: Prototypes
    words: FloatArray
    literal: bool

    def __post_init__(self) -> None:
        freeze(self, words=self.words)

    @property
    def bins(self) -> int:
        """Length of a histogram."""
        dropped = 0 if self.literal else len(self.prototypes)
        return self.words.shape[0] * self.words.shape[1] - dropped


def patterns(structures: Structures, s: int, samples: FloatArray) -> FloatArray:
    """(t, m, p) patterns of the m members of structure s in samples (t, n) of 0 to 1."""
    members = np.flatnonzero(structures.labels == s)
    order = np.column_stack([members, structures.neighbours[members]])
    return np.where(order >= 0, samples[:, np.maximum(order, 0)], 0.0)


def learn_codebook(
    skins: Sequence[tuple[Structures, FloatArray]],
    *,
    rng: np.random.Generator,
    words: int = WORDS,
    literal: bool = False,
) -> Codebook:
    """Learn codewords from samples of one or several skins that share their prototypes.

    Parameters
    ----------
    skins : sequence of (Structures, (t, n) array of float)
        Pressures 0 to 1.
    rng : numpy.random.Generator
    words : int
        Codewords a structure, rest included.
    literal : bool
        The method as published: rest neither pinned nor dropped.

    Raises
    ------
    InvalidArrayError
        No skin, or fewer than two codewords.
    """
    if not skins or words < 2:
        raise InvalidArrayError(f"a codebook needs a skin and 2 words, got {len(skins)}, {words}")
    prototypes = skins[0][0].prototypes
    width = prototypes.offsets.shape[1] + 1
    book = np.full((len(prototypes), words, width), np.nan)
    for s in range(len(prototypes)):
        seen = np.concatenate([patterns(st, s, x).reshape(-1, width) for st, x in skins])
        centres = _centres(seen, words, literal, rng)
        book[s, : len(centres)] = centres
    return Codebook(prototypes, book, literal)


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


def histograms(codebook: Codebook, structures: Structures, samples: FloatArray) -> IntArray:
    """(t, bins) votes for samples (t, n) of 0 to 1; taxels without a structure do not vote.

    Ties go to the word of the smaller number, so to rest before all others.
    """
    s, k, _ = codebook.words.shape
    votes = np.zeros((len(samples), s, k), np.int64)
    rows = np.arange(len(samples))[:, None]
    for number in range(s):
        words = codebook.words[number]
        words = words[~np.isnan(words[:, 0])]
        seen = patterns(structures, number, samples)
        if seen.shape[1] == 0 or len(words) == 0:
            continue
        # |x - c|^2 = |x|^2 + |c|^2 - 2 x.c; the first term is the same for all words.
        cost = (words**2).sum(axis=1) - 2.0 * seen @ words.T
        np.add.at(votes[:, number], (np.broadcast_to(rows, cost.shape[:2]), cost.argmin(axis=2)), 1)
    counted = votes if codebook.literal else votes[:, :, 1:]
    return counted.reshape(len(samples), codebook.bins)
