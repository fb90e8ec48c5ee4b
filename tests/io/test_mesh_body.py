from __future__ import annotations

import base64
import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from skinmap.errors import DataFormatError, MissingFileError, UnknownNameError
from skinmap.io.robots.manifest import load_robot
from skinmap.io.robots.mesh_file import check_gltf, read_mesh
from skinmap.io.robots.urdf import MeshBody, UrdfBody
from skinmap.io.taxels.taxel_table import write_csv
from skinmap.skin.taxels import TaxelTable

MANIFEST = """
[robot]
name = "ball"
mesh = "ball.{suffix}"
units = "mm"
[[part]]
name = "cap"
link = "body"
taxels = "cap.csv"
"""


@pytest.fixture
def ball(tmp_path):
    """A function: a manifest for a ball of 60 mm with 100 taxels on its upper half."""

    def make(suffix: str = "stl"):
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=60.0)
        mesh.export(tmp_path / f"ball.{suffix}")
        k = np.arange(200) + 0.5
        polar, angle = np.arccos(1 - k / 200), np.pi * (1 + 5**0.5) * k
        points = 0.06 * np.column_stack(
            [np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar)]
        )
        table = TaxelTable(np.arange(200), np.arange(200) // 12, points, np.zeros((200, 3)))
        write_csv(table, tmp_path / "cap.csv")
        path = tmp_path / "robot.toml"
        path.write_text(MANIFEST.format(suffix=suffix))
        return path

    return make


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb", "dae"])
def test_a_single_mesh_is_a_robot(ball, suffix):
    robot = load_robot(ball(suffix))
    skin = robot.skin("cap")
    # Normals of points on a ball are radial; the fit of ten neighbours is 3 degrees off at most
    # inside and a little more at the rim.
    cosine = np.einsum("ij,ij->i", skin.normals, skin.positions) / 0.06
    assert np.median(cosine) > np.cos(np.radians(3))
    assert cosine.min() > np.cos(np.radians(15))


def test_a_single_mesh_meshes_and_flattens(ball):
    from skinmap.flat.flat_map import flatten
    from skinmap.surface.surface_mesh import build_surface

    flat = flatten(build_surface(load_robot(ball()).skin("cap")))
    assert flat.flips == 0
    assert len(flat.charts) == 1


def test_mesh_body_has_no_joints_and_one_link(ball):
    body = load_robot(ball()).body
    assert body.links == body.visible_links == ("body",)
    with pytest.raises(UnknownNameError, match="no joint 'elbow'; there are not any joints"):
        body.poses({"elbow": 1.0})
    with pytest.raises(UnknownNameError, match="no link 'arm'; the only link is body"):
        body.mesh("arm")


def test_a_manifest_needs_one_kind_of_body(ball):
    path = ball()
    text = path.read_text()
    path.write_text(text.replace('mesh = "ball.stl"', ""))
    with pytest.raises(DataFormatError, match="either 'urdf' or 'mesh'"):
        load_robot(path)
    path.write_text(text.replace("units", 'urdf = "x.urdf"\nunits'))
    with pytest.raises(DataFormatError, match="either 'urdf' or 'mesh'"):
        load_robot(path)


def test_a_mesh_that_is_missing_or_none_is_named(tmp_path):
    with pytest.raises(MissingFileError, match="a mesh file"):
        MeshBody(tmp_path / "gone.stl")
    (tmp_path / "text.stl").write_text("hello")
    with pytest.raises(DataFormatError, match=r"text\.stl"):
        MeshBody(tmp_path / "text.stl").mesh("body")


def gltf(folder: Path, uri: str, kind: str = "buffers") -> Path:
    """A triangle whose buffer, or a picture of it, is another file."""
    corners = struct.pack("<9f3I", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
    inside = "data:application/octet-stream;base64," + base64.b64encode(corners).decode()
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12}
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 48, "uri": uri if kind == "buffers" else inside}],
        "images": [{"uri": uri}] if kind == "images" else [],
    }  # fmt: skip
    folder.mkdir(exist_ok=True)
    (folder / "m.gltf").write_text(json.dumps(tree))
    for one in (folder, folder.parent):
        (one / "the corners.bin").write_bytes(corners)
    (folder / "link.bin").unlink(missing_ok=True)
    (folder / "link.bin").symlink_to(folder.parent / "the corners.bin")
    return folder / "m.gltf"


def test_a_gltf_may_name_a_file_beside_it(tmp_path):
    assert len(read_mesh(gltf(tmp_path / "own", "the corners.bin"))[1]) == 1


@pytest.mark.parametrize("kind", ["buffers", "images"])
@pytest.mark.parametrize(
    "uri",
    ["../the corners.bin", "..%2Fthe%20corners.bin", "/dev/zero", "file:///dev/zero", "link.bin",
     "https://example.org/a.bin", "below/the corners.bin", "..", ""],
)  # fmt: skip
def test_a_gltf_that_names_any_other_file_is_refused_by_us(tmp_path, uri, kind):
    """Whatever trimesh does: some of its versions read `../` and `/dev/zero`."""
    with pytest.raises(DataFormatError, match="not a file beside it"):
        check_gltf(gltf(tmp_path / "own", uri, kind))


def test_a_pipe_beside_a_gltf_is_not_read(tmp_path):
    path = gltf(tmp_path / "own", "pipe.bin")
    os.mkfifo(path.parent / "pipe.bin")
    with pytest.raises(MissingFileError):
        check_gltf(path)


def test_the_unit_of_a_collada_file_counts_once(tmp_path):
    solid = trimesh.creation.box(extents=[200, 300, 400])
    text = solid.export(file_type="dae").decode()
    text = text.replace("<up_axis>", '<unit name="millimeter" meter="0.001"/><up_axis>')
    (tmp_path / "b.dae").write_text(text)
    shape = '<geometry><mesh filename="b.dae"/></geometry>'
    (tmp_path / "r.urdf").write_text(
        f'<robot name="r"><link name="a"><visual>{shape}</visual></link></robot>'
    )
    for mesh in (UrdfBody(tmp_path / "r.urdf").mesh("a"),
                 MeshBody(tmp_path / "b.dae", scale=1e-3).mesh("body")):  # fmt: skip
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [0.2, 0.3, 0.4])
    (tmp_path / "b.dae").write_text(text.replace("0.001", "0"))
    with pytest.raises(DataFormatError, match="its unit is not a length"):
        UrdfBody(tmp_path / "r.urdf").mesh("a")
