from __future__ import annotations

import hashlib
import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import (
    DataFormatError,
    ForbiddenPathError,
    MissingFileError,
    SkinError,
    SkinWarning,
    UnknownNameError,
)
from skinmap.io.robots import urdf
from skinmap.io.robots.manifest import data_folder, load_robot
from skinmap.io.robots.mesh_file import read_mesh
from skinmap.io.robots.urdf import UrdfBody
from skinmap.skin.repair import detect_unit

MANIFEST = """
[robot]
name = "one"
urdf = "icub-models:iCubGazeboV2_7"
[[part]]
name = "hand"
link = "r_hand"
taxels = "right_hand.csv"
"""


@pytest.fixture
def manifest(tmp_path):
    """A function that writes a manifest beside a real taxel table and returns its path."""
    shutil.copy(data_folder() / "icub" / "taxels" / "right_hand.csv", tmp_path)

    def write(text: str = MANIFEST) -> Path:
        (tmp_path / "robot.toml").write_text(text)
        return tmp_path / "robot.toml"

    return write


def test_icub_has_13_parts_and_4326_taxels(icub):
    assert len(icub.parts) == 13
    assert sum(len(icub.skin(part)) for part in icub.parts) == 4326


def test_tables_of_the_icub_are_those_the_readme_lists():
    folder = data_folder() / "icub"
    listed = dict(
        re.findall(r"`(taxels/\S+)` \| \d+ \| `(\w{64})`", (folder / "README.md").read_text())
    )
    assert len(listed) == 13
    for name, digest in listed.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_taxels_of_the_icub_lie_on_their_links(icub):
    from skinmap.geometry.proximity import closest_on_mesh

    for part in icub.parts:
        skin, mesh = icub.skin(part), icub.mesh(icub.part(part).link)
        distance, _, _ = closest_on_mesh(skin.positions, mesh.vertices, mesh.faces)
        assert np.median(distance) < 1.5e-3, part  # medians are 0.5 to 1.4 mm
        assert distance.max() < 5e-3, part


def test_one_part_reads_one_mesh(monkeypatch):
    opened = []
    monkeypatch.setattr(urdf, "read_mesh", lambda path: opened.append(path) or read_mesh(path))
    skinmap.load_robot("icub").skin("right_forearm")
    assert [path.name for path in opened] == ["sim_sea_2-5_r_forearm_prt-binary.stl"]


def test_poses_are_rigid_and_follow_the_joints(icub):
    from skinmap.geometry.rigid import check_transform

    rest, bent = icub.body.poses({}), icub.body.poses({"r_elbow": 1.0})
    for link, pose in rest.items():
        check_transform(pose, link)
    moved = {link for link in rest if not np.allclose(rest[link], bent[link])}
    assert "r_forearm" in moved
    assert not moved & {"l_forearm", "chest", "r_upper_arm"}


def test_poses_at_rest_are_the_same_after_another_pose(icub):
    rest = icub.body.poses({})["r_hand"]
    icub.body.poses({"r_elbow": 1.0})
    np.testing.assert_array_equal(icub.body.poses({})["r_hand"], rest)


def test_pose_of_the_icub_lies_within_its_limits(icub):
    for joint, angle in icub.pose.items():
        low, high = icub.body.joints[joint]
        assert low <= angle <= high, joint


def test_manifest_of_a_user_loads(manifest):
    robot = load_robot(manifest())
    assert robot.name == "one"
    assert len(robot.skin("hand")) == 48


def test_units_of_a_manifest_scale_positions(manifest):
    metres = load_robot(manifest()).part("hand").read().positions
    inches = load_robot(manifest(MANIFEST + 'units = "in"\n')).part("hand").read().positions
    np.testing.assert_allclose(inches, 0.0254 * metres, rtol=1e-15)


BODY = """<robot name="two"><link name="base"/><link name="arm"/>
<joint name="j" type="fixed"><parent link="base"/><child link="arm"/><origin xyz="0.3 0 0"/></joint>
</robot>"""
PLACES = {  # of the taxels besides their shape: as the link's own, in a frame, by a pose
    "": [0.0, 0.0, 0.0],
    'frame = "arm"': [0.3, 0.0, 0.0],
    "pose = {xyz_mm = [0, 300, 0], rpy_deg = [0, 0, 0]}": [0.0, 0.3, 0.0],
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("unit", "stated", "warned"),
    [
        ("mm", None, "positions are in mm: multiplied by 0.001"),
        ("mm", "mm", None),
        ("mm", "m", "positions are in mm, not in m as the manifest states"),
        ("mm", "cm", "positions are in mm, not in cm as the manifest states"),
        ("m", "mm", "positions are in m, not in mm as the manifest states"),
        ("cm", "m", "positions are in cm, not in m as the manifest states"),
    ],
)
def test_the_unit_is_found_in_the_files_numbers_before_frame_and_pose(
    tmp_path, place, unit, stated, warned
):
    from skinmap.io.taxels.taxel_table import write_csv
    from skinmap.io.text import UNITS
    from skinmap.skin.taxels import TaxelTable

    pitch = 0.008
    x, y = np.meshgrid(pitch * np.arange(6), pitch * np.arange(5))
    true = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    numbers = np.arange(len(true))
    table = TaxelTable(numbers, numbers // 10, true / UNITS[unit], 0 * true)
    write_csv(table, tmp_path / "t.csv")
    (tmp_path / "body.urdf").write_text(BODY)
    said = "" if stated is None else f'units = "{stated}"'
    (tmp_path / "r.toml").write_text(
        '[robot]\nname = "two"\nurdf = "body.urdf"\n[[part]]\nname = "p"\nlink = "base"\n'
        f'taxels = "t.csv"\n{said}\n{place}\n'
    )
    robot = load_robot(tmp_path / "r.toml")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = robot.repair("p").table.positions
    np.testing.assert_allclose(found, true + PLACES[place], atol=1e-12)
    ours = [str(one.message) for one in caught if issubclass(one.category, SkinWarning)]
    assert len(ours) == (warned is not None)
    if warned is not None:
        assert ours[0].startswith(f"part 'p': {warned}")


@pytest.mark.parametrize(
    ("pitch", "unit", "stated"),
    [(0.16, "m", 'units = "m"'), (0.16, "m", ""), (0.045, "m", ""), (0.045, "mm", "")],
)
def test_taxels_of_a_large_skin_are_believed_where_they_lie_on_the_link(
    tmp_path, pitch, unit, stated
):
    from skinmap.io.taxels.taxel_table import write_csv
    from skinmap.io.text import UNITS
    from skinmap.skin.taxels import TaxelTable

    radius, numbers = 6 * pitch, np.arange(72)
    angle = numbers % 12 * pitch / radius
    out = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    places = radius * out + np.outer(numbers // 12 * pitch, [0, 0, 1])
    write_csv(TaxelTable(numbers, numbers // 12, places / UNITS[unit], out), tmp_path / "t.csv")
    shape = f'<cylinder radius="{radius}" length="{20 * pitch}"/>'
    body = f'<link name="base"><visual><geometry>{shape}</geometry></visual></link>'
    (tmp_path / "body.urdf").write_text(f'<robot name="one">{body}</robot>')
    (tmp_path / "r.toml").write_text(
        '[robot]\nname = "one"\nurdf = "body.urdf"\n[[part]]\nname = "p"\nlink = "base"\n'
        f'taxels = "t.csv"\n{stated}\n'
    )
    robot = load_robot(tmp_path / "r.toml")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        np.testing.assert_allclose(robot.skin("p").positions, places, rtol=1e-6, atol=1e-9)
    assert len(caught) == (unit == "mm")  # which is named


@pytest.mark.parametrize("pitch", [5e-4, 0.05])
def test_a_stated_unit_is_believed_of_dense_and_of_sparse_skins(pitch):
    x, y = np.meshgrid(pitch * np.arange(6), pitch * np.arange(5))
    lattice = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    assert detect_unit(1e3 * lattice, None, "mm") == "mm"


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("[robot]", "[robot", DataFormatError, "not TOML"),
        ('name = "one"', "", DataFormatError, "lacks 'name'"),
        ('name = "one"', "name = 3", DataFormatError, "must be text, got 3"),
        (
            "[[part]]",
            "[[parts]]",
            DataFormatError,
            "unknown keys: 'parts'; the keys are: ro",
        ),
        (
            'link = "r_hand"',
            'link = "r_hnd"',
            UnknownNameError,
            "no link .*'r_hnd'; did you mean 'r_hand'. The links are: ",
        ),
        ('link = "r_hand"', "", DataFormatError, "lacks 'link'"),
        ('link = "r_hand"', 'link = "r_hand"\ncolour = "red"', DataFormatError, "unknown keys"),
        ('link = "r_hand"', 'link = "r_hand"\nunits = "ell"', UnknownNameError, "no unit 'ell'"),
        ("icub-models:iCubGazeboV2_7", "icub-models:iCub9", UnknownNameError, "no model in"),
        ("icub-models:iCubGazeboV2_7", "no-such-thing:a", UnknownNameError, "icub-models"),
        ("icub-models:iCubGazeboV2_7", "numpy:a", UnknownNameError, "no package of robot"),
        ("icub-models:iCubGazeboV2_7", "gone.urdf", MissingFileError, "a URDF file"),
        ('urdf = "icub', 'pose_deg = {x = 1}\nurdf = "icub', UnknownNameError, "no joint 'x'"),
        ('urdf = "icub', 'pose_deg = {r_elbow = "x"}\nurdf = "icub', DataFormatError, "a number"),
    ],
)
def test_manifest_says_what_is_wrong(manifest, old, new, error, message):
    assert old in MANIFEST
    with pytest.raises(error, match=message):
        load_robot(manifest(MANIFEST.replace(old, new)))


def test_two_parts_of_one_name_are_refused(manifest):
    part = MANIFEST[MANIFEST.index("[[part]]") :]
    with pytest.raises(DataFormatError, match="two parts are called 'hand'"):
        load_robot(manifest(MANIFEST + part))


def test_load_robot_names_what_is_built_in():
    with pytest.raises(
        UnknownNameError, match=r"no robot .*'icu'; did you mean 'icub'. The robots are: .*icub"
    ):
        load_robot("icu")
    with pytest.raises(MissingFileError, match="manifest"):
        load_robot("gone.toml")


def test_robot_names_its_parts(icub):
    with pytest.raises(UnknownNameError, match="no part 'tail'; the parts are: torso, left_arm"):
        icub.skin("tail")
    with pytest.raises(UnknownNameError, match="no link 'tail'"):
        icub.mesh("tail")
    with pytest.raises(UnknownNameError, match="no joint 'tail'"):
        icub.body.poses({"tail": 0.0})


def test_every_error_is_a_skin_error_and_a_builtin(tmp_path):
    with pytest.raises(LookupError):
        load_robot("icu")
    with pytest.raises(FileNotFoundError):
        UrdfBody(tmp_path / "gone.urdf")
    with pytest.raises(SkinError):
        UrdfBody(tmp_path / "gone.urdf")


@pytest.mark.parametrize("text", ["", "no xml", "<robot", "<robot name='r'><link/></robot>"])
def test_urdf_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "r.urdf").write_text(text)
    with pytest.raises(DataFormatError, match="not a URDF"):
        UrdfBody(tmp_path / "r.urdf")


def test_read_mesh_refuses_what_is_none(tmp_path):
    (tmp_path / "m.stl").write_text("not a mesh")
    with pytest.raises(DataFormatError, match=r"m\.stl"):
        read_mesh(tmp_path / "m.stl")


def outside_manifests(folder):
    """A manifest for each way out of its folder, with the file outside really there."""
    outside = folder.parent / "outside"
    outside.mkdir()
    for name in ("right_hand.csv", "board.toml", "ball.stl"):
        (outside / name).write_text("x")
    (folder / "link.csv").symlink_to(outside / "right_hand.csv")
    part = MANIFEST[MANIFEST.index("[[part]]") :]
    single = '[robot]\nname = "one"\nmesh = "../outside/ball.stl"\n'
    return [
        MANIFEST.replace("right_hand.csv", "../outside/right_hand.csv"),
        MANIFEST.replace("right_hand.csv", str(outside / "right_hand.csv")),
        MANIFEST.replace("right_hand.csv", "link.csv"),
        MANIFEST + 'module = "../outside/board.toml"\n',
        MANIFEST.replace("icub-models:iCubGazeboV2_7", "../outside/robot.urdf"),
        single + part.replace("r_hand", "body"),
    ]


def test_manifest_may_not_read_outside_its_folder(tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    shutil.copy(data_folder() / "icub" / "taxels" / "right_hand.csv", folder)
    path = folder / "robot.toml"
    for text in outside_manifests(folder):
        path.write_text(text)
        with pytest.raises(ForbiddenPathError, match="outside its own folder"):
            load_robot(path)


def test_manifest_reads_outside_when_allowed(tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    shutil.copy(data_folder() / "icub" / "taxels" / "right_hand.csv", tmp_path)
    (folder / "robot.toml").write_text(MANIFEST.replace("right_hand.csv", "../right_hand.csv"))
    robot = load_robot(folder / "robot.toml", allow_outside=True)
    assert len(robot.skin("hand")) == 48


@pytest.mark.parametrize(("value", "read"), [("1", True), ("0", False), ("", False)])
def test_commands_read_outside_where_the_environment_says_so(tmp_path, monkeypatch, value, read):
    folder = tmp_path / "inside"
    folder.mkdir()
    shutil.copy(data_folder() / "icub" / "taxels" / "right_hand.csv", tmp_path)
    (folder / "robot.toml").write_text(MANIFEST.replace("right_hand.csv", "../right_hand.csv"))
    monkeypatch.setenv("SKINMAP_ALLOW_OUTSIDE", value)
    result = CliRunner().invoke(cli, ["list", "parts", str(folder / "robot.toml")])
    assert result.output.startswith("hand ") is read
    if not read:
        assert "SKINMAP_ALLOW_OUTSIDE=1 allows it" in str(result.exception)


def test_urdf_of_a_manifest_may_not_read_meshes_outside(tmp_path):
    import trimesh

    folder = tmp_path / "inside"
    folder.mkdir()
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "ball.stl")
    (folder / "r.urdf").write_text(
        '<robot name="r"><link name="a"><visual><geometry><mesh filename="../ball.stl"/>'
        "</geometry></visual></link></robot>"
    )
    assert len(UrdfBody(folder / "r.urdf").mesh("a").faces) == 80
    with pytest.raises(ForbiddenPathError, match=r"mesh '\.\./ball\.stl'"):
        UrdfBody(folder / "r.urdf", inside=folder).mesh("a")


def test_dh_frames_are_used_where_they_fit_better(tmp_path, icub):
    from dataclasses import replace

    from skinmap.io.taxels.taxel_table import write_csv

    table = icub.part("right_hand").read()
    rest = icub.body.poses({})
    T_dh_link = np.linalg.inv(rest["r_hand_dh_frame"]) @ rest["r_hand"]
    moved = table.positions @ T_dh_link[:3, :3].T + T_dh_link[:3, 3]
    write_csv(replace(table, positions=moved), tmp_path / "right_hand.csv")
    (tmp_path / "robot.toml").write_text(MANIFEST)
    robot = load_robot(tmp_path / "robot.toml")
    assert robot.frame("hand") == "r_hand_dh_frame"
    np.testing.assert_allclose(robot.skin("hand").positions, table.positions, atol=1e-12)
    assert icub.frame("right_hand") == "r_hand"


def test_frames_of_a_manifest_can_be_given(manifest):
    robot = load_robot(manifest(MANIFEST + 'frame = "r_forearm"\n'))
    rest = robot.body.poses({})
    table = robot.part("hand").read()
    T_hand_forearm = np.linalg.inv(rest["r_hand"]) @ rest["r_forearm"]
    expected = table.positions @ T_hand_forearm[:3, :3].T + T_hand_forearm[:3, 3]
    np.testing.assert_allclose(robot.repair("hand").table.positions, expected, atol=1e-12)
    with pytest.raises(UnknownNameError, match=r"no frame \(part 'hand'\) 'nowhere'"):
        load_robot(manifest(MANIFEST + 'frame = "nowhere"\n')).skin("hand")
