"""Self-touch: planted mounts, tips and joint offsets of a small robot come back."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from calibration import self_touch
from calibration.commands import calibrate
from calibration.files.self_touch_files import load_part_touches
from calibration.mount.chain_fit import side_of
from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.skin_contacts import taxel_covariance
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.geometry.rigid import transform_points
from skinmap.io.taxels.taxel_table import read_taxels

PITCH, REACH = 6.5e-3, 12e-3  # of the taxels, and how far from the contact they answer [m]
ARM = np.array(
    [[0, 0.1, -np.pi / 2, 0], [0, 0, np.pi / 2, 0], [0.02, 0.12, -np.pi / 2, 0],
     [0, 0, np.pi / 2, 0], [0, 0.1, -np.pi / 2, 0], [0.03, 0, 0.3, 0]]
)  # fmt: skip


def pose(rotvec, translation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix()
    T[:3, 3] = translation
    return T


def bent_sheet(radius: float, size: int = 14) -> np.ndarray:
    """Taxels on a piece of a cylinder."""
    u, v = (PITCH * (k - size / 2) for k in np.meshgrid(*[np.arange(size)] * 2))
    places = [radius * np.sin(u / radius), v, radius * (np.cos(u / radius) - 1)]
    return np.stack(places, axis=-1).reshape(-1, 3)


def robot() -> dict[str, Chain]:
    """An arm with a patch and a fingertip, and two patches on the trunk; the true mounts."""
    still, none = np.zeros((0, 4)), np.zeros(0, int)
    arm = np.arange(6)
    return {
        "arm": Chain.from_dh(
            "arm", ARM, arm, pose([0.2, 1.4, 0.3], [0.02, 0.01, 0.05]), bent_sheet(0.05)
        ),
        "finger": Chain.from_dh("finger", ARM, arm, pose([0, 0, 0], [0.01, 0.02, 0.09])),
        "chest": Chain.from_dh(
            "chest", still, none, pose([0, 0, 0.1], [0.2, 0, 0.1]), bent_sheet(0.1)
        ),
        "belly": Chain.from_dh(
            "belly", still, none, pose([0, 0.4, 0], [0.18, 0.02, 0.02]), bent_sheet(0.1)
        ),
    }


def inside(chain: Chain, rng, m: int) -> np.ndarray:
    """Contact points of a patch that lie a reach or more away from its border."""
    if chain.is_probe:
        return np.zeros((m, 3))
    taxels = chain.taxels.reshape(14, 14, 3)[2:-2, 2:-2].reshape(-1, 3)
    return taxels[rng.integers(len(taxels), size=m)]


def touch(chains, first, second, rng, m=250, *, offsets=None, name="") -> TouchRecording:
    """Poses in which a point of the first chain meets one of the second, by Newton's steps."""
    one, other = chains[first], chains[second]
    p, q = inside(one, rng, m), inside(other, rng, m)
    target = transform_points(other.mount, q)
    angles = rng.uniform(-1.0, 1.0, (4 * m, 6))
    points, wanted = np.tile(p, (4, 1)), np.tile(target, (4, 1))
    for _ in range(60):
        T, axes, origins = one.motion(angles)
        T = T @ one.mount
        x = np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3]
        jacobian = np.stack([np.cross(a, x - o) for a, o in zip(axes, origins, strict=True)], 2)
        square = jacobian @ jacobian.transpose(0, 2, 1) + 1e-6 * np.eye(3)
        step = np.linalg.solve(square, (wanted - x)[..., None])
        angles = angles + np.clip(jacobian.transpose(0, 2, 1) @ step, -0.3, 0.3)[..., 0]
    met = (np.linalg.norm(wanted - x, axis=1) < 1e-6) & (np.abs(angles).max(axis=1) < 3)
    rows = np.flatnonzero(met)[:m]
    read = angles[rows] if offsets is None else angles[rows] - offsets
    touched = tuple(
        None
        if chain.is_probe
        else [
            np.flatnonzero(np.linalg.norm(chain.taxels - place, axis=1) < REACH)
            for place in np.tile(points_, (4, 1))[rows]
        ]
        for chain, points_ in ((one, p), (other, q))
    )
    return TouchRecording(name or f"{first}_{second}", (first, second), read, touched)


def moved(chains, name, angle=0.3, distance=0.02, seed=5) -> dict[str, Chain]:
    """The robot with one mount spoilt."""
    rng = np.random.default_rng(seed)
    turn, move = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    old = chains[name]
    T = old.mount.copy()
    T[:3, :3] = Rotation.from_rotvec(angle * turn).as_matrix() @ T[:3, :3]
    T[:3, 3] += distance * move
    return chains | {name: replace(old, mount=T)}


def taxel_error(chain: Chain, mount) -> float:
    """Root mean square distance of the taxels from where they are [m]."""
    apart = transform_points(mount, chain.taxels) - transform_points(chain.mount, chain.taxels)
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


@pytest.fixture(scope="module")
def true():
    return robot()


@pytest.fixture(scope="module")
def chest_touches(true):
    return touch(true, "arm", "chest", np.random.default_rng(1))


@pytest.mark.parametrize(("angle", "distance"), [(0.3, 0.02), (np.deg2rad(120), 0.1)])
def test_self_touch_recovers_a_mount(true, chest_touches, rng, angle, distance):
    given = moved(true, "arm", angle, distance)
    fit = self_touch([chest_touches], given, calibrate=["arm"], rng=rng)
    # Contacts at taxels give symmetric sets of active taxels but for the curvature: the middle
    # lies 12^2 / 4 / 50 = 0.7 mm below the sheet, which the mount takes up as depth.
    assert taxel_error(true["arm"], fit.mounts["arm"]) < 1.2e-3
    assert fit.rms_before > 5 * fit.rms_after
    assert fit.held_out < 1.3 * fit.rms_after
    assert fit.split_shift < 0.5e-3


def test_every_start_ends_in_the_same_minimum(true, chest_touches, rng):
    shifts = []
    for seed in range(8):
        given = moved(true, "arm", np.deg2rad(120), 0.1, seed=seed)
        fit = self_touch([chest_touches], given, calibrate=["arm"], rng=np.random.default_rng(0))
        shifts.append(fit.mounts["arm"])
    # Steps end below a micrometre and a microradian.
    np.testing.assert_allclose(shifts, shifts[:1] * 8, rtol=0, atol=1e-5)


def test_self_touch_recovers_both_mounts(true, chest_touches, rng):
    """Only what one patch is to the other can be told where both are free, up to the joints."""
    given = moved(moved(true, "arm"), "chest", seed=6)
    fit = self_touch([chest_touches], given, calibrate=["arm", "chest"], rng=rng)
    for name in ("arm", "chest"):
        assert taxel_error(true[name], fit.mounts[name]) < 2e-3


def test_joint_offsets_explain_what_mounts_cannot(true, rng):
    offsets = np.deg2rad([0.0, 3.0, -2.0, 2.5, -3.0, 0.0])
    touches = touch(true, "arm", "chest", np.random.default_rng(2), offsets=offsets)
    given = moved(true, "arm")
    without = self_touch([touches], given, calibrate=["arm"], rng=rng)
    fit = self_touch([touches], given, calibrate=["arm"], joint_offsets=True, rng=rng)
    assert fit.rms_after < 0.5 * without.rms_after
    assert sorted(fit.joint_offsets) == list(range(6))
    # The first and the last joint trade with the mounts; those between stand alone.
    found = [fit.joint_offsets[k] for k in (1, 2, 3)]
    np.testing.assert_allclose(found, offsets[1:4], rtol=0, atol=np.deg2rad(1.0))


def test_the_tip_of_a_probe_is_found(true, rng):
    touches = touch(true, "finger", "chest", np.random.default_rng(3))
    given = moved(true, "chest")
    fit = self_touch([touches], given, calibrate=["chest"], rng=rng)
    assert np.linalg.norm(fit.tips["finger"] - true["finger"].mount[:3, 3]) < 3e-3
    assert taxel_error(true["chest"], fit.mounts["chest"]) < 3e-3


def test_a_recording_that_contradicts_the_rest_is_named_and_dropped(true, chest_touches, rng):
    shifted = moved(true, "chest", 0.0, 0.05)
    others = [
        touch(true, "arm", "belly", np.random.default_rng(4), m=120),
        touch(true, "finger", "belly", np.random.default_rng(5), m=120),
        touch(shifted, "arm", "chest", np.random.default_rng(6), m=80, name="slipped"),
    ]
    given, every = moved(true, "arm"), [chest_touches, *others]
    fit = self_touch(every, given, calibrate=["arm"], rng=rng)
    assert fit.inconsistent == fit.dropped == ("slipped",)
    assert fit.medians["slipped"] > 5 * fit.medians["arm_chest"]
    assert taxel_error(true["arm"], fit.mounts["arm"]) < 1.2e-3


def test_same_seed_same_bits(true, chest_touches):
    given = moved(true, "arm")
    one, other = (
        self_touch([chest_touches], given, calibrate=["arm"], rng=np.random.default_rng(9))
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.mounts["arm"], other.mounts["arm"])
    assert (one.held_out, one.split_shift) == (other.held_out, other.split_shift)


def test_active_taxels_that_lie_apart_are_two_places(true):
    chest = true["chest"]
    two = np.array([0, 1, 14, 100, 101, 114])
    side = side_of(chest, [two, two[:3]], 2)
    np.testing.assert_array_equal(side.filled, [[True, True], [True, False]])
    np.testing.assert_allclose(side.places[0, 0], chest.taxels[two[:3]].mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(side.places[0, 1], chest.taxels[two[3:]].mean(axis=0), rtol=1e-12)


def test_the_motion_of_a_chain_is_the_derivative_of_its_frames(true, rng):
    """Axes and origins of the joints against differences."""
    chain, angles, step = true["arm"], rng.uniform(-1, 1, (5, 6)), 1e-6
    T, axes, origins = chain.motion(angles)
    for joint in range(6):
        bumped = angles.copy()
        bumped[:, joint] += step
        slope = (chain.frames(bumped) - T)[:, :3, 3] / step
        np.testing.assert_allclose(
            slope, np.cross(axes[joint], T[:, :3, 3] - origins[joint]), rtol=0, atol=1e-6
        )


def test_bad_recordings_are_named(true, chest_touches, rng):
    def fit(*recordings, calibrate=("arm",)):
        return self_touch(recordings, true, calibrate=calibrate, rng=rng)

    with pytest.raises(UnknownNameError, match="arm, finger, chest, belly"):
        fit(chest_touches, calibrate=["leg"])
    with pytest.raises(InvalidArrayError, match="no chain to calibrate"):
        fit(chest_touches, calibrate=[])
    with pytest.raises(InvalidArrayError, match="'finger' is a probe"):
        fit(chest_touches, calibrate=["finger"])
    with pytest.raises(InvalidArrayError, match="no recording touches 'belly'"):
        fit(chest_touches, calibrate=["belly"])
    few = chest_touches.subset(np.arange(len(chest_touches)) < 5)
    with pytest.raises(InvalidArrayError, match="5 touches, at least 12"):
        fit(few)
    a, b = chest_touches.touched
    with pytest.raises(InvalidArrayError, match=r"event 3: taxel 999 of 'chest', which has 0..195"):
        wrong = [*b[:3], np.array([999]), *b[4:]]
        fit(TouchRecording("x", ("arm", "chest"), chest_touches.angles, (a, wrong)))
    wide = np.pad(chest_touches.angles, ((0, 0), (0, 1)))
    other = TouchRecording("wide", ("arm", "chest"), wide, (a, b))
    with pytest.raises(InvalidArrayError, match=r"differ in their number of angles.*'wide' 7"):
        fit(chest_touches, other)
    with pytest.raises(InvalidArrayError, match="has 3 angles a pose, 'arm' needs column 5"):
        fit(TouchRecording("thin", ("arm", "chest"), chest_touches.angles[:, :3], (a, b)))
    with pytest.raises(InvalidArrayError, match="names taxels of 'finger'"):
        fit(TouchRecording("x", ("finger", "chest"), chest_touches.angles, (a, b)))
    with pytest.raises(InvalidArrayError, match="does not name the taxels of 'arm'"):
        fit(TouchRecording("x", ("arm", "chest"), chest_touches.angles, (None, b)))
    with pytest.raises(InvalidArrayError, match="events of 'chest' for"):
        TouchRecording("x", ("arm", "chest"), chest_touches.angles, (a, b[:-1]))


NAO = Path(os.environ.get("SKINMAP_NAO", Path(__file__).parents[3] / "shared" / "data" / "nao"))
needs_nao = pytest.mark.skipif(not NAO.is_dir(), reason="no NAO recordings beside the checkout")


def nao_probes(folder: Path) -> Path:
    """The file that says what the robot's finger sits on."""
    path = folder / "probes.toml"
    path.write_text('[[probe]]\nname = "rightFinger"\npart = "rightArm"\n')
    return path


@needs_nao
def test_the_head_of_a_real_robot(rng):
    """Kinematics and both mounts as they came explain the contacts to 32 mm, fitted to 6 mm."""
    data = load_part_touches([NAO / "rightArm_head.npz"])
    recordings, chains = data.recordings, data.chains
    fit = self_touch(recordings, chains, calibrate=["rightArm", "head"], rng=rng)
    assert fit.rms_after < 6.5e-3 < 25e-3 < fit.rms_before
    assert fit.held_out < 1.1 * fit.rms_after  # twelve numbers fitted to 670 events


@needs_nao
def test_the_torso_of_a_real_robot(rng, tmp_path):
    data = load_part_touches([NAO / "torso_rightFinger.npz"], nao_probes(tmp_path))
    recordings, chains = data.recordings, data.chains
    fit = self_touch(recordings, chains, calibrate=["torso"], rng=rng)
    assert fit.rms_after < 4.2e-3 < fit.rms_before
    assert fit.held_out < 1.1 * fit.rms_after
    assert set(fit.tips) == {"rightFinger"}


def saved(folder: Path, chains, recording) -> Path:
    """A recording and its parts as files."""
    arrays = {"q": recording.angles, "chain1": recording.chains[0], "chain2": recording.chains[1]}
    for name, touched in zip(recording.chains, recording.touched, strict=True):
        chain = chains[name]
        turn = Rotation.from_matrix(chain.mount[:3, :3]).as_rotvec()
        np.savez(
            folder / f"part_{name}.npz",
            taxel_pos=chain.taxels,
            mount=np.concatenate([chain.mount[:3, 3], turn]),
            dh=ARM if len(chain.joints) else np.zeros((0, 4)),
            joint_cols=chain.joints,
        )
        if touched is not None:
            arrays[f"ids_{name}"] = np.concatenate(touched)
            arrays[f"ptr_{name}"] = np.cumsum([0, *map(len, touched)])
    path = folder / f"{recording.name}.npz"
    np.savez(path, **arrays)
    return path


def test_files_give_back_what_was_saved(true, chest_touches, tmp_path):
    saved(tmp_path, true, chest_touches)
    data = load_part_touches([tmp_path])
    recordings, chains = data.recordings, data.chains
    assert [one.name for one in recordings] == ["arm_chest"]
    np.testing.assert_array_equal(recordings[0].angles, chest_touches.angles)
    for side in (0, 1):
        for one, other in zip(
            recordings[0].touched[side], chest_touches.touched[side], strict=True
        ):
            np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(chains["arm"].mount, true["arm"].mount, rtol=0, atol=1e-15)


def test_damaged_files_are_named(true, chest_touches, tmp_path):
    path = saved(tmp_path, true, chest_touches)
    with pytest.raises(MissingFileError, match=r"gone.npz"):
        load_part_touches([tmp_path / "gone.npz"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingFileError, match="recordings of self-touch"):
        load_part_touches([tmp_path / "empty"])
    arrays = dict(np.load(path))
    np.savez(path, **{k: v for k, v in arrays.items() if k != "q"})
    with pytest.raises(DataFormatError, match="lacks 'q'"):
        load_part_touches([path])
    np.savez(path, **(arrays | {"ptr_arm": arrays["ptr_arm"][:-1]}))
    with pytest.raises(DataFormatError, match="ptr_arm must rise from 0"):
        load_part_touches([path])
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DataFormatError, match="not a recording of self-touch"):
        load_part_touches([path])
    np.savez(path, **arrays)
    (tmp_path / "part_arm.npz").unlink()
    with pytest.raises(MissingFileError, match="taxels of 'arm'"):
        load_part_touches([path])


def test_the_covariance_of_self_touch_covers_the_error(true, chest_touches, rng):
    fit = self_touch([chest_touches], moved(true, "arm"), calibrate=["arm"], rng=rng)
    own = taxel_covariance(true["arm"], fit.mounts["arm"], fit.covariances["arm"])
    stated = np.sqrt(np.einsum("nii->n", own).mean())
    assert stated >= 0.5 * fit.split_shift * (1 - 1e-9)
    assert stated < 2e-3  # and says something


def run(*words, code=0):
    result = CliRunner().invoke(calibrate, [*map(str, words), "--json"])
    assert result.exit_code == code, (result.output, result.exception)
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def touched(tmp_path_factory):
    """A folder with a recording of self-touch whose arm stands 20 mm off."""
    folder = tmp_path_factory.mktemp("touched")
    true = robot()
    recording = touch(true, "arm", "chest", np.random.default_rng(1), m=120)
    saved(folder, moved(true, "arm"), recording)
    return folder, true


def test_selftouch_writes_mounts_and_taxels(touched, tmp_path):
    folder, true = touched
    result = run("selftouch", folder, "--calibrate", "arm", "-o", tmp_path / "out")
    assert result["status"] == "ok"
    assert {"before", "after", "held_out"} == set(result["rms_mm"])
    assert result["rms_mm"]["before"] > 5 * result["rms_mm"]["after"]
    assert result["split_shift_mm"] < 1.0
    assert result["dropped"] == []
    assert result["files"] == ["mounts.json", "taxels_arm.csv", "report.html"]
    table = read_taxels(tmp_path / "out" / "taxels_arm.csv")
    places = transform_points(true["arm"].mount, true["arm"].taxels)
    # As in the fit itself: the middle of a contact lies 0.7 mm below the bent sheet.
    assert np.linalg.norm(table.positions - places, axis=1).max() < 2e-3
    mounts = json.loads((tmp_path / "out" / "mounts.json").read_text())
    np.testing.assert_allclose(mounts["mounts"]["arm"], result["mounts"]["arm"], atol=1e-6)
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 1
    assert "arm: weakest direction" in page
    assert "arm: touch next" in page


def test_a_calibrated_table_is_exported_as_the_icubs(touched, tmp_path):
    folder, _ = touched
    run("selftouch", folder, "--calibrate", "arm", "-o", tmp_path / "out")
    own, icub = (tmp_path / "out" / f"taxels_arm.{kind}" for kind in ("csv", "txt"))
    words = ["export", str(own), "--format", "icub", "-o", str(icub)]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    icub, own = read_taxels(icub), read_taxels(own)
    np.testing.assert_array_equal(icub.positions, own.positions)


def test_selftouch_prints_without_writing(touched):
    folder, _ = touched
    result = CliRunner().invoke(calibrate, ["selftouch", str(folder), "--calibrate", "arm"])
    assert result.exit_code == 0, result.output
    assert "mm rms, held out" in result.stdout
    assert run("selftouch", folder, "--calibrate", "arm")["files"] == []


def test_a_doubtful_result_exits_3_and_keeps_what_was_there(touched, tmp_path):
    _, true = touched
    recording = touch(true, "arm", "chest", np.random.default_rng(1), m=120)
    few = recording.subset(np.arange(120) < 14)
    few = TouchRecording(few.name, few.chains, few.angles[::-1], few.touched)  # wrong poses
    saved(tmp_path, moved(true, "arm"), few)
    out = tmp_path / "out"
    out.mkdir()
    (out / "mounts.json").write_text("before")
    words = ("selftouch", tmp_path / f"{few.name}.npz", "--calibrate", "arm", "-o", out, "--force")
    result = run(*words, code=3)
    assert result["status"] != "ok"
    assert result["reasons"]
    assert result["files"] == ["refused.html"]
    assert (out / "mounts.json").read_text() == "before"
    assert "mounts.json" in run(*words, "--accept")["files"]
    assert (out / "mounts.json").read_text() != "before"
