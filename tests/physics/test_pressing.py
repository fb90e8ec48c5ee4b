"""MuJoCo on a bed of springs: forces add up, places are where one presses, bodies differ."""

import numpy as np
import pytest

from skinmap.physics.bodies import PRESSERS, Mount, Piece, Presser
from skinmap.physics.pressing import (
    Pressed,
    SpringBed,
    mount_frame,
    press,
    secant_stiffness,
)
from skinmap.physics.simulation import place_at
from skinmap.physics.variants import VARIANTS
from skinmap.skin.skin import skin_from_points

pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

SOFTNESS = {"foam": 4e7, "flesh": 2.6e7}  # [Pa/m]


@pytest.fixture(scope="module")
def plane() -> SpringBed:
    steps = np.arange(-0.0975, 0.098, 6.5e-3)
    points = np.array([(x, y, 0.0) for x in steps for y in steps])
    return SpringBed(skin_from_points(points, np.tile([0.0, 0.0, 1.0], (len(points), 1))))


def pressed(bed: SpringBed, presser: Presser, *, friction: float = 0.0) -> Pressed:
    frames = np.array(
        [
            mount_frame(np.array([*mount.spot, 0.0]), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))
            for mount in presser.mounts
        ]
    )
    course = np.clip(np.arange(450) / 75.0, 0.0, 1.0)[:, None] * np.ones(len(frames))
    return press(bed, presser, frames, **SOFTNESS, course=course, friction=friction)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("name", ["poke", "full_finger", "three_finger", "whole_hand", "forearm"])
def test_press_springs_carry_the_contact_force(
    plane: SpringBed, name: str, friction: float
) -> None:
    presser = PRESSERS[name](np.random.default_rng(5), 0.9, VARIANTS["finger"])
    found = pressed(plane, presser, friction=friction)
    held = slice(-8, None)
    # At rest; what is left is the speed of a tremor-free settling.
    np.testing.assert_allclose(found.loads[held].sum(axis=1), found.forces[held], rtol=0.1)
    pushed = sum(mount.force for mount in presser.mounts)
    assert found.forces[-1] > 0.9 * pushed  # and more where flesh is held from two sides


def test_press_flat_ball_pushes_straight_with_the_force_of_the_arm(plane: SpringBed) -> None:
    presser = PRESSERS["ball"](np.random.default_rng(0), 0.9, VARIANTS["finger"])
    found = pressed(plane, presser)
    # A large ball on a plane meets nearly upright springs: contact force = arm's force.
    np.testing.assert_allclose(found.forces[-1], presser.mounts[0].force, rtol=0.03)
    np.testing.assert_allclose(found.centres[-1, :2], 0.0, atol=0.5e-3)


def test_press_moves_with_its_mount(plane: SpringBed) -> None:
    piece = PRESSERS["poke"](np.random.default_rng(0), 0.9, VARIANTS["finger"]).mounts[0].piece
    tip = Piece((piece.flesh[0],))
    for spot in ((0.03, -0.02), (-0.041, 0.013)):
        found = pressed(plane, Presser((Mount(spot, tip, 3.0),), np.zeros((1, 2))))
        # A leaning finger pulls its centre of pressure back along x by some millimetres.
        np.testing.assert_allclose(found.centres[-1, :2], spot, atol=4e-3)


def test_press_nothing_there_gives_nothing(plane: SpringBed) -> None:
    presser = PRESSERS["poke"](np.random.default_rng(0), 0.9, VARIANTS["finger"])
    frame = mount_frame(np.array([0.5, 0, 0]), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))
    found = press(plane, presser, frame[None], **SOFTNESS, course=np.ones((100, 1)))
    assert not found.forces.any()
    assert np.isnan(found.centres).all()


def test_secant_stiffness_starts_as_asked_and_stiffens() -> None:
    found = secant_stiffness(np.array([0.0, 3e-3, 6e-3, 9e-3]), np.full(4, 100.0))
    np.testing.assert_allclose(found[0], 100.0)
    assert (np.diff(found[:3]) > 0).all()
    assert found[2] == found[3]  # the impedance ends at HARD


def test_spread_keeps_the_force(plane: SpringBed) -> None:
    middle = int(np.argmin(np.linalg.norm(plane.places, axis=1)))
    pressure = plane.spread(2.4e-3)[:, [middle]].toarray()[:, 0]
    # Pressure times the area of a taxel, summed, is the newton that was put in. The lattice of
    # 6.5 mm samples a Gaussian of 2.6 mm: its first two waves, each exp(-2 (pi 2.6 / 6.5)^2) twice,
    # may add up to 17 %.
    np.testing.assert_allclose(pressure.sum() * 6.5e-3**2, 1.0, atol=0.17)


def test_place_at_measures_how_much_lies_on_the_skin(plane: SpringBed) -> None:
    presser = PRESSERS["full_finger"](np.random.default_rng(0), 0.9, VARIANTS["finger"])
    points = plane.skin.positions
    middle = int(np.argmin(np.linalg.norm(points, axis=1)))
    corner = int(np.argmin(points.sum(axis=1)))
    inside, outside = (place_at(plane, presser, taxel, 0.3) for taxel in (middle, corner))
    assert inside is not None
    assert outside is not None
    assert inside[1] == 1.0
    assert outside[1] < 0.8
