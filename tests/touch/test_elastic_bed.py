from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.skin.skin import skin_from_points
from skinmap.touch.simulation.elastic_bed import (
    FIRM,
    NODE_WEIGHTS,
    NODES,
    Foam,
    bed_loads,
    contact_width,
    curvature_at,
    sunk_in,
)
from skinmap.touch.simulation.gestures import GESTURES
from skinmap.touch.simulation.hands import HANDS, Body, Draw, full_finger, oblique, whole_hand
from skinmap.touch.simulation.simulator import (
    loads_over_time,
    place,
    prepare,
    simulate,
    simulate_pairs,
)
from skinmap.touch.simulation.variety import (
    Sensing,
    Sensors,
    draw_sensing,
    draw_subjects,
    happens,
    uses_pads,
    variety_of,
)

FLAT = np.zeros((2, 2))
K = 2e7


def ball(force=2.0, radius=8e-3, **more):
    return Body((0.0, 0.0), (0.0, 0.0), radius, 0.0, force, 1e12, **more)


@pytest.fixture(scope="module")
def dense():
    """A flat skin of taxels 1 mm apart."""
    axis = np.arange(-30, 31) * 1e-3
    x, y = np.meshgrid(axis, axis)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))


def test_nodes_average_a_gaussian():
    """The rule is exact for polynomials of degree 5 and radial ones of degree 6."""
    assert NODE_WEIGHTS.sum() == pytest.approx(1.0)
    squared = (NODES**2).sum(axis=1)
    for power, moment in ((1, 2.0), (2, 8.0), (3, 48.0)):
        assert NODE_WEIGHTS @ squared**power == pytest.approx(moment)
    np.testing.assert_allclose(NODE_WEIGHTS @ NODES, 0.0, atol=1e-12)


@pytest.mark.parametrize("force", [0.1, 0.4])
def test_a_ball_sinks_in_as_a_winkler_bed_says(force):
    """F = pi k R d^2 while the contact is narrow beside the ball (Johnson 1985, 4.3)."""
    body = ball(force, radius=40e-3)
    expected = np.sqrt(force / (np.pi * K * body.radius))
    # 33 x 17 places: a rim of a cell's half, 3 % of the depth.
    assert sunk_in(body, FLAT, K) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("stiffness", [1e7, 8e7])
@pytest.mark.parametrize("name", ["ball", "bar"])
def test_pressures_add_up_to_the_force(dense, name, stiffness):
    body = ball(3.0)
    if name == "bar":
        body = Body((-15e-3, 0.0), (15e-3, 0.0), 8e-3, 5.0, 4.0, 1e12)
    uv = dense.positions[:, :2]
    (load,) = bed_loads([body], Foam(stiffness, 1.5e-3), uv, dense)
    assert load.sum() * 1e-6 * FIRM == pytest.approx(body.force, rel=0.05)


def test_contacts_widen_with_force_bluntness_and_softness():
    base = contact_width(ball(1.0), 4e7)
    assert contact_width(ball(4.0), 4e7) > 1.2 * base
    assert contact_width(ball(1.0, radius=16e-3), 4e7) > 1.1 * base
    assert contact_width(ball(1.0), 1e7) > 1.2 * base


def test_a_bent_skin_is_touched_on_less_of_it(dense):
    body = ball(2.0)
    flat = sunk_in(body, FLAT, K)
    convex = sunk_in(body, np.diag([30.0, 30.0]), K)
    hollow = sunk_in(body, np.diag([-30.0, -30.0]), K)
    assert hollow < flat < convex


def test_curvature_of_a_cylinder_is_found():
    radius = 40e-3
    angle, along = np.meshgrid(np.linspace(-0.5, 0.5, 15), np.linspace(-20e-3, 20e-3, 15))
    a, z = angle.ravel(), along.ravel()
    points = np.column_stack([radius * np.sin(a), z, radius * np.cos(a)])
    normals = np.column_stack([np.sin(a), np.zeros_like(a), np.cos(a)])
    skin = skin_from_points(points, normals)
    uv = np.column_stack([radius * a, z])
    found = curvature_at(np.zeros(2), uv, skin, np.arange(len(uv)))
    np.testing.assert_allclose(found, np.diag([1 / radius, 0.0]), atol=0.5)


def test_a_joint_follows_the_bend_along_its_axis():
    from skinmap.touch.simulation.elastic_bed import followed

    bend = np.diag([25.0, 10.0])
    bar = Body((-1e-2, 0.0), (1e-2, 0.0), 8e-3, 0.0, 1.0, K, follows=1.0)
    np.testing.assert_allclose(followed(bar, bend), np.diag([0.0, 10.0]), atol=1e-12)


def test_an_oblique_fingertip_lies_on_longer_and_its_force_is_the_same(dense):
    straight, uv = ball(3.0), dense.positions[:, :2]
    straight = replace(straight, stiffness=3e7)
    for seed in range(5):
        (leant,) = oblique([straight], np.random.default_rng(seed))
        rise = float(np.hypot(*leant.lean))
        assert np.tan(np.radians(10.0)) <= rise <= np.tan(np.radians(35.0))
        pair, foam = (straight, leant), Foam(4e7, 1.5e-3)
        before, after = (bed_loads([one], foam, uv, dense)[0] for one in pair)
        assert after.sum() * 1e-6 * FIRM == pytest.approx(3.0, rel=0.05)
        # It sinks in where it is lowest, against its lean.
        centre = after @ uv / after.sum() - before @ uv / before.sum()
        assert centre @ np.array(leant.lean) < -1e-3 * rise


def test_a_hand_that_leans_presses_harder_in_front():
    pieces = [replace(ball(1.0), start=(x, 0.0), end=(x, 0.0)) for x in (-0.03, 0.03)]
    leant = oblique(pieces, np.random.default_rng(0))
    assert sum(one.force for one in leant) == pytest.approx(2.0)
    low = int(np.argmin([np.dot(one.middle, one.lean) for one in leant]))
    assert leant[low].force > 1.1 * leant[1 - low].force


def test_a_touch_that_rolls_ends_elsewhere(icub):
    skin = icub.skin("torso")
    stage = prepare(skin, rng=np.random.default_rng(0), variety=2.0)
    (person,) = draw_subjects(1, rng=np.random.default_rng(0))
    rng = np.random.default_rng(1)
    found = [place(stage, "poke", person, rng=rng) for _ in range(60)]
    rolled_ones = [one for one in found if one is not None and one.rolled is not None]
    assert 4 < len(rolled_ones) < 30  # 40 % of those that are not pads
    for one in rolled_ones[:5]:
        course = loads_over_time(one, 50.0, np.random.default_rng(2))
        centres = [row @ skin.positions / row.sum() for row in (one.loads[0], one.rolled[0])]
        own = [row @ skin.positions / row.sum() for row in (course[len(course) // 4], course[-6])]
        step = centres[1] - centres[0]
        assert 0.0 < np.linalg.norm(step) < 8e-3
        assert (own[1] - own[0]) @ step > 0.0


def test_wide_has_none_of_what_is_rarer(icub):
    stage = prepare(icub.skin("torso"), rng=np.random.default_rng(0), variety=1.0)
    (person,) = draw_subjects(1, rng=np.random.default_rng(0))
    rng = np.random.default_rng(1)
    assert not any(place(stage, "poke", person, rng=rng).rolled is not None for _ in range(20))
    rng, before = np.random.default_rng(2), np.random.default_rng(2).bit_generator.state
    assert not happens(1.0, 1.0, rng)
    assert rng.bit_generator.state == before
    assert draw_sensing(1.0, rng=rng).compression == 0.0


def test_air_presses_evenly():
    hard = sunk_in(ball(2.0, radius=80e-3), FLAT, 1e8)
    soft = sunk_in(ball(2.0, radius=80e-3, ceiling=8e3), FLAT, 1e8)
    assert soft > hard


def test_hands_press_as_real_ones_do():
    """No hand of 69 N: the sum of all pieces is what a person of usual strength presses with."""
    rng = np.random.default_rng(0)
    for name, low, high in (("poke", 0.8, 6), ("three_finger", 2, 12), ("whole_hand", 5, 30)):
        forces = [sum(body.force for body in HANDS[name](Draw(rng, 1.0, 0.9))) for _ in range(200)]
        assert low <= min(forces) <= max(forces) <= high * 1.0001
        assert max(forces) / min(forces) > 3.0


def test_a_hand_is_islands_and_a_finger_phalanges():
    rng = np.random.default_rng(1)
    hands = [len(whole_hand(Draw(rng, 1.0, 0.9))) for _ in range(100)]
    assert np.median(hands) > 8
    assert len(set(hands)) > 5
    assert {len(full_finger(Draw(rng, 1.0, 0.9))) for _ in range(100)} == {1, 2, 3}
    assert set(HANDS) == set(GESTURES)


# Made by the simulator before bodies and faults were known to it; the same to the last bit.
FORMER = {
    "anywhere": "3ff7056161918d88",
    "habitual": "878260f331e63f11",
    "pairs": "10020c23faa83db9",
}


def test_without_variety_the_former_simulator_answers_to_the_last_bit(icub):
    arm, torso = icub.skin("right_forearm"), icub.skin("torso")
    some = ("poke", "elbow", "edge", "whole_hand")
    made = {
        "anywhere": simulate(arm, rng=np.random.default_rng(5), per_gesture=3, variety=0.0),
        "habitual": simulate(
            torso,
            rng=np.random.default_rng(6),
            per_gesture=2,
            gestures=some,
            places="habitual",
            variety=0.0,
        ),
        "pairs": simulate_pairs(torso, rng=np.random.default_rng(7), count=3, variety=0.0),
    }
    found = {
        name: hashlib.sha256(one.pressures.tobytes()).hexdigest()[:16] for name, one in made.items()
    }
    assert found == FORMER


def test_variety_is_a_word_or_a_number():
    assert [variety_of(word) for word in ("none", "wide", "wider", "0.25")] == [0, 1, 2, 0.25]
    with pytest.raises(UnknownNameError, match="no variety level 'wild'"):
        variety_of("wild")
    for wrong in ("nan", "2.5", "-0.1"):
        with pytest.raises(InvalidArrayError, match=r"variety must lie in 0\.\.2"):
            variety_of(wrong)


def test_none_draws_nothing():
    rng = np.random.default_rng(3)
    before = rng.bit_generator.state
    assert draw_sensing(0.0, rng=rng) == Sensing()
    assert uses_pads(0.0, rng)
    assert rng.bit_generator.state == before


def test_varied_touches_are_smaller_and_rougher(icub):
    skin = icub.skin("left_leg_upper")
    size = {}
    for variety in (0.0, 1.0):
        made = simulate(
            skin,
            rng=np.random.default_rng(2),
            per_gesture=8,
            gestures=["whole_hand"],
            variety=variety,
        )
        size[variety] = np.median([(s.mean(axis=0) > 12).sum() for _, _, s in made.touches()])
    assert size[1.0] < 0.8 * size[0.0]


def read(skin, loads, rng, **how):
    sensors = Sensors(skin, Sensing(noise=0.0, drift=0.0, gain_spread=0.0, **how), rng=rng)
    return sensors, sensors.read(loads, rng=rng).astype(float)


def test_faults_of_sensors_do_what_they_say(dense, rng):
    n = len(dense)
    step = np.zeros((120, n))
    step[20:80] = 0.5
    _, clean = read(dense, step, rng)
    np.testing.assert_array_equal(clean[79], 80.0)
    _, creeping = read(dense, step, rng, creep=0.2)
    assert 80 < creeping[25, 0] < creeping[60, 0] < creeping[79, 0] <= 96
    ramp = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)])[:, None] * np.ones(n)
    _, loop = read(dense, ramp, rng, hysteresis=0.2)
    assert loop[75, 0] > loop[24, 0] + 6  # the same load, on the way down and up
    sensors, spiky = read(dense, np.zeros((50, n)), rng, spikes=1e-3)
    assert 0.0005 < (spiky > 0).mean() < 0.0015
    assert spiky.max() <= 30
    sensors, hanging = read(dense, np.zeros((5, n)), rng, stuck=0.02)
    assert 0 < len(sensors.stuck) < 0.06 * n
    np.testing.assert_array_equal(hanging[0] > 0, np.isin(np.arange(n), sensors.stuck))
    assert (hanging[0] == hanging[4]).all()
    lonely = np.zeros((3, n))
    lonely[:, 7] = 1.0
    _, talking = read(dense, lonely, rng, cross_talk=0.5)
    assert talking[0, 7] > 100
    full = np.ones((3, n)) * [[0.5], [1.0], [1.4]]
    _, pressed = read(dense, full, rng, compression=0.5)
    np.testing.assert_allclose(pressed[:, 0], [96, 160, 198], atol=1.0)  # 1.5 L / (1 + L / 2)
    lost = Sensors(dense, Sensing(gaps=0.2), rng=rng).lost(5000, rng=rng)
    assert 0.1 < lost.mean() < 0.3


def test_unplaced_modules_are_silent(icub, rng):
    skin = icub.skin("torso")
    sensors = Sensors(skin, Sensing(unplaced=0.3), rng=rng)
    silent = {int(m) for m in np.unique(skin.modules) if sensors.dead[skin.modules == m].all()}
    assert 0 < len(silent) < len(np.unique(skin.modules))
    assert set(skin.modules[sensors.dead].tolist()) == silent


@pytest.mark.parametrize("wrong", [{"stuck": 2}, {"spikes": -1}, {"gaps": 0.9}, {"creep": np.nan}])
def test_impossible_faults_are_refused(wrong):
    with pytest.raises(InvalidArrayError, match=next(iter(wrong))):
        Sensing(**wrong)
