from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, WrongTypeError
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import assign, find_structures
from skinmap.touch.histograms.codebook import histograms, learn_codebook, patterns


@pytest.fixture(scope="module")
def tiled(tiling_12):
    """Structures of one 12-pad tiling, and of half of it with the same prototypes."""

    def hoods(points):
        up = np.tile([0.0, 0, 1], (len(points), 1))
        return neighbourhoods(points, up, np.tile([0.0, 1, 0], (len(points), 1)), radius=8e-3)

    whole = find_structures(hoods(tiling_12), rotations=6)
    return whole, assign(hoods(tiling_12[:432]), whole.prototypes)


def touches(structures, rng, n=40):
    """Samples with a few touched taxels each, 0 to 1."""
    samples = np.zeros((n, len(structures.labels)))
    for row in samples:
        row[rng.integers(len(row), size=20)] = rng.uniform(0.2, 1.0, 20)
    return samples


def slow_votes(book, structures, sample):
    """Algorithm 1 as written: one taxel after another."""
    votes = np.zeros(book.words.shape[:2], int)
    for taxel, s in enumerate(structures.labels):
        pattern = [sample[taxel]]
        for other in structures.neighbours[taxel]:
            pattern.append(sample[other] if other >= 0 else 0.0)
        words = [w for w in book.words[s] if not np.isnan(w[0])]
        votes[s, int(np.argmin([((pattern - w) ** 2).sum() for w in words]))] += 1
    return votes


@pytest.mark.parametrize("literal", [False, True])
def test_histograms_agree_with_the_algorithm_written_out(tiled, rng, literal):
    whole, _ = tiled
    samples = touches(whole, rng)
    book = learn_codebook([(whole, samples)], rng=rng, literal=literal)
    for sample in samples[:3]:
        expected = slow_votes(book, whole, sample)
        expected = expected if literal else expected[:, 1:]
        np.testing.assert_array_equal(histograms(book, whole, sample[None])[0], expected.ravel())


def test_rest_has_no_votes_but_for_the_literal_method(tiled, rng):
    whole, _ = tiled
    samples = touches(whole, rng)
    book = learn_codebook([(whole, samples)], rng=rng)
    assert histograms(book, whole, np.zeros((1, len(whole.labels)))).sum() == 0
    literal = learn_codebook([(whole, samples)], rng=rng, literal=True)
    rest = histograms(literal, whole, np.zeros((1, len(whole.labels))))
    assert rest.sum() == len(whole.labels)


def test_votes_of_one_touch_are_the_same_on_a_patch_of_another_size(tiled, rng):
    whole, half = tiled
    book = learn_codebook([(whole, touches(whole, rng))], rng=rng)
    # A touch well inside the half: the same neighbours on both.
    samples = np.zeros((1, len(whole.labels)))
    inside = np.flatnonzero(
        (whole.labels[:432] == half.labels) & (half.neighbours >= 0).any(axis=1)
    )
    samples[0, inside[50]] = 0.8
    np.testing.assert_array_equal(
        histograms(book, whole, samples).sum(), histograms(book, half, samples[:, :432]).sum()
    )


def test_patterns_start_with_the_taxel_itself(tiled, rng):
    whole, _ = tiled
    samples = touches(whole, rng, n=3)
    members = np.flatnonzero(whole.labels == 1)
    np.testing.assert_array_equal(patterns(whole, 1, samples)[:, :, 0], samples[:, members])


def test_fewer_distinct_patterns_than_words_are_all_kept(tiled, rng):
    whole, _ = tiled
    sample = np.full((1, len(whole.labels)), 0.5)
    book = learn_codebook([(whole, sample)], rng=rng, words=8)
    votes = histograms(book, whole, sample)
    assert votes.sum() == len(whole.labels)


def test_all_zero_training_gives_a_book_of_rest(tiled, rng):
    whole, _ = tiled
    book = learn_codebook([(whole, np.zeros((5, len(whole.labels))))], rng=rng)
    assert histograms(book, whole, np.ones((1, len(whole.labels)))).sum() == 0


def test_learn_codebook_refuses_nothing(rng):
    with pytest.raises(InvalidArrayError, match="needs a skin and 2 words"):
        learn_codebook([], rng=rng)


def test_one_pair_that_is_not_in_a_list_is_refused(tiled, rng):
    with pytest.raises(WrongTypeError, match="are pairs"):
        learn_codebook((tiled[0], touches(tiled[0], rng)), rng=rng)


def test_counts_of_any_integer_type_are_the_same_touch(tiled, rng):
    structures, _ = tiled
    counts = np.rint(255 * touches(structures, rng)).astype(np.uint8)
    book = learn_codebook([(structures, counts)], words=4, rng=0)
    for kind in (np.int16, np.int64):
        wide = learn_codebook([(structures, counts.astype(kind))], words=4, rng=0)
        np.testing.assert_array_equal(wide.words, book.words)
        votes = histograms(book, structures, counts.astype(kind))
        np.testing.assert_array_equal(votes, histograms(book, structures, counts))
