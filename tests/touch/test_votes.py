"""Votes counted fast are the votes of Algorithm 1, whatever way they are counted."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import find_structures
from skinmap.touch.histograms import codebook as module
from skinmap.touch.histograms.codebook import Codebook, VoteCounter, histograms, learn_codebook


@pytest.fixture(scope="module")
def tiled(tiling_12):
    up = np.tile([0.0, 0, 1], (432, 1))
    hoods = neighbourhoods(tiling_12[:432], up, np.tile([0.0, 1, 0], (432, 1)), radius=8e-3)
    return find_structures(hoods, rotations=6)


def literal_votes(book, structures, samples):
    """Algorithm 1 with the sum of each distance taken place by place, all words of all taxels."""
    votes = np.zeros((len(samples), *book.words.shape[:2]), int)
    for t, sample in enumerate(samples * book.scale):
        for taxel, s in enumerate(structures.labels):
            places = structures.neighbours[taxel]
            pattern = [sample[taxel], *np.where(places >= 0, sample[places], 0.0)]
            distances = []
            for word in book.words[s]:
                distance = 0.0
                for value, centre in zip(pattern, word, strict=True):
                    distance += (value - centre) * (value - centre)
                distances.append(np.inf if np.isnan(distance) else distance)
            votes[t, s, int(np.argmin(distances))] += 1
    counted = votes if book.literal else votes[:, :, 1:]
    return counted.reshape(len(samples), -1)


def all_ways(book, structures, samples):
    """Votes by batch, one by one, and compiled where numba is there."""
    plain = VoteCounter(book, structures, compiled=False)
    yield plain.count(samples)
    yield np.array([plain.count_one(sample) for sample in samples])
    compiled = VoteCounter(book, structures, compiled=True)
    yield compiled.count(samples)
    yield np.array([compiled.count_one(sample) for sample in samples])


def draw(kind, n, rng):
    samples = rng.random((8, n))
    if kind == "sparse":
        return np.where(rng.random((8, 1)) < 0.5, samples, 0.0) * (rng.random((8, n)) < 0.03)
    if kind == "halves":  # few values: many patterns lie exactly between two words
        return rng.integers(0, 3, (8, n)) / 2.0
    if kind == "offset":
        return samples + 1e6
    return samples


@pytest.mark.parametrize("literal", [False, True])
@pytest.mark.parametrize("kind", ["full", "sparse", "halves", "offset"])
def test_every_way_counts_the_votes_of_the_literal_loop(tiled, rng, kind, literal):
    samples = draw(kind, len(tiled.labels), rng)
    book = learn_codebook([(tiled, samples)], rng=rng, literal=literal)
    expected = literal_votes(book, tiled, samples)
    for votes in all_ways(book, tiled, samples):
        np.testing.assert_array_equal(votes, expected)


def test_numba_is_what_the_compiled_counter_counts_with(tiled, rng):
    pytest.importorskip("numba", reason="compiled votes need numba")
    book = learn_codebook([(tiled, rng.random((3, len(tiled.labels))))], rng=rng)
    assert VoteCounter(book, tiled, compiled=True).compiled
    assert not VoteCounter(book, tiled, compiled=False).compiled


def test_without_numba_the_votes_are_the_same(tiled, rng, monkeypatch):
    samples = rng.random((3, len(tiled.labels)))
    book = learn_codebook([(tiled, samples)], rng=rng)
    expected = histograms(book, tiled, samples)
    monkeypatch.setitem(sys.modules, "numba", None)
    module._compiled.cache_clear()
    counter = VoteCounter(book, tiled, compiled=True)
    assert not counter.compiled
    np.testing.assert_array_equal(counter.count(samples), expected)


def test_ties_go_to_rest_and_then_to_the_smaller_number(tiled):
    shape = (len(tiled.prototypes), 3, tiled.neighbours.shape[1] + 1)
    words = np.zeros(shape)
    words[:, 1:, 0] = 1.0  # words 1 and 2 are the same, and 0.5 is as far from rest
    book = Codebook(tiled.prototypes, words, literal=True)
    samples = np.zeros((2, len(tiled.labels)))
    samples[0, 7], samples[1, 7] = 0.5, 0.75
    for votes in all_ways(book, tiled, samples):
        table = votes.reshape(2, -1, 3).sum(axis=1)
        np.testing.assert_array_equal(table[0], [len(tiled.labels), 0, 0])
        assert table[1, 1] == 1
        assert table[1, 2] == 0


def test_the_zeros_of_empty_places_and_of_resting_taxels_vote_for_rest(tiled, rng):
    book = learn_codebook([(tiled, rng.random((5, len(tiled.labels))))], rng=rng)
    for votes in all_ways(book, tiled, np.zeros((3, len(tiled.labels)))):
        assert votes.sum() == 0


def test_float32_samples_vote_as_the_same_numbers_in_float64(tiled, rng):
    samples = rng.random((4, len(tiled.labels)), dtype=np.float32)
    book = learn_codebook([(tiled, samples)], rng=rng)
    for short, long in zip(
        all_ways(book, tiled, samples), all_ways(book, tiled, samples.astype(float)), strict=True
    ):
        np.testing.assert_array_equal(short, long)


def test_eight_bit_counts_are_scaled_and_never_wrap(tiled, rng):
    counts = rng.integers(0, 256, (4, len(tiled.labels))).astype(np.uint8)
    book = learn_codebook([(tiled, counts)], rng=rng)
    assert book.words[~np.isnan(book.words)].max() <= 1.0
    expected = literal_votes(book, tiled, counts / 255.0)
    for votes in all_ways(book, tiled, counts):
        np.testing.assert_array_equal(votes, expected)


@pytest.mark.parametrize("factor", [1e308, 1e-310])
def test_pressures_at_the_ends_of_the_range_are_scaled_before_they_are_squared(tiled, rng, factor):
    # Multiples of 1/8, so that most survive as denormals; the literal book has no threshold.
    samples = rng.integers(0, 9, (6, len(tiled.labels))) / 8.0
    plain = learn_codebook([(tiled, samples)], rng=np.random.default_rng(3), literal=True)
    scaled = learn_codebook([(tiled, samples * factor)], rng=np.random.default_rng(3), literal=True)
    assert plain.scale == 1.0
    assert np.isfinite(scaled.words[~np.isnan(scaled.words)]).all()
    votes = VoteCounter(scaled, tiled).count(samples * factor)
    # k-means may settle a few patterns elsewhere, as the numbers are rounded otherwise.
    assert np.abs(votes - VoteCounter(plain, tiled).count(samples)).sum() < 0.1 * votes.sum()
    for way in all_ways(scaled, tiled, samples * factor):
        np.testing.assert_array_equal(way, votes)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite_are_refused(tiled, rng, bad):
    good = rng.random((3, len(tiled.labels)))
    broken = good.copy()
    broken[1, 5] = bad
    with pytest.raises(InvalidArrayError, match="NaN or infinity, first in row 1"):
        learn_codebook([(tiled, broken)], rng=rng)
    book = learn_codebook([(tiled, good)], rng=rng)
    for compiled in (False, True):
        counter = VoteCounter(book, tiled, compiled=compiled)
        with pytest.raises(InvalidArrayError, match="NaN or infinity, first in row 1"):
            counter.count(broken)
        with pytest.raises(InvalidArrayError, match=r"NaN or infinity|taxel 5: expected pressures"):
            counter.count_one(broken[1])


def test_a_sample_without_a_finite_square_is_refused_where_the_book_is_of_pressures(tiled, rng):
    samples = rng.random((3, len(tiled.labels)))
    book = learn_codebook([(tiled, samples)], rng=rng)
    samples[2, 9] = 1e308
    for compiled in (False, True):
        counter = VoteCounter(book, tiled, compiled=compiled)
        with pytest.raises(InvalidArrayError, match=r"sample 2 holds 1e\+308 at taxel 9"):
            counter.count(samples)
        with pytest.raises(InvalidArrayError, match=r"holds 1e\+308 at taxel 9"):
            counter.count_one(samples[2])


def test_samples_of_another_skin_are_refused(tiled, rng):
    book = learn_codebook([(tiled, rng.random((3, len(tiled.labels))))], rng=rng)
    counter = VoteCounter(book, tiled)
    with pytest.raises(SkinMismatchError, match="samples of 7 taxels for a skin of 432"):
        counter.count(np.zeros((2, 7)))
    with pytest.raises(SkinMismatchError, match=r"a sample \(7,\) for a skin of 432"):
        counter.count_one(np.zeros(7))


@pytest.mark.parametrize("rows", [1, 3, 5])
def test_fewer_samples_or_distinct_samples_than_words(tiled, rng, rows):
    # 5 samples of one pattern a structure, or 1 sample: fewer than the 8 words.
    samples = np.repeat(rng.random((1, 1)), rows, axis=0) * np.ones((1, len(tiled.labels)))
    book = learn_codebook([(tiled, samples)], rng=rng, words=8)
    there = (~np.isnan(book.words[:, :, 0])).sum(axis=1)
    assert there.max() <= 8
    assert there.min() >= 2  # rest and what was seen
    for votes in all_ways(book, tiled, samples):
        np.testing.assert_array_equal(votes.sum(axis=1), len(tiled.labels))
