"""The UR10e with CySkin: one shape at several places, covers, and rings that are one skin."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import shutil

import numpy as np
import pytest

import skinmap
from skinmap.cli.inspect.inspection import inspect_part
from skinmap.errors import DataFormatError
from skinmap.io.robots.manifest import data_folder, load_robot
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.skin_geometry import ACTIVE, find_contacts
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import place, prepare
from skinmap.touch.simulation.variety import draw_subjects

FOLDER = data_folder() / "ur10e_cyskin"
COUNTS = 160.0  # of a load of 1


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur10e-cyskin")


@pytest.fixture(scope="module")
def ring(robot):
    return robot.skin("upper_arm_1")


def changed(tmp_path, *pairs):
    """The robot with another manifest."""
    shutil.copytree(FOLDER, tmp_path / "arm")
    path = tmp_path / "arm" / "ur10e-cyskin.toml"
    text = path.read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return path


def test_all_taxels_are_meshed_in_eight_patches_and_laid_flat(robot):
    taxels = patches = 0
    for part in robot.parts:
        mesh = skinmap.build_surface(robot.skin(part))
        assert (mesh.taxel_patches >= 0).all()
        for chart in skinmap.flatten(mesh).charts:
            assert chart.distortion.flips == 0
            assert chart.distortion.edge_rms <= 2e-4
            patches += 1
        taxels += len(mesh.skin)
    assert (taxels, patches) == (4664, 8)


def test_normals_agree_with_those_of_the_files(robot):
    for part in robot.parts:
        stored = robot.repair(part).table.normals
        cosine = np.einsum("ij,ij->i", robot.skin(part).normals, stored)
        assert cosine.min() > np.cos(np.radians(30.0))


def test_shells_of_a_ring_lie_on_one_tube(robot):
    for part, radius in (("upper_arm_2", (0.0694, 0.0768)), ("forearm_1", (0.0601, 0.0673))):
        skin = robot.skin(part)
        height = {"upper_arm_link": 0.1762, "forearm_link": 0.0393}[skin.link]
        away = np.hypot(skin.positions[:, 1], skin.positions[:, 2] - height)
        assert radius[0] < away.min()
        assert away.max() < radius[1]
        # The halves: the same shape, the second on the other side.
        one, other = (skin.positions[skin.pieces == k] for k in (0, 1))
        np.testing.assert_allclose(other[:, 0], one[:, 0], atol=1e-12)
        np.testing.assert_allclose(other[:, 1], -one[:, 1], atol=1e-12)


def test_ids_are_those_of_the_eight_patches(robot):
    unwired = {part: len(robot.repair(part).table.unwired) for part in robot.parts}
    assert unwired == {"upper_arm_1": 0, "upper_arm_2": 1, "forearm_1": 1, "forearm_2": 6}
    every = np.concatenate([robot.repair(part).table.ids for part in robot.parts])
    known = every[every >= 0]
    assert len(known) == len(np.unique(known)) == 4664 - 8
    assert len(np.unique(known // 16)) == 2 * (60 + 50) * 2


def test_taxels_without_a_channel_never_speak(robot):
    skin = robot.skin("forearm_2")
    silent = np.flatnonzero(~skin.wired)
    assert len(silent) == 6
    recording = skinmap.simulate(skin, per_gesture=4, rng=1)
    assert recording.pressures[:, silent].max() == 0
    assert (recording.pressures[:, skin.wired].max(axis=0) > 0).mean() > 0.9
    assert robot.skin("upper_arm_1").wired is None


def test_readme_lists_the_files_that_ship():
    listed = dict(
        re.findall(
            r"\| `((?:taxels|meshes)/\S+)` \| `(\w+)` \|", (FOLDER / "README.md").read_text()
        )
    )
    shipped = {
        f"{p.parent.name}/{p.name}": p for p in [*FOLDER.glob("taxels/*"), *FOLDER.glob("meshes/*")]
    }
    assert set(listed) == set(shipped)
    for name, path in shipped.items():
        assert hashlib.sha256(path.read_bytes()).hexdigest() == listed[name], name
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) < 1_000_000
    assert "plausible" in (FOLDER / "README.md").read_text()
    assert "SestosensoEU" in (FOLDER / "LICENSE").read_text()


def fingers(skin, rng):
    """Pressures of single fingers laid on a skin, and whether both shells feel each."""
    stage = prepare(skin, rng=rng)
    people = draw_subjects(10, rng=rng)
    for k in range(120):
        placed = place(stage, "full_finger", people[k % 10], rng=rng)
        if placed is not None:
            felt = np.clip(COUNTS * placed.loads.sum(axis=0), 0.0, 255.0)
            yield felt, len(np.unique(skin.pieces[felt > ACTIVE])) == 2


def followed(joined, felt):
    tracker = ContactTracker(joined)
    for step in range(15):
        tracker.update(step / 50.0, felt)
    return len(tracker.present)


def test_a_finger_across_a_joint_is_one_contact(ring):
    closed = JoinedSkin({"ring": PreparedSkin(ring)})
    halves = JoinedSkin({"ring": PreparedSkin(dataclasses.replace(ring, ring=False))})
    across, control, inside, found = [], [], [], []
    for felt, both in fingers(ring, np.random.default_rng(5)):
        (across if both else inside).append(followed(closed, felt))
        if both:
            control.append(followed(halves, felt))
            found.append(int(find_contacts(closed.skins["ring"].geometry, felt).number.max()) + 1)
    assert len(across) >= 15
    assert set(across) == set(inside) == set(found) == {1}
    # Without the ring most of the same fingers are two contacts: the judge can tell.
    assert np.mean(np.array(control) > 1) > 0.7


def test_inspect_takes_the_cover_for_no_fault(robot):
    row = inspect_part(robot, "forearm_2")
    assert row.verdict == "ok"
    assert not any("off the link" in warning for warning in row.warnings)
    assert 16.0 < row.distance_mm.median < row.distance_mm.p95 < 25.0


@pytest.mark.parametrize(
    ("old", "new", "verdict"),
    [
        ("cover_mm = 17.5\n", "", "name the cover"),
        ("cover_mm = 17.5", "cover_mm = 30", "name the cover"),
        ("xyz_mm = [-98.0, 0.0, 176.2]", "xyz_mm = [-98.0, 20.0, 176.2]", "check frame"),
        ("rpy_deg = [0.0, 0.0, -90.0]", "rpy_deg = [0.0, 0.0, -60.0]", "check frame"),
    ],
)
def test_inspect_tells_a_cover_from_a_wrong_frame(tmp_path, old, new, verdict):
    row = inspect_part(load_robot(changed(tmp_path, (old, new))), "upper_arm_1")
    assert row.verdict.startswith(verdict)


def test_a_cover_mesh_stands_for_the_link(tmp_path):
    path = changed(tmp_path, ("cover_mm = 17.5", 'cover = "meshes/cover.stl"'))
    import trimesh

    tube = trimesh.creation.cylinder(0.072, 0.2, sections=90)
    tube.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    tube.apply_translation([-0.215, 0.0, 0.1762])
    tube.export(path.parent / "meshes" / "cover.stl")
    row = inspect_part(load_robot(path), "upper_arm_1")
    assert row.verdict == "ok"
    assert row.distance_mm.max < 5.0


def test_pieces_without_a_pose_are_named(tmp_path):
    path = changed(tmp_path, ("rpy_deg = [0.0, 180.0, -90.0]", "rpy_deg = [0.0, 0.0, -90.0]"))
    row = inspect_part(load_robot(path), "upper_arm_1")
    assert "piece 2 stands where another piece stands: give it a pose" in row.warnings
    assert row.verdict == "give each shape its pose"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cover_mm = 17.5", "cover_mm = -1", "cover_mm must be from 0"),
        ("cover_mm = 17.5", "cover_mm = nan", "cover_mm must be from 0"),
        ("cover_mm = 17.5", 'cover_mm = 5\ncover = "meshes/base.ply"', "not both"),
        ("[[part.piece]]", 'taxels = "taxels/link1.json"\n[[part.piece]]', "needs either 'taxels'"),
        ("xyz_mm = [-98.0, 0.0, 176.2]", "xyz_mm = [nan, 0.0, 176.2]", "a pose of"),
        ("xyz_mm = [-98.0, 0.0, 176.2]", "xyz_mm = [-98.0, 0.0]", "must be .*length 3"),
    ],
)
def test_wrong_manifests_are_refused_in_one_line(tmp_path, old, new, message):
    with pytest.raises(DataFormatError, match=message):
        load_robot(changed(tmp_path, (old, new)))


def test_ids_of_another_shape_are_refused(tmp_path):
    path = changed(tmp_path, ("taxels/link1_patch1.ids", "taxels/link2_patch1.ids"))
    with pytest.raises(DataFormatError, match="524 ids for 642 taxels"):
        load_robot(path).skin("upper_arm_1")
