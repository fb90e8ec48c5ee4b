from __future__ import annotations

import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score

from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import plane_turns
from skinmap.neighbours.offsets import concatenate, lattice_phase, neighbourhoods
from skinmap.neighbours.structures import assign, find_structures


def flat_hoods(points, turn=0.0, radius=8e-3):
    up = np.tile([0.0, 0, 1], (len(points), 1))
    reference = np.tile([-np.sin(turn), np.cos(turn), 0], (len(points), 1))
    return neighbourhoods(points, up, reference, radius=radius)


def test_12_pad_tiling_has_4_structures_with_rotation(tiling_12):
    found = find_structures(flat_hoods(tiling_12), rotations=6)
    assert len(found.prototypes) == 4
    assert found.counts.sum() == len(tiling_12)


def test_12_pad_tiling_has_16_structures_without_rotation(tiling_12):
    assert len(find_structures(flat_hoods(tiling_12), rotations=1).prototypes) == 16


def test_structures_agree_with_counting_neighbours_of_a_lattice(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    found = find_structures(flat_hoods(points), rotations=6)
    neighbours = flat_hoods(points).filled.sum(axis=1)
    # Inside, every taxel of a hexagonal lattice has the same six neighbours.
    assert len(set(found.labels[neighbours == 6])) == 1
    assert found.counts[0] == (neighbours == 6).sum()


@pytest.mark.parametrize("scale", [0.3, 0.15])
def test_a_finer_layout_has_the_structures_of_the_usual_one(tiling_12, scale):
    usual = find_structures(flat_hoods(tiling_12), rotations=1)
    finer = flat_hoods(scale * tiling_12, radius=scale * 8e-3)
    found = find_structures(finer, rotations=1)
    assert len(found.prototypes) == 16
    assert adjusted_rand_score(usual.labels, found.labels) == 1.0
    # The tolerance of the usual pitch merges shapes that differ.
    assert len(find_structures(finer, rotations=1, tolerance=1.5e-3).prototypes) < 16


def test_labels_do_not_change_with_small_noise(tiling_12, rng):
    quiet = find_structures(flat_hoods(tiling_12), rotations=6)
    noise = rng.normal(scale=1e-4, size=tiling_12.shape) * [1, 1, 0]
    noisy = find_structures(flat_hoods(tiling_12 + noise), rotations=6)
    assert adjusted_rand_score(quiet.labels, noisy.labels) == 1.0


def test_structures_with_rotation_ignore_turns_by_pi_over_3(tiling_12):
    one = find_structures(flat_hoods(tiling_12), rotations=6)
    other = assign(flat_hoods(tiling_12, turn=np.pi / 3), one.prototypes)
    np.testing.assert_array_equal(one.labels, other.labels)
    assert set((other.rotation - one.rotation) % 6) <= {1, 5}


def test_members_inherit_the_order_of_their_prototype(tiling_12):
    found = find_structures(flat_hoods(tiling_12), rotations=1)
    for taxel in range(0, len(tiling_12), 37):
        shape = found.prototypes.offsets[found.labels[taxel]]
        for place, other in enumerate(found.neighbours[taxel]):
            if other >= 0:
                step = (tiling_12[other] - tiling_12[taxel])[:2]
                np.testing.assert_allclose(step, shape[place], atol=1.5e-3)


def test_prototypes_run_clockwise_from_twelve(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    found = find_structures(flat_hoods(points), rotations=1)
    offsets = found.prototypes.offsets[0][found.prototypes.filled[0]]
    angle = np.mod(np.arctan2(offsets[:, 0], offsets[:, 1]), 2 * np.pi)
    assert (np.diff(angle) > 0).all()


def test_soft_radius_makes_neighbours_at_the_radius_optional():
    line = np.array([[0.0, 0, 0], [7.9e-3, 0, 0], [5e-3, 0, 0]])
    hoods = flat_hoods(line)
    assert hoods.filled[0].sum() == 2
    assert hoods.required[0].sum() == 1


def test_offsets_keep_their_length_on_a_bend():
    angle = np.linspace(0, 1, 5)
    points = 0.02 * np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    normals = points / 0.02
    hoods = neighbourhoods(points, normals, np.tile([0.0, 1, 0], (5, 1)), radius=8e-3)
    length = np.linalg.norm(hoods.offsets, axis=2)[hoods.filled]
    straight = np.linalg.norm(points[hoods.index] - points[:, None], axis=2)[hoods.filled]
    np.testing.assert_allclose(length, straight, rtol=1e-12)


def test_concatenate_numbers_skins_one_after_another(tiling_12):
    hoods = flat_hoods(tiling_12[:24])
    both = concatenate([hoods, hoods])
    np.testing.assert_array_equal(both.index[24:][both.filled[24:]], hoods.index[hoods.filled] + 24)


def test_lattice_phase_finds_a_planted_turn(hexagons):
    angle = 0.3
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    assert lattice_phase(hexagons @ turn) == pytest.approx(0.3, abs=1e-9)


def test_a_lattice_that_lies_across_turns_to_one_side_whatever_its_error(hexagons):
    for error in (-1e-3, 0.0, 1e-3):
        turn = plane_turns(np.pi / 6 + error).T
        assert lattice_phase(hexagons @ turn) == pytest.approx(np.pi / 6 + error, abs=1e-9)


def test_unknown_shapes_get_no_structure(tiling_12, hexagons):
    found = find_structures(flat_hoods(tiling_12[:24]), rotations=6)
    square = np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) * 3e-3
    grid = np.column_stack([square, np.zeros(25)])
    assert (assign(flat_hoods(grid), found.prototypes).labels == -1).all()


def test_icub_structures_stay_below_the_prototypes_counts(prepared):
    # The prototype's soft radius gave at most these without rotation, and fewer with it.
    for part, most in (("right_arm", 49), ("right_leg_upper", 39), ("torso", 97)):
        hoods = prepared(part).hoods
        plain = len(find_structures(hoods, rotations=1).prototypes)
        assert plain <= most
        assert len(find_structures(hoods, rotations=6).prototypes) < plain


@pytest.mark.parametrize(("tolerance", "rotations"), [(0.0, 1), (-1.0, 1), (1e-3, 0), (1e-3, 5)])
def test_find_structures_refuses_nonsense(tiling_12, tolerance, rotations):
    with pytest.raises(InvalidArrayError, match="above 0"):
        find_structures(flat_hoods(tiling_12[:12]), tolerance=tolerance, rotations=rotations)
