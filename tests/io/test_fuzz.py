"""Damaged files: whatever came, the outcome is what was asked for or an error of ours.

Real files are mutated: bytes flipped, lines dropped, doubled or swapped, words replaced by what a
number must not be, the end cut off. Every warning that is not ours is an error too.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinmap.errors import SkinError, SkinWarning
from skinmap.io.drawing import Drawing, read_drawing
from skinmap.io.export import write_icub, write_tactile_urdf
from skinmap.io.icub import read_icub
from skinmap.io.manifest import data_folder, load_robot
from skinmap.io.skinware import read_skinware
from skinmap.io.table import read_csv
from skinmap.io.tactile_urdf import read_tactile_urdf
from skinmap.io.urdf import UrdfBody, read_mesh
from skinmap.skin.taxels import TaxelTable

WORDS = [
    b"", b"nan", b"-inf", b"1e308", b"-1e308", b"1e999", b"99999999999999999999", b"-1", b"0",
    b"1_000", b"0x1p3", b"2.5", b"x", b"\xc3\xa9", b"\xff", b"\0", b"\r", b'"', b"'", b"<", b">",
    b"&a;", b"&#0;", b"#", b"[", b"]", b"(", b")", b",", b"=", b"../..", b"/dev/zero", b":",
    b"true", b"1e-320", b"9" * 5000, b"1 2 3 4", b"package:x", b":x", b"x:", b"\\u0000",
]  # fmt: skip
KINDS = ["flip", "drop", "double", "swap", "word", "insert", "cut"]
SHARE = st.floats(0, 1, exclude_max=True)
ACCIDENT = st.tuples(st.sampled_from(KINDS), SHARE, SHARE, st.sampled_from(WORDS))
accidents = st.lists(ACCIDENT, min_size=1, max_size=4)

# The same examples each time: a gate that fails by chance teaches nobody.
fuzz = settings(
    max_examples=max(300, settings.default.max_examples),
    deadline=None,
    derandomize=settings.default.derandomize,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def mutate(data: bytes, steps: list[tuple[str, float, float, bytes]]) -> bytes:
    """The data after some accidents; their two numbers say where, as shares of the whole."""
    for kind, where, other, word in steps:
        if not data:
            return data
        place = int(where * len(data))
        if kind == "flip":
            data = data[:place] + bytes([data[place] ^ 1 << int(other * 8)]) + data[place + 1 :]
        elif kind == "cut":
            data = data[:place]
        elif kind == "insert":
            data = data[:place] + word + data[place:]
        elif kind == "word":
            end = place
            while end < len(data) and data[end : end + 1] not in b' \t\n,"()=<>':
                end += 1
            start = place
            while start > 0 and data[start - 1 : start] not in b' \t\n,"()=<>':
                start -= 1
            data = data[:start] + word + data[end:]
        else:
            lines = data.split(b"\n")
            i, j = int(where * len(lines)), int(other * len(lines))
            if kind == "drop":
                del lines[i]
            elif kind == "double":
                lines.insert(j, lines[i])
            else:
                lines[i], lines[j] = lines[j], lines[i]
            data = b"\n".join(lines)
    return data


def outcome(read: Callable[[Path], object], path: Path) -> object:
    """What a reader gives, or None where it refused with an error of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", SkinWarning)
        try:
            return read(path)
        except SkinError:
            return None


@pytest.fixture(scope="module")
def tables() -> TaxelTable:
    return read_csv(data_folder() / "icub" / "taxels" / "left_hand.csv")


def skinware_of(table: TaxelTable) -> str:
    rows = [
        " ".join(str(round(1e9 * float(value))) for value in (*position, *normal))
        for position, normal in zip(table.positions, table.normals, strict=True)
    ]
    lines = [f"0 {uid} {row} 1750000 3" for uid, row in zip(table.channels, rows, strict=True)]
    return "\n".join([str(len(lines)), *lines]) + "\n"


@pytest.fixture(scope="module")
def originals(tables, tmp_path_factory) -> dict[str, bytes]:
    """A whole file of each format, made of a real part of the iCub."""
    folder = tmp_path_factory.mktemp("originals")
    write_icub(tables, folder / "icub", name="l_hand")
    write_tactile_urdf({"palm": tables}, folder / "urdf")
    return {
        "csv": (data_folder() / "icub" / "taxels" / "left_hand.csv").read_bytes(),
        "icub": (folder / "icub").read_bytes(),
        "urdf": (folder / "urdf").read_bytes(),
        "skinware": skinware_of(tables).encode(),
    }


READERS = {
    "csv": read_csv,
    "icub": read_icub,
    "skinware": read_skinware,
    "urdf": read_tactile_urdf,
}


@pytest.mark.parametrize("format", READERS)
def test_originals_are_whole(tmp_path, originals, format, tables):
    (tmp_path / "t").write_bytes(originals[format])
    assert len(READERS[format](tmp_path / "t")) == len(tables) == 48


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
@pytest.mark.parametrize("format", READERS)
def test_damaged_tables_are_read_or_refused(tmp_path, originals, format, steps):
    (tmp_path / "t").write_bytes(mutate(originals[format], steps))
    table = outcome(READERS[format], tmp_path / "t")
    assert table is None or isinstance(table, TaxelTable)


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
@pytest.mark.parametrize("name", ["left_forearm_V2.txt", "right_leg_upper.txt", "torso.txt"])
def test_damaged_files_of_the_icub_are_read_or_refused(tmp_path, icub_main, name, steps):
    data = (icub_main / "positions" / name).read_bytes()
    (tmp_path / "t.txt").write_bytes(mutate(data, steps))
    table = outcome(read_icub, tmp_path / "t.txt")
    assert table is None or isinstance(table, TaxelTable)


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
@pytest.mark.parametrize("name", ["left_hand_V2_1.ini", "right_arm_V2_7.ini", "torso_left_top.ini"])
def test_damaged_drawings_are_read_or_refused(tmp_path, icub_main, name, steps):
    data = (icub_main / "skinGui" / name).read_bytes()
    (tmp_path / "d.ini").write_bytes(mutate(data, steps))
    drawing = outcome(read_drawing, tmp_path / "d.ini")
    assert drawing is None or isinstance(drawing, Drawing)


URDF = b"""<?xml version="1.0"?>
<robot name="one">
  <link name="base"><visual><origin xyz="0 0 0.1" rpy="0 0 1"/>
    <geometry><mesh filename="hand.ply" scale="0.001 0.001 0.001"/></geometry></visual></link>
  <link name="tip"><visual><geometry><mesh filename="hand.ply"/></geometry></visual></link>
  <link name="end"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>
    <origin xyz="0 0 0.2" rpy="0 0.5 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="follow" type="revolute"><parent link="tip"/><child link="end"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="2" effort="1" velocity="1"/>
    <mimic joint="turn" multiplier="2" offset="0.1"/></joint>
</robot>
"""
MESH = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 1 2 3
3 0 3 2
"""
MANIFEST = b"""[robot]
name = "one"
urdf = "one.urdf"
[robot.pose_deg]
turn = 20
[[part]]
name = "hand"
link = "tip"
taxels = "left_hand.csv"
units = "m"
format = "csv"
"""


@pytest.fixture(scope="module")
def robot_folder(tmp_path_factory) -> Path:
    """A small robot: manifest, URDF, mesh and a real table."""
    folder = tmp_path_factory.mktemp("robot")
    (folder / "one.urdf").write_bytes(URDF)
    (folder / "hand.ply").write_bytes(MESH)
    (folder / "one.toml").write_bytes(MANIFEST)
    shutil.copy(data_folder() / "icub" / "taxels" / "left_hand.csv", folder)
    return folder


def walk_body(path: Path) -> int:
    """Read a body, pose it and read all its meshes."""
    body = UrdfBody(path)
    poses = body.poses(dict.fromkeys(body.joints, 0.5))
    return len(poses) + sum(len(body.mesh(link).faces) for link in body.links)


def walk_robot(path: Path) -> int:
    """Read a manifest, its body and the tables of its parts."""
    robot = load_robot(path)
    return len(robot.body.links) + sum(len(robot.part(name).read()) for name in robot.parts)


def test_the_robot_is_whole(robot_folder):
    assert walk_body(robot_folder / "one.urdf") == 3 + 8
    assert walk_robot(robot_folder / "one.toml") == 3 + 48


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
def test_damaged_urdfs_are_read_or_refused(robot_folder, steps):
    (robot_folder / "damaged.urdf").write_bytes(mutate(URDF, steps))
    outcome(walk_body, robot_folder / "damaged.urdf")


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
def test_damaged_manifests_are_read_or_refused(robot_folder, steps):
    (robot_folder / "damaged.toml").write_bytes(mutate(MANIFEST, steps))
    outcome(walk_robot, robot_folder / "damaged.toml")


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
def test_damaged_meshes_are_read_or_refused(robot_folder, steps):
    (robot_folder / "damaged.ply").write_bytes(mutate(MESH, steps))
    outcome(read_mesh, robot_folder / "damaged.ply")
