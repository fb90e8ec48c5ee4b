"""Simulated self-touch of the iCub, whose skins press into each other: planted truth and faults."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import skinmap
from benchmarks.calibration.self_touch_rows import world
from calibration.commands.self_touch_words import judge, notes_of
from calibration.files.self_touch_files import SelfTouchData, load_part_touches
from calibration.mount.chains import robot_chain
from calibration.mount.skin_contacts import self_touch
from skinmap.arrays import FloatArray
from skinmap.io.robots.urdf import UrdfBody
from skinmap.skin.robot import Robot

NAO = Path(__file__).parents[3] / "shared" / "data" / "nao"
PROBES = Path(__file__).with_name("nao_probes.toml")
BASE, TURNS = "base", "continuous"
FINGER, LEFT, RIGHT, HAND = "right_finger", "left_forearm", "right_forearm", "right_hand"
PAIRS = ((RIGHT, LEFT), (FINGER, LEFT), (HAND, LEFT), (FINGER, LEFT))
NAMES = ("forearms", "finger", "hand", "finger again")
UNKNOWN = (LEFT, RIGHT)
WHOLE = os.environ.get("SUITE") == "whole"  # in `make soak`


@cache
def made(seed: int, count: int):
    """A world with `count` recordings of 60 touches, each with a name."""
    rng = np.random.default_rng([seed, 5])
    found = world(skinmap.load_robot("icub"), PAIRS[:count], UNKNOWN, rng, touches=60)
    named = [replace(one, name=name) for one, name in zip(found.recordings, NAMES, strict=False)]
    return replace(found, recordings=named)


def fitted(data):
    return self_touch(
        data.recordings, data.chains, calibrate=UNKNOWN, joint_offsets=True,
        rng=np.random.default_rng(0),
    )  # fmt: skip


@cache
def honest(seed: int, count: int):
    """The fit of a world as it was made."""
    return fitted(made(seed, count).data())


def with_fault(data, name: str, fault: str, rng):
    """The data with one recording that does not belong to the others."""
    (row,) = [k for k, one in enumerate(data.recordings) if one.name == name]
    one = data.recordings[row]
    angles = one.angles.copy()
    if fault == "shifted time":
        angles = np.roll(angles, 1, axis=0)
    if fault == "wrong columns":
        first, second = data.joints.index("l_elbow"), data.joints.index("l_shoulder_roll")
        angles[:, [first, second]] = angles[:, [second, first]]
    if fault == "another robot":  # whose joints have other zeros, and whose angles mean others
        angles = angles * rng.uniform(0.7, 1.3, angles.shape[1]) + rng.normal(0, 0.2, len(angles.T))
    every = list(data.recordings)
    every[row] = replace(one, angles=angles)
    return replace(data, recordings=every)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("seed", "count"), [(0, 3), (1, 3), (2, 3), (0, 4), *([(1, 4), (2, 4)] if WHOLE else [])]
)
def test_honest_recordings_are_never_left_out(seed, count):
    fit = honest(seed, count)
    assert fit.inconsistent == fit.dropped == ()
    # Together they are missed by hardly more than alone.
    for name, alone in fit.agreement.alone.items():
        assert fit.medians[name] < 1.35 * alone


@pytest.mark.parametrize(
    ("seed", "name", "count", "fault"),
    [(0, "finger", 3, "shifted time"), (0, "forearms", 3, "another robot"),
     (1, "hand", 4, "wrong columns")],
)  # fmt: skip
def test_the_one_that_contradicts_is_named_and_left_out(seed, name, count, fault):
    data = with_fault(made(seed, count).data(), name, fault, np.random.default_rng(seed))
    fit = fitted(data)
    assert fit.dropped == fit.inconsistent == (name,)
    assert not [one for one in judge(data, fit, ()) if "contradict" in one[1]]
    assert any(note.startswith(f"{name} was left out") for note in notes_of(data, fit, ()))


def test_a_patch_that_was_elsewhere_in_one_recording_is_named():
    """A hand whose patch is not where it is assumed: only zeros far off could explain that."""
    world = made(1, 4)
    data = world.data()
    hand = data.chains[HAND]
    T = np.eye(4)
    T[:3, 3] = [0.012, -0.012, 0.01]
    moved = replace(data, chains=data.chains | {HAND: replace(hand, mount=T)})
    fit = fitted(moved)
    assert fit.dropped == ("hand",)
    assert fit.agreement.strained == ("hand",)


def test_of_two_that_contradict_each_other_none_is_left_out():
    data = with_fault(made(2, 2).data(), "finger", "wrong columns", np.random.default_rng(0))
    fit = fitted(data)
    assert set(fit.inconsistent) == {"forearms", "finger"}
    assert fit.dropped == ()
    status, reason = judge(data, fit, ())[0]
    assert status == "ambiguous"
    assert "of two the wrong one is unknown" in reason


@pytest.mark.parametrize("seed", range(3))
def test_planted_mounts_come_back_within_twice_the_stated_error(seed):
    from benchmarks.calibration.self_touch_rows import _errors

    world, fit = made(seed, 3), honest(seed, 3)
    for name in UNKNOWN:
        missed, stated, _ = _errors(world.bodies[name].chain, fit)
        assert np.median(missed) < min(2e-3, 2 * np.median(stated))  # of 20 mm planted


def test_touches_with_the_poses_of_others_are_not_ok(rng):
    data = made(0, 3).data()
    mixed = [replace(one, angles=rng.permutation(one.angles)) for one in data.recordings]
    wrong = replace(data, recordings=mixed)
    fit = fitted(wrong)
    assert set(fit.agreement.senseless) == {one.name for one in mixed}
    assert judge(wrong, fit, ())[0][0] == "ambiguous"


def test_a_corner_alone_is_not_ok():
    from benchmarks.calibration.self_touch_rows import cornered

    world = made(2, 2)
    lone = [cornered(world, world.recordings[1])]
    data = replace(world.data(), recordings=lone)
    fit = self_touch(
        lone, data.chains, calibrate=(LEFT,), joint_offsets=True, rng=np.random.default_rng(0)
    )
    assert judge(data, fit, ())[0][0] in ("unobservable", "low_coverage")


def test_a_zero_that_equals_a_turn_of_the_mount_is_said():
    """The last joint of an arm and the first of its patch's mount are one motion."""
    data, fit = made(0, 3).data(), honest(0, 3)
    column = data.joints.index("l_wrist_prosup")
    assert fit.unobserved.joints[column] == LEFT
    words = "the zero of l_wrist_prosup cannot be determined: it equals a move of left_forearm"
    assert words in notes_of(data, fit, ())
    # What stands between skins and moves is told.
    assert data.joints.index("l_shoulder_roll") not in fit.unobserved.joints


def test_a_joint_that_hardly_moves_is_asked_for():
    world = made(0, 3)
    data = world.data()
    column = data.joints.index("l_elbow")
    spread = [one.angles[:, column] for one in data.recordings]
    middle = float(np.median(np.concatenate(spread)))
    near = [one.subset(np.abs(own - middle) < np.deg2rad(4)) for one, own in
            zip(data.recordings, spread, strict=True)]  # fmt: skip
    some = replace(data, recordings=[one for one in near if len(one) > 5])
    fit = self_touch(
        some.recordings, some.chains, calibrate=(LEFT,), joint_offsets=True,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert any("l_elbow moved by" in note for note in notes_of(some, fit, ()))


def as_urdf(data: SelfTouchData, folder: Path, urdf: Path) -> SelfTouchData:
    """The same, with chains from a URDF that is written from the rows in `folder`."""
    text, moving = ['<robot name="rows">', f'<link name="{BASE}"/>'], set[str]()
    for part in dict.fromkeys(data.links.values()):
        with np.load(folder / f"part_{part}.npz") as arrays:
            names = [data.joints[column] for column in arrays["joint_cols"].tolist()]
            text += _branch(part, arrays["dh"], names)
            moving |= set(names)
    for joint in sorted(set(data.joints) - moving):  # of arms that touch nothing
        text += [f'<link name="{joint}_end"/>', _joint(joint, TURNS, BASE, f"{joint}_end", "", "")]
    urdf.write_text("\n".join([*text, "</robot>"]))
    robot = Robot("rows", UrdfBody(urdf), {})
    chains = {}
    for name, chain in data.chains.items():
        own = robot_chain(robot, f"{data.links[name]}_end", data.joints, base=BASE, name=name)
        chains[name] = replace(
            own, mount=chain.mount, taxels=chain.taxels, normals=chain.normals, radius=chain.radius
        )
    return replace(data, chains=chains)


def _branch(part: str, dh: FloatArray, joints: list[str]) -> Iterator[str]:
    """Links and joints of one part: a turn about z for each row that moves, then what is fixed."""
    parent, fixed = BASE, len(dh) - len(joints)
    for row, (a, d, alpha, offset) in enumerate(dh):
        if row >= fixed:
            turned = f"{part}_{row}_turned"
            yield f'<link name="{turned}"/>'
            yield _joint(joints[row - fixed], TURNS, parent, turned, "", "")
            parent = turned
        child = f"{part}_{row}"
        turn = Rotation.from_euler("z", offset) * Rotation.from_euler("x", alpha)
        place = np.array([a * np.cos(offset), a * np.sin(offset), d])
        yield f'<link name="{child}"/>'
        xyz, rpy = (" ".join(map(repr, v.tolist())) for v in (place, turn.as_euler("xyz")))
        yield _joint(f"{child}_fixed", "fixed", parent, child, xyz, rpy)
        parent = child
    yield f'<link name="{part}_end"/>'
    yield _joint(f"{part}_end_fixed", "fixed", parent, f"{part}_end", "", "")


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: str) -> str:
    origin = f'<origin xyz="{xyz or "0 0 0"}" rpy="{rpy or "0 0 0"}"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{origin}<axis xyz="0 0 1"/></joint>'


@pytest.mark.skipif(not NAO.is_dir(), reason="no NAO recordings beside the checkout")
def test_a_real_robots_chains_from_rows_and_from_a_urdf_give_the_same(tmp_path):
    data = load_part_touches([NAO], PROBES)
    other = as_urdf(data, NAO, tmp_path / "rows.urdf")
    skins = [name for name, chain in data.chains.items() if not chain.is_probe]
    for name, chain in data.chains.items():
        angles = data.recordings[0].angles
        np.testing.assert_allclose(
            other.chains[name].frames(angles), chain.frames(angles), rtol=0, atol=1e-9
        )
    one, two = (
        self_touch(d.recordings, d.chains, calibrate=skins, rng=np.random.default_rng(0))
        for d in (data, other)
    )
    assert one.held_out <= 4.98e-3  # what chains from rows alone had reached
    np.testing.assert_allclose(two.held_out, one.held_out, rtol=1e-4)
    assert one.inconsistent == two.inconsistent == ()
