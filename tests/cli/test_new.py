"""`skinmap new`: a manifest from a URDF and tables, and every mistake of a newcomer."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import OutputError, SkinError, UnknownNameError
from skinmap.geometry.triangles import TriangleMesh
from skinmap.io.robots.mesh_file import write_mesh
from skinmap.io.robots.urdf import UrdfBody

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "robot"
LINK = """<link name="{name}"><visual><origin xyz="0 0 0.1"/><geometry>
<cylinder radius="{radius}" length="0.2"/></geometry></visual></link>"""
FIXED = '<joint name="j{name}" type="fixed"><parent link="base"/><child link="{name}"/></joint>'
HEADER = "channel,module,x,y,z,nx,ny,nz"


def urdf(path: Path, **radii: float) -> Path:
    """A base without a mesh that carries tubes."""
    links = [LINK.format(name=name, radius=radius) for name, radius in radii.items()]
    joints = [FIXED.format(name=name) for name in radii]
    text = f'<robot name="two tubes"><link name="base"/>{"".join([*links, *joints])}</robot>'
    path.write_text(text)
    return path


def tube(radius: float, unit: float = 1.0) -> np.ndarray:
    """Taxels 8 mm apart on a tube, 1 mm off it."""
    around = np.arange(0.0, 2 * np.pi, 0.008 / radius)
    angle, height = np.meshgrid(around, np.arange(0.04, 0.16, 0.008))
    radius += 1e-3
    places = [radius * np.cos(angle), radius * np.sin(angle), height]
    return np.stack(places, axis=-1).reshape(-1, 3) / unit


def table(path: Path, places: np.ndarray, first: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{first + k},{k // 12},{x},{y},{z},0,0,0" for k, (x, y, z) in enumerate(places)]
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    return path


def call(*words: object, **more):
    return CliRunner().invoke(cli, ["new", *map(str, words)], **more)


def made(*words: object) -> dict:
    result = call(*words, "--json", catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def inspected(manifest: Path) -> dict:
    result = CliRunner().invoke(cli, ["inspect", str(manifest), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    return json.loads(result.stdout)


def test_the_example_becomes_a_robot_that_is_inspected_as_it_is(tmp_path, recwarn):
    manifest = tmp_path / "mine" / "bot.toml"
    result = made(EXAMPLE / "robot.urdf", "--taxels", EXAMPLE / "forearm.csv", "-o", manifest)
    (part,) = result["parts"]
    assert (part["part"], part["units"], part["link"]) == ("forearm", "mm", "forearm_link")
    assert part["distance_mm"] == pytest.approx(1.06, abs=0.1)
    assert result["files"] == [
        str(manifest.with_name(name)) for name in ("bot.toml", "forearm.csv", "robot.urdf")
    ]
    assert {file.name for file in manifest.parent.iterdir()} == {
        "bot.toml", "forearm.csv", "robot.urdf",
    }  # fmt: skip
    (row,) = inspected(manifest)["parts"]
    assert (row["verdict"], row["taxels"]) == ("ok", 224)
    assert not recwarn.list


def test_files_beside_the_manifest_are_named_and_not_copied(tmp_path):
    for name in ("robot.urdf", "forearm.csv"):
        shutil.copy(EXAMPLE / name, tmp_path)
    (tmp_path / "tables").mkdir()
    (tmp_path / "forearm.csv").rename(tmp_path / "tables" / "arm.csv")
    manifest = tmp_path / "bot.toml"
    result = made(tmp_path / "robot.urdf", "--taxels", tmp_path / "tables/arm.csv", "-o", manifest)
    assert result["files"] == [str(manifest)]
    assert 'taxels = "tables/arm.csv"' in manifest.read_text()
    assert inspected(manifest)["parts"][0]["verdict"] == "ok"


@pytest.mark.parametrize(
    ("unit", "metres"), [("m", 1), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)]
)
def test_the_unit_is_the_one_in_which_the_skin_lies_on_its_link(tmp_path, unit, metres, recwarn):
    body = urdf(tmp_path / "bot.urdf", thin=0.03, thick=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05, metres))
    (part,) = made(body, "--taxels", skin, "-o", tmp_path / "bot.toml")["parts"]
    assert (part["units"], part["link"]) == (unit, "thick")
    assert part["distance_mm"] == pytest.approx(1.0, abs=0.2)
    (row,) = inspected(tmp_path / "bot.toml")["parts"]
    assert (row["verdict"], row["unit"]) == ("ok", "inch" if unit == "in" else unit)
    assert not recwarn.list


def test_several_files_after_one_option_are_one_part_each(tmp_path):
    body = urdf(tmp_path / "bot.urdf", thin=0.02, thick=0.05)
    thin = table(tmp_path / "a" / "skin.csv", tube(0.02, 1e-3))
    thick = table(tmp_path / "b" / "skin.csv", tube(0.05, 1e-2))
    other = table(tmp_path / "b" / "again.csv", tube(0.05))
    manifest = tmp_path / "out" / "bot.toml"
    result = made("--taxels", thin, thick, other, "-o", manifest, body)
    found = [(one["part"], one["units"], one["link"]) for one in result["parts"]]
    assert found == [
        ("a_skin", "mm", "thin"), ("b_skin", "cm", "thick"), ("again", "m", "thick"),
    ]  # fmt: skip
    robot = skinmap.load_robot(manifest)
    assert robot.parts == ("a_skin", "b_skin", "again")
    assert len(robot.skin("a_skin")) == len(tube(0.02))
    given = made(
        body, "--taxels", thin, thick, "--taxels", other, "--link", "thin", "--link", "thick",
        "--link", "thick", "-o", tmp_path / "given.toml",
    )  # fmt: skip
    assert [one["link"] for one in given["parts"]] == ["thin", "thick", "thick"]


@pytest.mark.parametrize("as_json", [False, True])
def test_links_that_fit_alike_end_in_one_line_and_their_candidates(tmp_path, as_json):
    body = urdf(tmp_path / "bot.urdf", left=0.05, right=0.05, thin=0.02)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3))
    manifest = tmp_path / "out" / "bot.toml"
    result = call(body, "--taxels", skin, "-o", manifest, *["--json"] * as_json)
    assert result.exit_code == 2
    (line,) = result.stderr.strip().splitlines()[-1:]
    assert "--link left|right" in line
    assert "--units" not in line
    if as_json:
        told = json.loads(result.stdout)
        assert told["unclear"] == {"skin": ["link"]}
        nearest = [(one["link"], one["units"]) for one in told["candidates"]]
        assert nearest == [("left", "mm"), ("right", "mm"), ("thin", "mm")]
        assert told["candidates"][2]["distance_mm"] == pytest.approx(31.0, abs=0.2)
    else:
        rows = result.stdout.splitlines()
        assert [row.split()[1] for row in rows[2:5]] == ["left", "right", "thin"]
    assert not manifest.parent.exists()
    (part,) = made(body, "--taxels", skin, "--link", "right", "-o", manifest)["parts"]
    assert (part["link"], part["units"]) == ("right", "mm")


def test_a_mesh_that_is_not_there_is_named_and_its_link_is_still_in_question(tmp_path):
    body = urdf(tmp_path / "bot.urdf", thin=0.02, wide=0.057)
    lost = '<mesh filename="package://bot/lost.stl"/>'
    text = body.read_text().replace('<cylinder radius="0.02" length="0.2"/>', lost)
    body.write_text(text)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3))
    result = call(body, "--taxels", skin, "-o", tmp_path / "bot.toml")
    assert result.exit_code == 2
    assert "mesh of thin cannot be read: no file 'package://bot/lost.stl'" in result.stdout
    assert "--link wide|thin" in result.stderr


def test_a_unit_in_which_the_skin_lies_on_no_link_is_named(tmp_path):
    body = urdf(tmp_path / "bot.urdf", left=0.05, right=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3))
    result = call(body, "--taxels", skin, "--units", "cm", "-o", tmp_path / "bot.toml")
    assert result.exit_code == 2
    assert "skin fits no mesh in cm: the nearest, of left, is" in result.stderr


def test_a_body_without_meshes_leaves_units_open_that_fit_by_the_pitch(tmp_path):
    (tmp_path / "bot.urdf").write_text('<robot name="r"><link name="body"/></robot>')
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-2))
    words = (tmp_path / "bot.urdf", "--taxels", skin, "-o", tmp_path / "bot.toml")
    result = call(*words)
    assert result.exit_code == 2
    assert "--units cm|in" in result.stderr
    assert "--link" not in result.stderr
    assert all(unit in result.stdout.split() for unit in ("cm", "in", "m", "mm"))
    assert not (tmp_path / "bot.toml").exists()
    made(*words, "--units", "cm")
    with pytest.warns(skinmap.SkinWarning, match="no body mesh"):
        (row,) = inspected(tmp_path / "bot.toml")["parts"]
    assert row["verdict"] == "check the link, which has no mesh"
    assert row["pitch_mm"]["median"] == pytest.approx(8.0, abs=0.1)


def test_a_terminal_is_asked(tmp_path, monkeypatch):
    monkeypatch.setattr("skinmap.cli.new.in_terminal", lambda: True)
    body = urdf(tmp_path / "bot.urdf", left=0.05, right=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3))
    result = call(body, "--taxels", skin, "-o", tmp_path / "bot.toml", input="middle\nright\n")
    assert result.exit_code == 0, result.output
    assert "link of skin (left, right) [left]:" in result.stdout
    assert 'link = "right"' in (tmp_path / "bot.toml").read_text()


def test_a_stated_unit_is_taken_and_a_better_one_named(tmp_path):
    body = urdf(tmp_path / "bot.urdf", arm=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3))
    manifest = tmp_path / "bot.toml"
    with pytest.warns(skinmap.SkinWarning, match=r"in cm, as --units states.*; in mm taxels are 8"):
        made(body, "--taxels", skin, "--units", "cm", "-o", manifest)
    assert 'units = "cm"' in manifest.read_text()
    off = table(tmp_path / "off.csv", (tube(0.05) + [0, 0, 0.5]) / 1e-3)
    with pytest.warns(skinmap.SkinWarning, match="mm off the mesh of arm: check units, link"):
        made(body, "--taxels", off, "-o", tmp_path / "off.toml")
    places = tube(0.05)
    places[: len(places) // 3] += [0, 0, 0.5]  # most lie well: the warning names those that do not
    some = table(tmp_path / "some.csv", places / 1e-3)
    with pytest.warns(skinmap.SkinWarning, match=r"over \d{3} mm off the mesh of arm"):
        made(body, "--taxels", some, "-o", tmp_path / "some.toml")


def brick(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    write_mesh(TriangleMesh(corners, faces), path)


MESHES = {
    "mesh.ply": "mesh.ply",
    "parts/mesh.ply": "parts/mesh.ply",
    "../meshes/mesh.ply": "meshes/mesh.ply",
    "package://arm/meshes/mesh.ply": "arm/meshes/mesh.ply",
}


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("said", MESHES)
def test_meshes_from_elsewhere_come_along(tmp_path, said, inside):
    home = tmp_path / "arm" / "urdf"
    home.mkdir(parents=True)
    name = said.removeprefix("package://arm/")
    mesh = (tmp_path / "arm" / name if "package" in said else home / name).resolve()
    brick(mesh)
    text = f"""<robot name="r"><link name="body"><visual><geometry>
      <mesh filename="{said}"/></geometry></visual><collision><geometry>
      <mesh filename="package://nowhere/a.stl"/></geometry></collision></link></robot>"""
    (home / "r.urdf").write_text(text)
    grid = np.array([[x, y, 0] for x in range(10, 50, 8) for y in range(10, 50, 8)], float)
    skin = table(tmp_path / "skin.csv", grid)
    manifest = (home if inside else tmp_path / "new") / "bot.toml"
    result = made(home / "r.urdf", "--taxels", skin, "-o", manifest)
    assert result["parts"][0]["units"] == "mm"
    if not inside or said.startswith((".", "package")):
        assert str(manifest.with_name("x").parent / MESHES[said]) in result["files"]
    assert (home / "r.urdf").read_text() == text
    shutil.rmtree(tmp_path / "arm" / "meshes", ignore_errors=True)
    assert inspected(manifest)["parts"][0]["distance_mm"]["median"] < 1e-6
    named = tomllib.loads(manifest.read_text())["robot"]["urdf"]
    assert named == ("r_here.urdf" if inside and said.startswith("..") else "r.urdf")
    assert UrdfBody(manifest.parent / named).links == ("body",)


def test_a_manifest_that_loses_parts_is_named(tmp_path):
    robot = urdf(tmp_path / "r.urdf", a=0.05, b=0.08)
    one, other = (table(tmp_path / f"{n}.csv", tube(r)) for n, r in (("one", 0.05), ("two", 0.08)))
    words = (robot, "--units", "m", "-o", tmp_path / "r.toml", "--taxels", one)
    made(*words, other)
    made(*words, other)  # the same parts
    with pytest.warns(skinmap.SkinWarning, match=r"r.toml \(2 parts before: one, two\)"):
        made(*words)


def test_a_file_of_somebody_else_is_never_replaced_by_a_copy(tmp_path):
    out = tmp_path / "out"
    theirs = table(out / "forearm.csv", tube(0.05))
    before = theirs.read_bytes()
    words = (EXAMPLE / "robot.urdf", "--taxels", EXAMPLE / "forearm.csv", "-o", out / "bot.toml")
    result = call(*words)
    assert isinstance(result.exception, OutputError)
    assert "forearm.csv' is there already; --force replaces it" in str(result.exception)
    assert [file.name for file in out.iterdir()] == ["forearm.csv"]
    assert theirs.read_bytes() == before
    assert made(*words, "--force")["files"][1:] == [str(theirs), str(out / "robot.urdf")]
    assert theirs.read_bytes() == (EXAMPLE / "forearm.csv").read_bytes()
    again = made(*words)  # what this command made, and copies that are the same
    assert again["files"] == [str(out / "bot.toml")]
    (out / "bot.toml").write_text("# mine\n")
    assert "--force replaces it" in str(call(*words).exception)
    assert (out / "bot.toml").read_text() == "# mine\n"


WRONG = {
    "taxels.csv --taxels taxels.csv -o b.toml": "not a URDF file",
    "bot.toml --taxels taxels.csv -o b.toml": "is a manifest already",
    "mesh.stl --taxels taxels.csv --link forearm -o b.toml": "no link 'forearm'",
    "none.urdf --taxels taxels.csv -o b.toml": "no file",
    "bot.urdf --taxels none.csv -o b.toml": "expected a taxel table",
    "bot.urdf --taxels . -o b.toml": "expected a taxel table",
    "bot.urdf --taxels taxels.csv taxels.csv -o b.toml": "twice",
    "bot.urdf --taxels taxels.csv": "-o",
    "bot.urdf -o b.toml": "--taxels",
    "--taxels taxels.csv -o b.toml": "ROBOT.urdf",
    "bot.urdf --taxels taxels.csv -o b.json": "ends in .toml",
    "bot.urdf --taxels taxels.csv -o bot.urdf": "is there already",
    "bot.urdf --taxels taxels.csv --units feet -o b.toml": "'m', 'cm', 'mm', 'in'",
    "bot.urdf --taxels taxels.csv --link forarm -o b.toml": "did you mean 'forearm'",
    "bot.urdf --taxels taxels.csv --link base --link forearm -o b.toml": "2 times for 1 tables",
    "bot.urdf --taxels three.csv -o b.toml": "only x,y,z are needed",
    "bot.urdf --taxels empty.csv -o b.toml": "no taxel",
    "bot.urdf --taxels nan.csv -o b.toml": "finite",
}


@pytest.mark.parametrize("words", WRONG)
def test_a_mistake_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    urdf(tmp_path / "bot.urdf", forearm=0.05)
    table(tmp_path / "taxels.csv", tube(0.05))
    (tmp_path / "bot.toml").write_text("[robot]\n")
    brick(tmp_path / "mesh.stl")
    (tmp_path / "three.csv").write_text("x,y\n1,2\n")
    (tmp_path / "empty.csv").write_text(HEADER + "\n")
    (tmp_path / "nan.csv").write_text(HEADER + "\n0,0,nan,0,0,0,0,0\n")
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    result = call(*words.split())
    if isinstance(result.exception, SkinError):
        told = str(result.exception)
    else:
        assert result.exit_code == 2
        told = result.stderr
    assert WRONG[words] in told
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_table_that_a_spreadsheet_saved_is_read(tmp_path):
    body = urdf(tmp_path / "bot.urdf", arm=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3))
    text = skin.read_text().replace(",", ";").replace(".", ",")
    skin.write_text(text, encoding="utf-8-sig")
    (part,) = made(body, "--taxels", skin, "-o", tmp_path / "bot.toml")["parts"]
    assert part["units"] == "mm"


def test_inspect_ends_in_a_verdict_and_the_next_command(tmp_path):
    body = urdf(tmp_path / "bot.urdf", arm=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05, 1e-3), first=1)
    manifest = tmp_path / "bot.toml"
    made(body, "--taxels", skin, "-o", manifest)
    lines = CliRunner().invoke(cli, ["inspect", str(manifest)]).stdout.splitlines()
    assert lines[-1] == f"verdict: ok; next: skinmap flatten {manifest} --out maps"
    assert any("channels begin at 1" in line for line in lines)
    with pytest.warns(skinmap.SkinWarning):
        lines = CliRunner().invoke(cli, ["inspect", str(skin)]).stdout.splitlines()
    assert f"next: skinmap new ROBOT.urdf --taxels {skin} -o robot.toml" in lines[-1]
    lines = CliRunner().invoke(cli, ["inspect", "icub"]).stdout.splitlines()
    assert lines[-1].startswith("verdict: check the module numbers against the hardware (left_")


def test_no_link_of_that_name_names_all_there_are(tmp_path):
    body = urdf(tmp_path / "bot.urdf", arm=0.05)
    skin = table(tmp_path / "skin.csv", tube(0.05))
    result = call(body, "--taxels", skin, "--link", "leg", "-o", tmp_path / "b.toml")
    assert isinstance(result.exception, UnknownNameError)
    assert "base, arm" in str(result.exception)


def test_units_and_links_that_fit_in_pairs_are_both_asked_for(tmp_path):
    body = urdf(tmp_path / "bot.urdf", thin=0.02, thick=0.0508)  # an inch is 2.54 cm
    skin = table(tmp_path / "skin.csv", tube(0.0508, 0.0254))
    result = call(body, "--taxels", skin, "-o", tmp_path / "b.toml")
    assert result.exit_code == 2
    assert "--units cm|in" in result.stderr
    assert "--link thin|thick" in result.stderr
    for given, other in (("--units", "in"), ("--link", "thick")):
        (part,) = made(body, "--taxels", skin, given, other, "-o", tmp_path / f"{other}.toml")[
            "parts"
        ]
        assert (part["units"], part["link"]) == ("in", "thick")


@pytest.mark.parametrize(("mesh_unit", "table_unit"), [("m", "m"), ("mm", "cm"), ("in", "mm")])
def test_one_mesh_is_a_robot_in_the_units_that_lay_its_skin_on_it(
    mesh_unit, table_unit, tmp_path, monkeypatch
):
    import trimesh

    metres = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
    monkeypatch.chdir(tmp_path)
    solid = trimesh.creation.cylinder(0.05, 0.2, sections=64)
    solid.apply_translation([0, 0, 0.1])
    solid.apply_scale(1 / metres[mesh_unit])
    solid.export("tube.stl")
    table(Path("sleeve.csv"), tube(0.05, metres[table_unit]))
    words = ["new", "tube.stl", "--taxels", "sleeve.csv", "-o", "own/robot.toml", "--json"]
    out = CliRunner().invoke(cli, words)
    assert out.exit_code == 0, out.output
    result = json.loads(out.stdout)
    assert (result["robot"], result["parts"][0]["units"]) == ("tube", table_unit)
    written = tomllib.loads(Path("own/robot.toml").read_text())
    assert written["robot"] == {"name": "tube", "mesh": "tube.stl", "units": mesh_unit}
    skin = skinmap.load_robot("own/robot.toml").skin("sleeve")
    assert np.allclose(np.hypot(*skin.positions[:, :2].T), 0.051)


def sleeve(folder: Path, unit: str, pitch: float) -> list[str]:
    """Words for a round mesh and a skin on it, both in one unit."""
    import trimesh

    metres = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}[unit]
    solid = trimesh.creation.cylinder(0.05, 0.2, sections=64)
    solid.apply_scale(1 / metres)
    solid.export(folder / "tube.stl")
    angle, height = np.meshgrid(np.arange(0, np.pi, pitch / 0.05), np.arange(-0.08, 0.08, pitch))
    places = [0.05 * np.cos(angle), 0.05 * np.sin(angle), height]
    skin = table(folder / "skin.csv", np.stack(places, axis=-1).reshape(-1, 3) / metres)
    return [str(folder / "tube.stl"), "--taxels", str(skin), "-o", str(folder / "r.toml")]


@pytest.mark.parametrize(
    ("unit", "pitch", "others"),
    [("in", 6.3e-3, "cm|in"), ("cm", 20e-3, "cm|mm"), ("mm", 6e-3, ""), ("m", 6e-3, "")],
)
def test_a_mesh_and_a_table_that_fit_in_two_pairs_of_units_are_asked_for(
    tmp_path, monkeypatch, unit, pitch, others
):
    words = sleeve(tmp_path, unit, pitch)
    if others:
        result = call(*words)
        assert result.exit_code == 2
        assert f"--units {others}" in result.stderr
        assert not (tmp_path / "r.toml").exists()
        monkeypatch.setattr("skinmap.cli.new.in_terminal", lambda: True)
        assert call(*words, input=f"{unit}\n").exit_code == 0
        words += ["--units", unit, "--force"]
        assert f'units = "{unit}"' in (tmp_path / "r.toml").read_text()
    assert made(*words)["parts"][0]["units"] == unit
    mesh = skinmap.load_robot(tmp_path / "r.toml").body.mesh("body")
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.1, 0.1, 0.2], rel=1e-3)


def test_the_pitch_of_a_thin_board_is_not_its_thickness(tmp_path):
    (tmp_path / "r.urdf").write_text(
        '<robot name="r"><link name="a"><visual><geometry><box size="0.12 0.08 0.0008"/>'
        "</geometry></visual></link></robot>"
    )
    x, y, z = np.meshgrid(np.arange(-45, 46, 6), np.arange(-30, 31, 6), [-0.4, 0.4])
    skin = table(tmp_path / "skin.csv", np.column_stack([x.ravel(), y.ravel(), z.ravel()]))
    (part,) = made(tmp_path / "r.urdf", "--taxels", skin, "-o", tmp_path / "r.toml")["parts"]
    assert (part["units"], part["pitch_mm"]) == ("mm", pytest.approx(6))
    (row,) = inspected(tmp_path / "r.toml")["parts"]
    assert row["pitch_mm"]["median"] == pytest.approx(6)


@pytest.mark.parametrize(("sign", "verdict"), [(1, "ok"), (-1, "check the module layout")])
def test_a_mirrored_module_layout_is_the_verdict(tmp_path, sign, verdict):
    urdf(tmp_path / "bot.urdf", arm=0.05)
    places = 6.0 * np.array([[x, y] for x in range(4) for y in range(4)])
    slots = [f"{k},{sign * x},{y},0" for k, (x, y) in enumerate(places)]
    (tmp_path / "lay.csv").write_text("\n".join(["slot,x_mm,y_mm,thermal", *slots]))
    rows = []
    for module, angle in enumerate(np.arange(0, 6, 0.5)):  # x runs to the right, seen from outside
        turn = angle + places[:, 0] / 50
        round_ = np.column_stack([50 * np.cos(turn), 50 * np.sin(turn), 100 + places[:, 1]])
        rows += [f"{16 * module + k},{module},{x},{y},{z}" for k, (x, y, z) in enumerate(round_)]
    (tmp_path / "skin.csv").write_text("\n".join(["channel,module,x,y,z", *rows]))
    (tmp_path / "r.toml").write_text(
        '[robot]\nname = "r"\nurdf = "bot.urdf"\n[[part]]\nname = "arm"\nlink = "arm"\n'
        'taxels = "skin.csv"\nunits = "mm"\nmodule = "lay.csv"\n'
    )
    assert inspected(tmp_path / "r.toml")["parts"][0]["verdict"] == verdict
