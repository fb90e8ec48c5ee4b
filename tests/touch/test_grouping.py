from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.contacts.grouping import GroupingRule, contacts_of_event, group_touches
from skinmap.touch.contacts.skin_geometry import measure_skin, pieces

WEST, EAST, NORTH = 50, 57, 134  # on the plate: 46 mm between west and east, 50 mm to the north


@pytest.fixture(scope="module")
def plate(hexagons):
    """Geometry of a flat skin of 168 taxels, pitch 6.5 mm."""
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    skin = skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))
    return measure_skin(build_surface(skin))


def event(geometry, *touches, samples=60):
    """Samples of discs of 7 taxels: (centre, begin, end, counts) each, in samples."""
    points = geometry.mesh.vertices
    played = np.zeros((samples, len(points)), np.uint8)
    for centre, begin, end, counts in touches:
        near = np.linalg.norm(points - points[centre], axis=1) < 7e-3
        played[begin:end, near] = counts
    return played


def sizes(groups) -> list[int]:
    return [int(mask.sum()) for mask in groups]


def test_contacts_that_begin_and_end_together_are_one_grip(plate):
    played = event(plate, (WEST, 10, 50, 100), (EAST, 12, 51, 200), (NORTH, 11, 49, 40))
    assert sizes(group_touches(plate, played)) == [21]


def test_contacts_that_begin_apart_are_separate(plate):
    # 10 samples are 0.2 s, the rule allows 0.08 s.
    played = event(plate, (WEST, 10, 50, 200), (EAST, 20, 50, 100))
    west, east = group_touches(plate, played)
    assert west[WEST]
    assert east[EAST]
    assert not (west & east).any()


def test_contacts_that_end_apart_are_separate_once_they_are_over(plate):
    played = event(plate, (WEST, 10, 60, 200), (EAST, 10, 40, 100))
    assert len(group_touches(plate, played)) == 2
    # While the first one lasts, nobody can know.
    assert len(group_touches(plate, played, ended=False)) == 1


def test_contacts_further_apart_than_a_hand_are_separate(plate):
    played = event(plate, (WEST, 10, 50, 200), (EAST, 10, 50, 100))
    # The rims of the discs are 45.5 - 2 * 6.5 = 32.5 mm apart.
    assert len(group_touches(plate, played, rule=GroupingRule(span=34e-3))) == 1
    assert len(group_touches(plate, played, rule=GroupingRule(span=32e-3))) == 2


def test_time_of_the_rule_counts_in_seconds(plate):
    played = event(plate, (WEST, 10, 50, 200), (EAST, 20, 60, 100), samples=70)
    assert len(group_touches(plate, played, rule=GroupingRule(rate=500.0))) == 1
    assert len(group_touches(plate, played, rule=GroupingRule(together=0.21))) == 1


def test_groups_come_with_the_heaviest_first(plate):
    played = event(plate, (WEST, 5, 30, 60), (EAST, 20, 60, 200))
    heavy, light = group_touches(plate, played)
    assert heavy[EAST]
    assert light[WEST]


def test_grouping_does_not_depend_on_strength(plate):
    # A ramp of 20 samples crosses the threshold of activity late where it is weak; its own half
    # is reached at the same time.
    ramp = np.clip(np.arange(60) / 20.0, 0, 1)
    played = event(plate, (WEST, 0, 60, 1), (EAST, 0, 60, 1)).astype(float) * ramp[:, None]
    played[:, :] *= np.where(plate.mesh.vertices[:, 0] < 0.035, 240.0, 30.0)
    assert len(group_touches(plate, np.rint(played).astype(np.uint8))) == 1


def test_a_contact_that_flickers_at_the_threshold_joins_the_nearest(plate):
    played = event(plate, (WEST, 10, 50, 200), (NORTH, 25, 40, 200))
    played[20:30:2, [EAST, EAST + 1]] = 14
    west, north = group_touches(plate, played)
    assert west[WEST]
    assert west[EAST]
    assert not north[EAST]


def test_a_taxel_alone_is_no_contact(plate):
    played = event(plate, (WEST, 10, 50, 200))
    played[:, EAST] = 60
    (mask,) = group_touches(plate, played)
    assert mask[WEST]
    assert not mask[EAST]


def test_what_flickers_before_and_after_a_touch_is_not_part_of_it(plate):
    played = event(plate, (WEST, 20, 40, 200), (EAST, 0, 60, 20))
    (mask,) = group_touches(plate, played)
    assert mask[WEST]
    assert not mask[EAST]
    together = event(plate, (WEST, 20, 40, 200), (EAST, 20, 40, 20))
    (mask,) = group_touches(plate, together)
    assert mask[EAST]


def test_a_ridge_broken_by_gains_is_one_touch(plate):
    """Pieces 13 mm apart land one after the other as a finger rolls on; at 46 mm they are two."""
    played = event(plate, (50, 5, 50, 200), (53, 25, 50, 200))
    assert len(group_touches(plate, played)) == 1
    far = event(plate, (50, 5, 50, 200), (57, 25, 50, 200))
    assert len(group_touches(plate, far)) == 2


def test_no_contact_is_no_touch(plate):
    assert group_touches(plate, np.full((20, len(plate)), 9, np.uint8)) == ()
    assert group_touches(plate, np.zeros((0, len(plate)), np.uint8)) == ()


def test_a_whole_skin_pressed_flat_is_one_touch(plate):
    (mask,) = group_touches(plate, np.full((20, len(plate)), 255, np.uint8))
    assert mask.all()


def test_contact_crosses_half_of_its_load_between_samples(plate):
    played = event(plate, (WEST, 10, 50, 100))
    played[9] = played[10] // 4
    (contact,) = contacts_of_event(plate, played)
    # From 25 to 100 counts half is crossed a third of a sample after sample 9.
    assert contact.begin == pytest.approx(9 + 1 / 3, abs=1e-6)
    assert contact.load == pytest.approx(700.0)


def test_group_touches_refuses_another_skin_and_what_is_no_number(plate):
    with pytest.raises(SkinMismatchError, match="3 pressures for the 168 taxels of 'skin'"):
        group_touches(plate, np.zeros((5, 3), np.uint8))
    bad = np.zeros((5, len(plate)))
    bad[2, 7] = np.nan
    with pytest.raises(InvalidArrayError, match="NaN or infinity, first at taxel 7"):
        group_touches(plate, bad)


@pytest.mark.parametrize("name", ["span", "together", "rate"])
def test_rule_refuses_what_makes_no_sense(name):
    with pytest.raises(InvalidArrayError, match=f"{name} must be finite and above 0, got -1"):
        GroupingRule(**{name: -1.0})


def test_pieces_agree_with_scipy(rng):
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    for links in (0, 20, 60, 120):
        pairs = rng.integers(0, 80, (links, 2))
        both = np.concatenate([pairs, pairs[:, ::-1]])
        ours = pieces(both[:, 0], both[:, 1], 80)
        graph = coo_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(80, 80))
        count, theirs = connected_components(graph, directed=False)
        assert ours.max() + 1 == count
        assert len(set(zip(ours.tolist(), theirs.tolist(), strict=True))) == count
