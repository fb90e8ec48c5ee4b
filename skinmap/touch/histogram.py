"""Codebook and histogram as a scikit-learn transformer that is fitted over several patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, check_random_state

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.neighbours.structures import Structures
from skinmap.touch.codebook import WORDS, check_samples, learn_codebook
from skinmap.touch.votes import VoteCounter

BOOK_SAMPLES = 120  # samples of one patch that a codebook is learnt from
Mode = Literal["rest-dropped", "paper"]


@dataclass(frozen=True, eq=False, slots=True)
class PatchSamples:
    """One row of a table of histograms: samples on one patch.

    Attributes
    ----------
    structures : Structures
        Of the patch; all patches share the same prototypes.
    samples : (k, n) array-like
        Pressures of 0 to 1, or 8-bit counts of 0 to 255; one sample, or those of one touch.
    """

    structures: Structures
    samples: NDArray[Any]


class StructureHistogram(TransformerMixin, BaseEstimator):
    """Histograms of periodic structures, one row for each `PatchSamples`.

    Parameters
    ----------
    words : int
        Codewords a structure, rest included.
    mode : {"rest-dropped", "paper"}
        Codeword 0 pinned to rest and its votes dropped, so that patches of any size agree; or
        the published algorithm to the letter.
    random_state : int, RandomState or None
        Of k-means and of the choice of samples.

    Attributes
    ----------
    codebook_ : Codebook
    n_features_out_ : int
        Bins.
    """

    def __init__(
        self,
        words: int = WORDS,
        mode: Mode = "rest-dropped",
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.words, self.mode, self.random_state = words, mode, random_state

    def fit(self, X: Sequence[PatchSamples], y: ArrayLike | None = None) -> StructureHistogram:
        """Learn the codebook from samples of all patches."""
        if self.mode not in ("rest-dropped", "paper"):
            raise InvalidArrayError(f"no mode {self.mode!r}; the modes are: rest-dropped, paper")
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        pools = []
        for structures, rows in _by_patch(X):
            samples = _stack([X[row] for row in rows])
            some = rng.choice(len(samples), min(BOOK_SAMPLES, len(samples)), replace=False)
            pools.append((structures, samples[some]))
        literal = self.mode == "paper"
        self.codebook_ = learn_codebook(pools, rng=rng, words=self.words, literal=literal)
        self.n_features_out_ = self.codebook_.bins
        return self

    def transform(self, X: Sequence[PatchSamples]) -> FloatArray:
        """(rows, bins) votes, the mean over the samples of each row; zeros without a sample.

        Raises
        ------
        SkinMismatchError
            Structures against other prototypes than the codebook's.
        """
        check_is_fitted(self)
        table = np.zeros((len(X), self.n_features_out_))
        for structures, rows in _by_patch(X):
            if structures.prototypes is not self.codebook_.prototypes and not _same(
                structures, self.codebook_.prototypes
            ):
                raise SkinMismatchError("structures against other prototypes than the codebook's")
            votes = VoteCounter(self.codebook_, structures).count(_stack([X[r] for r in rows]))
            length = [len(X[row].samples) for row in rows]
            owner = np.repeat(np.arange(len(rows)), length)
            total = np.zeros((len(rows), votes.shape[1]))
            np.add.at(total, owner, votes)
            table[rows] = total / np.maximum(length, 1)[:, None]
        return table

    def get_feature_names_out(self, input_features: object = None) -> NDArray[Any]:
        """Names of the bins: structure and word."""
        check_is_fitted(self)
        first = 0 if self.codebook_.literal else 1
        s, k, _ = self.codebook_.words.shape
        names = [f"structure{i}_word{j}" for i in range(s) for j in range(first, k)]
        return np.array(names, dtype=object)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.no_validation = True
        return tags


def _by_patch(X: Sequence[PatchSamples]) -> list[tuple[Structures, list[int]]]:
    """Rows of each patch."""
    rows: dict[int, tuple[Structures, list[int]]] = {}
    for number, one in enumerate(X):
        rows.setdefault(id(one.structures), (one.structures, []))[1].append(number)
    return list(rows.values())


def _stack(rows: Sequence[PatchSamples]) -> FloatArray:
    return np.concatenate([check_samples(r.samples, len(r.structures.labels)) for r in rows])


def _same(structures: Structures, prototypes: Any) -> bool:
    own = structures.prototypes
    return own.offsets.shape == prototypes.offsets.shape and bool(
        (own.offsets == prototypes.offsets).all() and (own.filled == prototypes.filled).all()
    )
