"""Presses on a flat surface: planted mounts come back, and what cannot be told is said."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.special import expit

from calibration import Chain, Plane, PlaneContacts, fit_plane, robot_chain
from calibration.commands import calibrate
from calibration.commands.plane import read_planes
from calibration.files.mount_files import read_plane_evidence
from calibration.plane.model import PlaneProblem, patch_of
from calibration.plane.poses import candidates, pressing, pressing_poses
from calibration.plane.solve import first_states
from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.geometry.rigid import tangent_frames, transform_points
from skinmap.io.robots.manifest import load_robot
from skinmap.io.taxels.taxel_table import read_taxels

PART, LINK = "right_forearm", "r_forearm"
JOINTS = (
    "torso_pitch", "torso_roll", "torso_yaw", "r_shoulder_pitch", "r_shoulder_roll",
    "r_shoulder_yaw", "r_elbow", "r_wrist_prosup",
)  # fmt: skip
TABLE = Plane([-0.2, 0.2, -0.05], [0.05, -0.1, 1.0])


@pytest.fixture(scope="module")
def robot():
    return load_robot("icub")


@pytest.fixture(scope="module")
def chain(robot) -> Chain:
    return robot_chain(robot, LINK, JOINTS, name=PART, taxels=robot.skin(PART).positions)


@pytest.fixture(scope="module")
def limits(robot):
    return np.array([robot.body.joints[joint] for joint in JOINTS])


def planted(chain: Chain, rng) -> np.ndarray:
    """A mount 20 mm and 10 degrees off, about the middle of the patch."""
    from scipy.spatial.transform import Rotation

    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    middle, T = chain.taxels.mean(axis=0), np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.deg2rad(10) * axis).as_matrix()
    T[:3, 3] = middle - T[:3, :3] @ middle + 0.02 * way
    return T


def mounted(chain: Chain, mount) -> Chain:
    return replace(chain, mount=mount)


def presses(robot, chain, limits, mount, count, rng, *, offsets=None, taxel=0.5e-3, contact=0.5e-3):
    """Presses whose taxels answer below a sharp height that strays: no logistic curve."""
    true, found = mounted(chain, mount), np.zeros((0, 8))
    while len(found) < count:
        found = np.concatenate([
            found,
            pressing_poses(true, robot.skin(PART).normals, TABLE, limits, depth=3e-3, count=400,
                           rng=rng),
        ])  # fmt: skip
    found = found[:count]
    T = true.frames(found) @ mount
    x = np.einsum("mij,nj->mni", T[:, :3, :3], chain.taxels) + T[:, None, :3, 3]
    s = TABLE.height(x) + rng.normal(0, contact, (count, 1)) + rng.normal(0, taxel, x.shape[:2])
    read = found if offsets is None else found - offsets
    return PlaneContacts(read, {PART: s < 0})


def pressed_at(chain, mount, angles, offsets, rng) -> PlaneContacts:
    """Presses in given poses: the elbow moves until the lowest taxel is 3 mm deep."""
    read, rows = angles.copy(), np.arange(len(angles))
    for _ in range(20):
        T, axes, origins = chain.motion(read, offsets)
        T = T @ mount
        x = np.einsum("mij,nj->mni", T[:, :3, :3], chain.taxels) + T[:, None, :3, 3]
        s = TABLE.height(x)
        lowest = s.argmin(axis=1)
        slope = chain.slopes(axes, origins, x[rows, lowest])[6] @ TABLE.normal
        read[:, 6] += np.clip((-3e-3 - s[rows, lowest]) / slope, -0.05, 0.05)
    s = s + rng.normal(0, 5e-4, s.shape) + rng.normal(0, 5e-4, (len(s), 1))
    good = (s < 0).any(axis=1) & (np.abs(s.min(axis=1) + 3e-3) < 3e-3)
    return PlaneContacts(read[good], {PART: s[good] < 0})


@pytest.fixture(scope="module")
def case(robot, chain, limits):
    """Forty presses, the mount that they were made with and the joints' zeros."""
    rng = np.random.default_rng(11)
    mount, offsets = planted(chain, rng), rng.normal(0, np.deg2rad(0.5), 8)
    return presses(robot, chain, limits, mount, 40, rng, offsets=offsets), mount, offsets


@pytest.fixture(scope="module")
def fit(case, chain, robot):
    return fit_plane(case[0], [chain], modules={PART: robot.skin(PART).modules}, joint_names=JOINTS)


def test_a_planted_mount_comes_back_within_its_predicted_error(fit, case, chain):
    _, mount, _ = case
    error = fit.places[PART] - transform_points(mount, chain.taxels)
    # 20 mm off at the start. Three predicted errors: one trial's taxels err together.
    assert np.linalg.norm(error, axis=1).max() < 3.0 * fit.predicted_sd(PART).max()
    assert np.percentile(np.linalg.norm(error, axis=1), 95) < 3e-3
    covariance = fit.place_covariances[PART]
    squares = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert squares.mean() / 3 < 4.0  # of six numbers, 95 % lie below 2.1 a freedom
    assert fit.status == "ok", fit.reasons
    plane = fit.planes[0]
    assert np.rad2deg(np.arccos(plane.normal @ TABLE.normal)) < 2.5
    assert len(fit.assumed) == 3
    assert "r_wrist_prosup" in fit.assumed[0]
    assert "torso_pitch" in fit.assumed[1]


def test_poses_of_other_presses_are_not_called_ok(case, chain):
    """The control: the same taxels with the poses of other presses."""
    contacts = case[0]
    wrong = replace(contacts, angles=np.random.default_rng(1).permutation(contacts.angles))
    assert fit_plane(wrong, [chain]).status != "ok"


def test_few_presses_are_unobservable(case, chain):
    for count in (5, 10):
        found = fit_plane(case[0].subset(np.arange(count)), [chain])
        assert found.status == "unobservable"
        assert "limit 3 mm" in found.reasons[0]


def test_presses_with_one_side_only_are_unobservable(case, robot, chain, limits):
    """Forty presses round one pose tell no more than a few."""
    contacts, mount, offsets = case
    rng = np.random.default_rng(3)
    base = contacts.angles[:1] + rng.normal(0, 0.02, (40, 8))
    one_place = pressed_at(chain, mount, base, offsets, rng)
    found = fit_plane(one_place, [chain])
    assert found.status == "unobservable", found.reasons


def test_joints_that_are_further_off_than_assumed_are_named(case, chain):
    """Zeros 2.5 degrees off pull the mount along: its stated error would be too small."""
    contacts, _, _ = case
    off = np.deg2rad(2.5) * np.array([-1.0, 1, -1, 1, -1, 1, -1, 1])
    read = replace(contacts, angles=contacts.angles - off)
    found = fit_plane(read, [chain])
    assert found.status == "ambiguous", found.reasons
    assert any("calibrate the joints first" in reason for reason in found.reasons)


def test_a_known_plane_tells_more(case, chain, fit):
    names = np.array(JOINTS)  # as an archive has them
    known = fit_plane(case[0], [chain], planes=[TABLE], joint_names=names)
    assert "r_wrist_prosup" in known.assumed[0]
    assert known.predicted_sd(PART).mean() < fit.predicted_sd(PART).mean() + 0.1e-3
    assert "given plane" in known.assumed[1]
    away = Plane(TABLE.point, -TABLE.normal)
    other = fit_plane(case[0], [chain], planes=[away])
    np.testing.assert_allclose(other.mounts[PART], known.mounts[PART], rtol=0, atol=1e-5)


def flat_pad(count: int, rng) -> tuple[Chain, PlaneContacts]:
    """A flat pad on a slide, pressed on z = 0 with normals that all lie in one plane."""
    places = 8e-3 * (np.stack(np.meshgrid(range(6), range(4)), axis=-1).reshape(-1, 2) - [2.5, 1.5])
    pad = Chain(
        "pad", np.tile(np.eye(4), (3, 1, 1)), [[0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0]],
        [True, False, False], np.arange(3), np.ones(3), np.zeros(3),
        taxels=np.column_stack([places, np.full(len(places), -0.1)]),
    )  # fmt: skip
    angles = np.column_stack([np.zeros((count, 2)), rng.uniform(-0.8, 0.8, count)])
    T = pad.frames(angles)
    height = np.einsum("mj,nj->mn", T[:, 2, :3], pad.taxels)
    angles[:, 0] = -rng.uniform(1.5e-3, 4e-3, count) - height.min(axis=1)
    noise = rng.normal(0.0, 5e-4, height.shape)
    return pad, PlaneContacts(angles, {"pad": height + angles[:, :1] + noise < 0})


@pytest.mark.parametrize("further", [False, True])
def test_a_rival_is_looked_for_with_a_known_plane_and_from_an_earlier_fit(further):
    """The mirror image of a flat pad fits as well as the pad: cost for cost, 24 mm away."""
    pad, contacts = flat_pad(12, np.random.default_rng(0))
    table = [Plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])]
    before = None
    if further:
        before = fit_plane(contacts.subset(np.arange(8)), [pad], planes=table)
    found = fit_plane(contacts, [pad], planes=table, previous=before)
    (words,) = [reason for reason in found.reasons if "another place fits as well" in reason]
    assert 15.0 < float(words.split("as well, ")[1].split(" mm")[0]) < 35.0


def test_the_system_is_the_slope_of_the_evidence(case, chain):
    """Scores against differences of the log likelihood, in every kind of unknown."""
    contacts = case[0].subset(np.arange(6))
    problem = PlaneProblem(contacts, {PART: patch_of(chain, np.arange(240) // 10)}, 0.01)
    layout, state = problem.layout(), first_states(problem, None)[0]
    state.tau = 4e-3
    system = problem.system(state, layout)
    for column in [0, 2, 4, *range(6, 9), *layout.joint.values(), layout.tau, layout.depth[1],
                   layout.shift[PART].flat[40], layout.height[PART][100]]:  # fmt: skip
        step = np.zeros(layout.count)
        step[column] = 1e-6
        up, down = (
            problem.evidence_cost(problem.moved(state, layout, sign * step)) for sign in (1, -1)
        )
        slope = -(up - down) / 2e-6
        assert system.slope[column] == pytest.approx(slope, rel=1e-4, abs=1e-2), column
    scores = problem.contact_scores(state, layout).sum(axis=0)
    np.testing.assert_allclose(scores, system.slope, rtol=1e-9, atol=1e-9 * abs(scores).max())


def null_share(system, direction) -> float:
    """Information along a direction against what it would be were its parts independent."""
    parts = direction**2 @ np.diag(system.normal)
    return float(direction @ system.normal @ direction / parts)


def test_the_exact_nulls_are_nulls(case, chain):
    """Directions that no contact can tell, and one beside each that it can."""
    problem = PlaneProblem(case[0], {PART: patch_of(chain)}, 0.01)
    layout, state = problem.layout(), first_states(problem, [TABLE])[0]
    problem = replace(problem, tilting=True)
    layout, state.tau = problem.layout(), 2e-3
    system = problem.system(state, layout)
    T, axes, origins = chain.motion(case[0].angles)
    # The zero of the last joint against the mount, turned back about the joint's axis.
    axis = T[0, :3, :3].T @ axes[-1, 0]
    origin = T[0, :3, :3].T @ (origins[-1, 0] - T[0, :3, 3])
    null = np.zeros(layout.count)
    null[layout.joint[7]] = 1.0
    null[:3] = -axis
    null[3:6] = -np.cross(axis, state.mounts[PART][:3, 3] - origin)
    assert null_share(system, null) < 1e-12
    null[:6] *= -1  # turned on instead of back: felt
    assert null_share(system, null) > 1e-3
    # The zero of the first joint against the plane, turned with it.
    null = np.zeros(layout.count)
    null[layout.joint[0]] = 1.0
    axis, origin = axes[0, 0], origins[0, 0]
    turned = np.cross(axis, state.normals[0])
    u, v = tangent_frames(state.normals[0])
    null[layout.plane + 1 : layout.plane + 3] = turned @ u, turned @ v
    null[layout.plane] = np.cross(axis, state.points[0] - origin) @ state.normals[0]
    assert null_share(system, null) < 1e-12
    # All press depths against the height of the plane.
    null = np.zeros(layout.count)
    null[layout.plane], null[layout.depth] = 1.0, -1.0
    assert null_share(system, null) < 1e-12
    null[layout.plane] = -1.0
    assert null_share(system, null) > 1e-3


def test_contradicting_presses_are_named_and_the_rest_are_right(case, chain, robot):
    contacts, mount, _ = case
    angles = contacts.angles.copy()
    angles[[4, 17]] = angles[[17, 4]]
    wrong = replace(contacts, angles=angles)
    named = fit_plane(wrong, [chain])
    assert named.status == "ambiguous"
    assert set(named.inconsistent) & {4, 17}
    assert "counted from 0" in named.reasons[0]
    good = np.delete(np.arange(len(wrong)), named.inconsistent)
    rest = PlaneContacts(wrong.angles[good], {PART: wrong.active[PART][good]})
    left = fit_plane(rest, [chain])
    assert left.status == "ok"
    error = left.places[PART] - transform_points(mount, chain.taxels)
    assert np.percentile(np.linalg.norm(error, axis=1), 95) < 4e-3


def test_stuck_and_dead_taxels_are_left_out(case, chain, fit):
    contacts = case[0]
    felt = contacts.active[PART].copy()
    often = int(felt.sum(axis=0).argmax())
    never = int(np.flatnonzero(felt.sum(axis=0) == 0)[0])
    felt[:, often], felt[:, never] = False, True
    found = fit_plane(replace(contacts, active={PART: felt}), [chain])
    assert never in found.stuck[PART]
    assert often in found.dead[PART]
    apart = np.linalg.norm(found.places[PART] - fit.places[PART], axis=1)
    assert apart.max() < 2.0 * fit.predicted_sd(PART).max()


def test_a_large_contact_over_seldom_pressed_dead_taxels_contradicts_nobody(robot, chain, limits):
    """A large contact meets several taxels that are dead; too few presses show that they are."""
    rng = np.random.default_rng(2)
    mount = planted(chain, rng)
    contacts = presses(robot, chain, limits, mount, 40, rng, taxel=0.1e-3)
    felt = contacts.active[PART].copy()
    largest = int(felt.sum(axis=1).argmax())
    seldom = np.flatnonzero(felt[largest] & (felt.sum(axis=0) <= 2))[:3]
    assert len(seldom) == 3
    felt[:, seldom] = False
    found = fit_plane(replace(contacts, active={PART: felt}), [chain])
    assert found.inconsistent == ()
    felt[largest] = contacts.active[PART][(largest + 1) % 40]
    found = fit_plane(replace(contacts, active={PART: felt}), [chain])
    assert found.inconsistent == (largest,)


def test_two_surfaces_are_two_planes(case, chain, robot, limits):
    rng = np.random.default_rng(5)
    contacts, mount, offsets = case
    more = presses(robot, chain, limits, mount, 40, rng, offsets=offsets)
    both = contacts.joined(replace(more, surface=np.ones(40, int)))
    found = fit_plane(both, [chain])
    assert len(found.planes) == 2
    for plane in found.planes:
        assert np.rad2deg(np.arccos(plane.normal @ TABLE.normal)) < 2.5
    error = found.places[PART] - transform_points(mount, chain.taxels)
    assert np.percentile(np.linalg.norm(error, axis=1), 95) < 3e-3


def test_a_press_that_two_patches_feel_counts_for_both(case, chain):
    """The forearm's taxels as two patches of one link: nearly what one patch gives."""
    contacts, mount, _ = case
    halves = np.arange(240) < 120
    patches, active = [], {}
    for name, half in (("first", halves), ("second", ~halves)):
        patches.append(replace(chain, name=name, taxels=chain.taxels[half]))
        active[name] = contacts.active[PART][:, half]
    felt = np.any([one.any(axis=1) for one in active.values()], axis=0)
    whole = PlaneContacts(contacts.angles, active).subset(felt)
    found = fit_plane(whole, patches)
    for name, half in (("first", halves), ("second", ~halves)):
        error = found.places[name] - transform_points(mount, chain.taxels[half])
        assert np.linalg.norm(error, axis=1).mean() < 3.0 * found.predicted_sd(name).mean()


def test_next_lowers_the_error_as_expected(case, chain, robot, limits, fit):
    """What was expected of eight proposed presses, and what they bring, against eight at random."""
    contacts, mount, offsets = case
    few = contacts.subset(np.arange(16))
    start = fit_plane(few, [chain])
    setup = pressing(robot, [PART], JOINTS, few)
    pool = candidates(setup, few, start.mounts, start.planes, np.random.default_rng(0))
    best = start.next_contacts(pool, 8)
    assert (np.diff(best.sd) < 0).all()
    rms = np.sqrt(np.mean(start.predicted_sd(PART) ** 2))
    assert best.sd[-1] < 0.8 * rms

    rng, sds = np.random.default_rng(9), {}
    for kind, rows in (("chosen", best.rows), ("random", rng.permutation(len(pool))[:8])):
        new = pressed_at(chain, mount, pool.angles[rows], offsets, rng)
        assert len(new) >= 6
        after = fit_plane(few.joined(new), [chain])
        sds[kind] = np.sqrt(np.mean(after.predicted_sd(PART) ** 2))
    assert sds["chosen"] < sds["random"]


def test_proposed_poses_keep_limits_and_the_arm_off_the_table(case, robot, fit):
    contacts = case[0]
    setup = pressing(robot, [PART], JOINTS, contacts)
    names = {one.chain.name for one in setup.obstacles}
    assert {"r_hand", "r_upper_arm", "chest"} <= names
    pool = candidates(setup, contacts, fit.mounts, fit.planes, np.random.default_rng(0))
    assert len(pool) > 20
    assert (pool.angles >= setup.limits[:, 0]).all()
    assert (pool.angles <= setup.limits[:, 1]).all()
    plane = fit.planes[0]
    for one in setup.obstacles:
        if (one.height(contacts.angles, plane) > 0).all():  # clear so far, and so it stays
            assert (one.height(pool.angles, plane) > 0).all(), one.chain.name
    T = setup.chains[PART].frames(pool.angles) @ fit.mounts[PART]
    x = np.einsum("mij,nj->mni", T[:, :3, :3], setup.chains[PART].taxels) + T[:, None, :3, 3]
    np.testing.assert_allclose(plane.height(x).min(axis=1), -2.5e-3, rtol=0, atol=0.3e-3)


def test_readings_that_mean_nothing_weigh_little():
    """The likelihood against its own formula, far from the surface."""
    from calibration.plane.model import SENSELESS, weigh

    z = np.array([-40.0, -2.0, 0.0, 3.0, 40.0])
    _, _, loss = weigh(z, np.ones(5, bool))
    expected = -np.log(SENSELESS + (1 - 2 * SENSELESS) * expit(z))
    np.testing.assert_allclose(loss, expected, rtol=1e-12)
    assert loss.max() < 4.7


def test_wrong_arrays_are_named(case, chain):
    contacts = case[0]
    with pytest.raises(InvalidArrayError, match="3 contacts, at least 4"):
        fit_plane(contacts.subset(np.arange(3)), [chain])
    silent = contacts.active[PART].copy()
    silent[[2, 5]] = False
    with pytest.raises(InvalidArrayError, match="active in 2 of 40 contacts: 2, 5"):
        fit_plane(replace(contacts, active={PART: silent}), [chain])
    with pytest.raises(UnknownNameError, match="the only patch is right_forearm"):
        fit_plane(PlaneContacts(contacts.angles, {"leg": silent}), [chain])
    with pytest.raises(InvalidArrayError, match="which has 240"):
        fit_plane(PlaneContacts(contacts.angles, {PART: silent[:, :200]}), [chain])
    with pytest.raises(InvalidArrayError, match="needs column 7"):
        fit_plane(replace(contacts, angles=contacts.angles[:, :6]), [chain])
    with pytest.raises(InvalidArrayError, match="no contact comes near the plane"):
        fit_plane(contacts, [chain], planes=[Plane([0, 0, -200.0], [0, 0, 1])])
    with pytest.raises(InvalidArrayError, match="1 planes for contacts on 2 surfaces"):
        fit_plane(replace(contacts, surface=np.arange(40) % 2), [chain], planes=[TABLE])
    with pytest.raises(InvalidArrayError, match="no contact on surface 1, but on surface 2"):
        fit_plane(replace(contacts, surface=2 * (np.arange(40) % 2)), [chain])
    with pytest.raises(InvalidArrayError, match="joint_sigma must be above 0"):
        fit_plane(contacts, [chain], joint_sigma=0.0)
    angles = contacts.angles.copy()
    angles[3, 1] = np.nan
    with pytest.raises(InvalidArrayError, match="angles"):
        PlaneContacts(angles, contacts.active)
    with pytest.raises(InvalidArrayError, match="true or false"):
        PlaneContacts(contacts.angles, {PART: silent.astype(float)})
    with pytest.raises(InvalidArrayError, match="no length"):
        Plane([0, 0, 0], [0, 0, 0])


def arrays_of(contacts: PlaneContacts, robot) -> dict:
    felt, channels = contacts.active[PART], robot.skin(PART).channels
    return {
        "joints": np.array(JOINTS),
        "angles": contacts.angles,
        f"ids_{PART}": np.concatenate([channels[np.flatnonzero(row)] for row in felt]),
        f"ptr_{PART}": np.cumsum([0, *felt.sum(axis=1)]),
    }


def test_files_give_back_what_was_saved(case, robot, tmp_path):
    contacts, path = case[0], tmp_path / "presses.npz"
    plain = arrays_of(contacts, robot)
    live = np.zeros((40, 384), bool)
    live[:, robot.skin(PART).channels] = contacts.active[PART]
    rest = {name: plain[name] for name in ("joints", "angles")}
    for arrays in (
        plain,
        rest | {f"active_{PART}": live},
        rest | {f"active_{PART}": contacts.active[PART].astype(np.uint8)},
    ):
        np.savez(path, **arrays)
        found = read_plane_evidence([path], robot)
        assert found.joints == JOINTS
        np.testing.assert_array_equal(found.contacts.active[PART], contacts.active[PART])
        np.testing.assert_array_equal(found.contacts.angles, contacts.angles)
    # Another file may have its joints in another order.
    other = tmp_path / "more.npz"
    np.savez(
        other, **plain | {"joints": np.array(JOINTS[::-1]), "angles": contacts.angles[:, ::-1]}
    )
    both = read_plane_evidence([path, other], robot)
    np.testing.assert_array_equal(both.contacts.angles[40:], contacts.angles)


def test_a_recording_with_joint_angles_gives_its_presses(case, robot, tmp_path):
    from skinmap.io.mcap.writing import McapRecording

    contacts, skin, path = case[0], robot.skin(PART), tmp_path / "table.mcap"
    file = McapRecording(
        path, parts=[PART], widths={"pressure": [len(skin)]}, rate=50.0, skins={PART: skin}
    )
    for sample, row in enumerate(np.repeat(np.arange(6), 4)):
        values = np.zeros(len(skin))
        values[contacts.active[PART][row]] = 60.0 * (sample % 4 in (1, 2))
        file.add("pressure", 0.02 * sample, values)
        file.add_angles(0.02 * sample, dict(zip(JOINTS, contacts.angles[row], strict=True)))
    file.close()
    found = read_plane_evidence([path], robot, [PART])
    assert set(found.joints) == set(JOINTS)
    order = [found.joints.index(joint) for joint in JOINTS]
    np.testing.assert_allclose(found.contacts.angles[:, order], contacts.angles[:6], atol=1e-9)
    np.testing.assert_array_equal(found.contacts.active[PART], contacts.active[PART][:6])


def test_a_recording_without_joint_angles_is_refused(robot, tmp_path):
    from skinmap.io.mcap.writing import McapRecording

    path = tmp_path / "plain.mcap"
    file = McapRecording(path, parts=[PART], widths={"pressure": [240]}, rate=50.0)
    file.add("pressure", 0.0, np.full(240, 50.0))
    file.close()
    with pytest.raises(DataFormatError, match="holds no joint angles"):
        read_plane_evidence([path], robot)


def test_damaged_files_are_named(case, robot, tmp_path):
    plain, path = arrays_of(case[0], robot), tmp_path / "presses.npz"

    def read(**changes):
        np.savez(path, **{k: v for k, v in (plain | changes).items() if v is not None})
        return read_plane_evidence([path], robot)

    with pytest.raises(MissingFileError, match=r"gone\.npz"):
        read_plane_evidence([tmp_path / "gone.npz"], robot)
    with pytest.raises(DataFormatError, match="lacks 'angles'; the arrays are: joints"):
        read(angles=None)
    with pytest.raises(
        UnknownNameError,
        match=r"no joint 'knee'; did you mean 'r_knee'\? The joints are: .*r_elbow",
    ):
        read(joints=np.array(["knee", *JOINTS[1:]]))
    with pytest.raises(DataFormatError, match=r"look like degrees .*multiply them by pi / 180"):
        read(angles=np.rad2deg(plain["angles"]))
    far = plain["angles"].copy()
    far[7, 6] = 9.0
    with pytest.raises(DataFormatError, match=r"r_elbow at press 7 is 9 rad, its limits are"):
        read(angles=far)
    far[7, 6] = np.nan
    with pytest.raises(DataFormatError, match="angles"):
        read(angles=far)
    ids = plain[f"ids_{PART}"].copy()
    ids[0] = 6  # a thermal pad
    with pytest.raises(DataFormatError, match="press 0: channel 6 is not a taxel of right_forearm"):
        read(**{f"ids_{PART}": ids})
    with pytest.raises(DataFormatError, match=r"ptr_right_forearm must rise from 0"):
        read(**{f"ptr_{PART}": plain[f"ptr_{PART}"][:-1]})
    with pytest.raises(DataFormatError, match="lacks ptr_right_forearm"):
        read(**{f"ptr_{PART}": None})
    with pytest.raises(DataFormatError, match="239 columns, expected 240 taxels or a live vector"):
        read(**{f"ids_{PART}": None, f"active_{PART}": case[0].active[PART][:, :-1]})
    with pytest.raises(UnknownNameError, match="no part 'tail'"):
        read(active_tail=case[0].active[PART])
    read()
    with pytest.raises(DataFormatError, match="does not speak of 'torso'"):
        read_plane_evidence([path], robot, ["torso"])
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(DataFormatError, match="not presses on a flat surface"):
        read_plane_evidence([path], robot)


def test_planes_are_read_from_six_numbers():
    assert read_planes(()) is None
    (plane,) = read_planes(["0,0,0.1, 0,0,2"])
    np.testing.assert_allclose(plane.normal, [0, 0, 1])
    for text in ("0,0,1", "a,b,c,d,e,f", "0,0,nan,0,0,1"):
        with pytest.raises(InvalidArrayError, match="six numbers"):
            read_planes([text])


def run(*words, code=0):
    result = CliRunner().invoke(calibrate, [*map(str, words), "--json"])
    assert result.exit_code == code, (result.output, result.exception)
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def saved(case, robot, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("table") / "presses.npz"
    np.savez(path, **arrays_of(case[0], robot))
    return path


def test_plane_writes_mounts_taxels_and_a_report(saved, case, chain, tmp_path):
    out = tmp_path / "out"
    result = run("plane", saved, "--part", PART, "-o", out)
    assert result["status"] == "ok"
    assert result["files"] == ["mounts.json", f"taxels_{PART}.csv", "report.html"]
    table = read_taxels(out / f"taxels_{PART}.csv")
    places = transform_points(case[1], chain.taxels)
    assert np.percentile(np.linalg.norm(table.positions - places, axis=1), 95) < 3e-3
    assert len(result["next"]) == 3
    first = result["next"][0]
    assert set(first["joints_deg"]) == set(JOINTS)
    assert first["expected_sd_mm"] > result["next"][2]["expected_sd_mm"]
    mounts = json.loads((out / "mounts.json").read_text())
    np.testing.assert_allclose(mounts["mounts"][PART], result["mounts"][PART], atol=1e-6)
    assert (out / "report.html").read_text().count("data:image/png;base64,") == 1


def test_plane_refuses_what_it_cannot_tell(case, robot, tmp_path):
    path, out = tmp_path / "few.npz", tmp_path / "out"
    np.savez(path, **arrays_of(case[0].subset(np.arange(8)), robot))
    words = ("plane", path, "-o", out)
    result = run(*words, code=3)
    assert result["status"] == "unobservable"
    assert result["files"] == ["refused.html"]
    assert len(result["next"]) == 3  # presses that would tell it
    again = run(*words, "--accept")
    assert "mounts.json" in again["files"]
    assert {**again, "seconds": 0, "files": []} == {**result, "seconds": 0, "files": []}


def test_joints_before_the_first_that_is_told_stood_still(case, robot, chain, limits, tmp_path):
    """A torso that was not recorded, at zero or not, changes the unknown plane only."""
    rng = np.random.default_rng(4)
    mount, held = case[1], limits.copy()
    held[:3] = np.array([[0.1], [-0.05], [0.2]])
    whole = presses(robot, chain, held, mount, 40, rng)
    arm = arrays_of(whole, robot)
    np.savez(tmp_path / "arm.npz", **arm | {"joints": arm["joints"][3:],
                                            "angles": arm["angles"][:, 3:]})  # fmt: skip
    np.savez(tmp_path / "all.npz", **arm)
    found = {name: run("plane", tmp_path / f"{name}.npz", "--accept") for name in ("arm", "all")}
    assert "torso_pitch, torso_roll, torso_yaw have no angles" in found["arm"]["assumed"][-1]
    assert set(found["arm"]["next"][0]["joints_deg"]) == set(JOINTS[3:])
    # Told or not, the torso's own zeros (prior 0.5 degrees) are all that differs.
    apart = transform_points(np.array(found["arm"]["mounts"][PART]), chain.taxels)
    apart -= transform_points(np.array(found["all"]["mounts"][PART]), chain.taxels)
    assert np.linalg.norm(apart, axis=1).max() < 1.5e-3
    gap = [0, 1, 2, 3, 4, 6, 7]
    less = {"joints": arm["joints"][gap], "angles": arm["angles"][:, gap]}
    np.savez(tmp_path / "gap.npz", **arm | less)
    result = CliRunner().invoke(calibrate, ["plane", str(tmp_path / "gap.npz")])
    assert "passes joints whose angles are not given: r_shoulder_yaw" in str(result.exception)


def test_plane_prints_for_people(saved):
    result = CliRunner().invoke(calibrate, ["plane", str(saved), "--plane", "0,0,-0.05,0,0,1"])
    assert result.exit_code in (0, 3), result.output
    assert "right_forearm: 40 contacts" in result.stdout
    assert "next 1: torso_pitch" in result.stdout
    assert "mm expected (rms)" in result.stdout
