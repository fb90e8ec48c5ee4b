"""The transformer over several patches, and what becomes of structures never seen."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from skinmap.classify.descriptors import choose_words
from skinmap.classify.intersection import IntersectionSVC
from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.neighbours.offsets import concatenate, neighbourhoods
from skinmap.neighbours.structures import assign, find_structures
from skinmap.touch.histogram import PatchSamples, StructureHistogram
from skinmap.touch.nearest_structure import adopt_nearest, coverage
from skinmap.touch.votes import histograms


def hoods_of(points):
    up = np.tile([0.0, 0, 1], (len(points), 1))
    return neighbourhoods(points, up, np.tile([0.0, 1, 0], (len(points), 1)), radius=8e-3)


@pytest.fixture(scope="module")
def patches(tiling_12):
    """Two patches of 12-pad modules of different size, with shared prototypes."""
    hoods = [hoods_of(tiling_12[:288]), hoods_of(tiling_12[288:432])]
    found = find_structures(concatenate(hoods), rotations=6)
    return [assign(one, found.prototypes) for one in hoods]


def press(points, structures, radius, rng):
    gap = np.linalg.norm(points - points[rng.integers(len(points))], axis=1)
    load = rng.uniform(0.5, 0.9) * np.exp(-0.5 * (gap / radius) ** 2)
    return PatchSamples(structures, np.where(load > 0.05, load, 0.0) * np.ones((3, 1)))


@pytest.fixture(scope="module")
def touches(tiling_12, patches):
    rng = np.random.default_rng(4)
    points = (tiling_12[:288], tiling_12[288:432])
    rows = [
        press(points[i % 2], patches[i % 2], radius, rng)
        for radius in (4e-3, 15e-3)
        for i in range(24)
    ]
    return rows, np.repeat(["small", "large"], 24)


def test_transform_gives_the_mean_votes_of_each_row(touches):
    rows, _ = touches
    model = StructureHistogram(words=6, random_state=0).fit(rows)
    table = model.transform(rows)
    assert table.shape == (48, model.codebook_.bins)
    assert len(model.get_feature_names_out()) == table.shape[1]
    for number in (0, 1, 30):
        one = rows[number]
        expected = histograms(model.codebook_, one.structures, one.samples).mean(axis=0)
        np.testing.assert_allclose(table[number], expected, rtol=1e-15)


def test_paper_mode_counts_rest_and_the_default_drops_it(touches, patches):
    rows, _ = touches
    rest = [PatchSamples(one, np.zeros((1, len(one.labels)))) for one in patches]
    dropped = StructureHistogram(random_state=0).fit(rows).transform(rest)
    assert dropped.sum() == 0
    literal = StructureHistogram(mode="paper", random_state=0).fit(rows).transform(rest)
    np.testing.assert_array_equal(literal.sum(axis=1), [288, 144])


def test_a_row_without_samples_is_all_zeros(touches, patches):
    rows, _ = touches
    model = StructureHistogram(random_state=0).fit(rows)
    assert not model.transform([PatchSamples(patches[0], np.zeros((0, 288)))]).any()


def test_it_works_in_a_pipeline_and_clones(touches):
    rows, labels = touches
    machine = make_pipeline(StructureHistogram(words=6, random_state=1), IntersectionSVC())
    same = clone(machine)
    first, second = machine.fit(rows[::2], labels[::2]), same.fit(rows[::2], labels[::2])
    assert first.score(rows[1::2], labels[1::2]) == 1.0  # 4 mm against 15 mm
    np.testing.assert_array_equal(first.predict(rows), second.predict(rows))


def test_unknown_modes_and_foreign_structures_are_refused(touches, tiling_12):
    rows, _ = touches
    with pytest.raises(InvalidArrayError, match="mode 'loud'; the modes are: rest-dropped, paper"):
        StructureHistogram(mode="loud").fit(rows)
    model = StructureHistogram(random_state=0).fit(rows)
    foreign = find_structures(hoods_of(tiling_12[:60]), rotations=1)
    with pytest.raises(SkinMismatchError, match="other prototypes"):
        model.transform([PatchSamples(foreign, np.zeros((1, 60)))])
    with pytest.raises(InvalidArrayError, match="share the same prototypes"):
        StructureHistogram().fit([rows[0], PatchSamples(foreign, np.ones((1, 60)))])


def test_choose_words_finds_that_one_touched_word_is_too_few(touches, rng):
    rows, labels = touches
    words, scores = choose_words(rows, labels, rng=rng, candidates=(2, 8))
    assert set(scores) == {2, 8}
    assert scores[words] >= max(scores.values()) - 0.1
    again, _ = choose_words(rows, labels, rng=np.random.default_rng(20), candidates=(8, 2))
    assert again == words  # the same seed, whatever the order asked for


def test_choose_words_keeps_events_together_and_refuses_too_few(touches, rng):
    rows, labels = touches
    groups = np.arange(48) // 6
    words, scores = choose_words(rows, labels, rng=rng, groups=groups, candidates=(4,))
    assert words == 4
    assert 0.0 <= scores[4] <= 1.0
    with pytest.raises(InvalidArrayError, match="two touches of each label, got 1"):
        choose_words(rows[:25], labels[:25], rng=rng)


def test_all_zero_training_gives_rest_alone_and_no_votes(patches, touches):
    rest = [PatchSamples(one, np.zeros((4, len(one.labels)))) for one in patches]
    model = StructureHistogram(random_state=0).fit(rest)
    assert not model.transform(touches[0]).any()


def test_taxels_of_unseen_structures_take_the_nearest_or_stay_out(tiling_12):
    flat = tiling_12[:144]
    known = find_structures(hoods_of(flat), rotations=6)
    # Stretched by a third: no neighbour is within the tolerance of its place.
    strange = hoods_of(flat * [1.35, 1.0, 1.0])
    matched = assign(strange, known.prototypes)
    adopted = adopt_nearest(strange, matched)
    told = coverage(matched, adopted)
    assert told.matched + told.nearest + told.skipped == 144
    assert told.nearest > 0
    assert told.skipped == 0
    before = matched.labels >= 0
    np.testing.assert_array_equal(adopted.labels[before], matched.labels[before])
    np.testing.assert_array_equal(coverage(matched, matched).skipped, np.count_nonzero(~before))


def test_adopting_undoes_a_forgotten_match(tiling_12):
    hoods = hoods_of(tiling_12[:144])
    known = find_structures(hoods, rotations=6)
    forgotten = type(known)(
        known.prototypes,
        np.full(144, -1),
        np.full_like(known.neighbours, -1),
        np.zeros(144, np.int64),
    )
    found = adopt_nearest(hoods, forgotten)
    # The nearest prototype of a taxel that matches one exactly is that one; a few on the edge
    # of the patch are as near to another.
    assert np.mean(found.labels == known.labels) > 0.95
    same = (found.labels == known.labels) & (found.rotation == known.rotation)
    agree = found.neighbours[same] == known.neighbours[same]
    assert agree.mean() > 0.99


def test_a_taxel_without_neighbours_stays_without_structure(tiling_12):
    known = find_structures(hoods_of(tiling_12[:144]), rotations=6)
    lonely = hoods_of(np.zeros((1, 3)))
    found = type(known)(
        known.prototypes,
        np.array([-1]),
        np.full((1, known.neighbours.shape[1]), -1),
        np.zeros(1, np.int64),
    )
    assert adopt_nearest(lonely, found).labels[0] == -1
