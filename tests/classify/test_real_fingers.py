"""What a model of simulated touches says of real fingers on a real skin, and of nothing at all."""

from __future__ import annotations

import pytest

from benchmarks.classify.real_fingers import DATA, measure

pytestmark = pytest.mark.skipif(
    not (DATA / "fingers.npz").is_file(),
    reason="the CySkin recordings are not beside this checkout",
)


def test_one_real_finger_is_one_finger_and_nothing_is_nothing():
    found = measure()
    assert found["recordings_without_a_touch"] >= 20
    assert found["named_a_touch"] <= 0.05
    assert found["one_contact_of_one_finger"] >= 0.8
    # The control: samples before anybody touches say nothing.
    assert found["named_in_their_first_samples"] <= 0.1


def test_pads_of_fixed_sizes_do_not_carry_over():
    """The judge can fail: what the former simulator teaches is wrong here."""
    assert measure(variety=0.0)["one_contact_of_one_finger"] < 0.4
