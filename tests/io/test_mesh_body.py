from __future__ import annotations

import numpy as np
import pytest
import trimesh

from skinmap.errors import DataFormatError, MissingFileError, UnknownNameError
from skinmap.io.robots.manifest import load_robot
from skinmap.io.robots.mesh_file import MeshBody
from skinmap.io.taxels.table import write_csv
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
    with pytest.raises(UnknownNameError, match="no joint 'elbow'; there are no joints"):
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
