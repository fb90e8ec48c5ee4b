"""A part of one or two taxels is a disc for each, and is shown like any other."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.normals import repair_normals
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.skin.skin_layer import FineSurface, flat_vertices
from viewer.web.scene_data import WebScene

ROBOT = """
[robot]
name = "gripper"
mesh = "pad.obj"
units = "mm"

[[part]]
name = "tip"
link = "body"
taxels = "tip.csv"
units = "mm"
"""
PLATE = TriangleMesh(
    np.array([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


@pytest.fixture(params=[1, 2])
def robot(request, tmp_path):
    rows = [f"{k},0,{8 * k},0,1,0,0,1" for k in range(request.param)]
    (tmp_path / "tip.csv").write_text("\n".join(["channel,module,x,y,z,nx,ny,nz", *rows]))
    corners = [f"v {1e3 * x} {1e3 * y} {1e3 * z}" for x, y, z in PLATE.vertices]
    faces = ["f " + " ".join(str(v + 1) for v in face) for face in PLATE.faces]
    (tmp_path / "pad.obj").write_text("\n".join([*corners, *faces]))
    (tmp_path / "robot.toml").write_text(ROBOT)
    return tmp_path / "robot.toml"


def test_its_surface_and_its_map_are_discs(robot):
    skin = skinmap.load_robot(robot).skin("tip")
    mesh = skinmap.build_surface(skin)
    flat = skinmap.flatten(mesh)
    assert len(mesh.faces) == 0
    assert mesh.n_patches == 1
    assert np.allclose(mesh.taxel_areas, np.pi * (skin.spacing / 2) ** 2)
    if len(skin) == 2:
        assert np.linalg.norm(flat.uv[1] - flat.uv[0]) == pytest.approx(8e-3)
    fine = FineSurface(mesh)
    uv = flat_vertices(fine, flat)
    # On the map discs are as wide as on the body.
    own = np.asarray(fine.linear.argmax(axis=1)).ravel()
    away = np.linalg.norm(fine.positions - skin.positions[own], axis=1)
    assert np.allclose(np.linalg.norm(uv - flat.uv[own], axis=1), away)
    assert np.allclose(fine.smooth.sum(axis=1), 1.0)


def test_inspect_names_them_too_few(robot):
    result = CliRunner().invoke(cli, ["inspect", str(robot), "--json"])
    (part,) = json.loads(result.stdout)["parts"]
    assert "too few taxels for a surface: each stands for a disc" in part["warnings"]


def test_a_pressed_taxel_is_a_contact(robot):
    skin = skinmap.load_robot(robot).skin("tip")
    pressures = np.zeros(len(skin))
    pressures[0] = 90
    contacts = skinmap.find_contacts(skinmap.build_surface(skin), pressures)
    assert contacts.active.sum() == 1
    assert contacts.number[0] == 0
    image = skinmap.contact_image(skinmap.flatten(skin), pressures, pitch=2e-3)
    assert image.max() == 90


def test_pages_get_its_discs(robot):
    loaded = skinmap.load_robot(robot)
    skins = {"tip": PreparedSkin(loaded.skin("tip"))}
    scene = WebScene(loaded, skins)
    assert len(scene.layers["tip"].fine.faces) == 4 * 12 * len(skins["tip"])


def test_normals_of_one_taxel_are_the_faces_below():
    above = repair_normals(np.array([[0.01, 0.0, 2e-3]]), PLATE)
    below = repair_normals(np.array([[0.01, 0.0, -2e-3]]), PLATE)
    assert np.allclose(above, [[0, 0, 1]])
    assert np.allclose(below, [[0, 0, -1]])


def test_commands_take_it_like_any_other(robot, tmp_path):
    touched = tmp_path / "touches.npz"

    def run(*words: object) -> dict:
        done = CliRunner().invoke(cli, [*map(str, words), "--json"], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout)

    assert run("inspect", robot)["parts"][0]["verdict"] == "ok"
    run(
        "simulate",
        robot,
        "--gesture",
        "poke",
        "--per-gesture",
        2,
        "--fault",
        "noise=0",
        "-o",
        touched,
    )
    assert run("classify", touched)["touches"]
    run("flatten", robot, "--out", tmp_path / "maps", "--sheet", tmp_path / "sheet.svg")
    channels = len(skinmap.load_robot(robot).skin("tip"))
    sheet = (tmp_path / "sheet.svg").read_text()
    assert sheet.count("<circle") == channels
    picture = tmp_path / "touches.png"
    assert run("view", touched, "--screenshot", picture)["files"] == [str(picture)]
    run("view", touched, "--layer", "structures", "--html", tmp_path / "touches.html")
    run("record", touched, "-o", tmp_path / "again.mcap")
