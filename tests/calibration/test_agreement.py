"""Who contradicts whom: the jury's rule on misses that are given, without a fit."""

from itertools import combinations
from types import SimpleNamespace

import pytest

from calibration.mount.skin_contacts import Jury

# Two recordings that contradict each other are missed by this much when fitted together [m].
CLASH, ALONE, SENSE = 20e-3, 2e-3, 40e-3


def jury(clashes=(), *, links=(), alone=None, off=None, order=SENSE) -> Jury:
    """A jury over recordings named by letters; `links` are the pairs that share an unknown."""
    own = alone or {}

    def missed(some):
        names = [one.recording.name for one in some]
        found = {name: own.get(name, ALONE) for name in names}
        for pair in combinations(names, 2):
            if set(pair) in clashes:
                found |= dict.fromkeys(pair, CLASH)
        return found, max([(off or {}).get(name, 0.0) for name in names], default=0.0)

    def shared(one, other):
        return int({one.recording.name, other.recording.name} in links)

    floor = dict.fromkeys("abcdef", 3e-3)
    return Jury(missed, lambda one: order, shared, floor)


def named(names: str):
    return [SimpleNamespace(recording=SimpleNamespace(name=name)) for name in names]


def test_recordings_that_agree_are_all_kept():
    found = jury().agreement(named("abcd"))
    assert (found.inconsistent, found.told) == ((), True)


@pytest.mark.parametrize("wrong", "abcd")
def test_the_one_without_which_the_rest_agree_is_named(wrong):
    clashes = [{wrong, other} for other in "abcd" if other != wrong]
    found = jury(clashes).agreement(named("abcd"))
    assert (found.inconsistent, found.told) == ((wrong,), True)


def test_two_wrong_ones_of_five_are_named():
    clashes = [{one, other} for one in "de" for other in "abcde" if one != other]
    found = jury(clashes).agreement(named("abcde"))
    assert (set(found.inconsistent), found.told) == ({"d", "e"}, True)


def test_the_one_that_nothing_else_confirms_is_named():
    """c contradicts b alone; without b it would agree with a, with which it shares nothing."""
    found = jury([{"b", "c"}], links=[{"a", "b"}, {"b", "c"}]).agreement(named("abc"))
    assert (found.inconsistent, found.told) == (("c",), True)


def test_where_either_may_be_wrong_both_are_named_and_none_is_told():
    """Two recordings of one finger whose tips differ: a third one knows of neither."""
    found = jury([{"b", "c"}], links=[{"b", "c"}]).agreement(named("abc"))
    assert (set(found.inconsistent), found.told) == ({"b", "c"}, False)


def test_of_two_none_is_told():
    assert jury().agreement(named("ab")).inconsistent == ()
    found = jury([{"a", "b"}]).agreement(named("ab"))
    assert (found.inconsistent, found.told) == (("a", "b"), False)
    found = jury(alone={"b": 30e-3}).agreement(named("ab"))
    assert (found.inconsistent, found.told, found.senseless) == (("a", "b"), False, ("b",))


def test_one_that_cannot_explain_itself_is_named_though_it_agrees():
    found = jury(alone={"b": 30e-3}).agreement(named("abc"))
    assert (found.inconsistent, found.told, found.senseless) == (("b",), True, ("b",))
    # Missed by much more than the others alone, though poses in another order miss more still.
    found = jury(alone={"b": 15e-3}).agreement(named("abc"))
    assert (found.inconsistent, found.senseless) == (("b",), ())


def test_zeros_further_off_than_joints_are_count_as_a_contradiction():
    found = jury(off={"c": 1.5}).agreement(named("abc"))
    assert (found.inconsistent, found.told, found.strained) == (("c",), True, ("c",))
    assert jury(off={"c": 0.9}).agreement(named("abc")).inconsistent == ()


def test_a_single_recording_is_held_against_its_own_poses_in_another_order():
    assert jury().agreement(named("a")).inconsistent == ()
    found = jury(order=2.5e-3).agreement(named("a"))
    assert (found.inconsistent, found.told, found.senseless) == (("a",), False, ("a",))


def test_misses_below_half_a_pitch_blame_nobody():
    found = jury(alone={"b": 2.9e-3, "a": 0.5e-3, "c": 0.5e-3}).agreement(named("abc"))
    assert found.inconsistent == ()
