"""`skinmap flatten` as people use it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.flat import costs
from skinmap.profile import METRICS

PROMISED = {
    "part", "patch", "vertices", "faces", "holes", "cut_mm", "method", "fallback", "flips",
    "quasi_conformal", "area_sd", "symmetric_dirichlet", "stretch_l2", "edge_rms_percent",
    "geodesic_stress", "geodesic_stress_error", "seconds",
}  # fmt: skip


def run(*words: object) -> dict:
    """The JSON that the command prints, and nothing else, on standard output."""
    arguments = ["flatten", *map(str, words), "--json"]
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def forearm(tmp_path_factory) -> tuple[Path, dict]:
    """The folder and the numbers of one run with everything on."""
    out = tmp_path_factory.mktemp("maps")
    return out, run("icub", "--part", "left_forearm", "--compare", "bff", "--out", out)


@pytest.fixture
def sheet(tmp_path, half_cylinder) -> Path:
    path = tmp_path / "sheet.obj"
    write_obj(path, *half_cylinder)
    return path


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, float).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(faces) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")


def test_flatten_prints_what_was_promised(forearm):
    _, result = forearm
    assert [row["patch"] for row in result["patches"]] == [0, 1]
    assert sum(row["vertices"] for row in result["patches"]) == 240
    assert all(row["flips"] == 0 and not row["fallback"] for row in result["patches"])
    assert all(set(row) >= PROMISED for row in result["patches"])
    assert set(result["patches"][0]["quasi_conformal"]) == {"mean", "p95", "max"}
    assert result["seconds"] == pytest.approx(
        sum(row["seconds"] for row in result["patches"]), abs=1e-5
    )


def test_worst_triangles_are_named_by_channel_and_sorted(forearm, icub):
    _, result = forearm
    channels = set(icub.skin("left_forearm").channels.tolist())
    for row in result["patches"]:
        values = [face["value"] for face in row["worst"]]
        assert values == sorted(values, reverse=True)
        assert all(set(face["channels"]) <= channels for face in row["worst"])


def test_other_methods_are_compared_chart_by_chart(forearm):
    _, result = forearm
    assert [(row["with"], row["patch"]) for row in result["compare"]] == [("bff", 0), ("bff", 1)]
    for ours, other in zip(result["patches"], result["compare"], strict=True):
        assert ours["edge_rms_percent"] < other["edge_rms_percent"]  # that is what ARAP is for


def test_flatten_writes_pictures_meshes_and_a_report(forearm):
    out, result = forearm
    assert sorted(path.name for path in out.iterdir()) == sorted(result["files"])
    for name in ("left_forearm.png", "left_forearm_compared.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert not re.search(r"(src|href)=.?(http|file)", page)  # one file, nothing beside it
    for row in result["patches"]:
        for face in row["worst"]:
            assert ", ".join(map(str, face["channels"])) in page


def test_obj_holds_the_map_as_texture_coordinates(forearm, icub, prepared):
    out, _ = forearm
    lines = [line.split() for line in (out / "left_forearm.obj").read_text().splitlines()]
    vertices = np.array([words[1:] for words in lines if words[0] == "v"], float)
    uv = np.array([words[1:] for words in lines if words[0] == "vt"], float)
    corners = np.array([[w.split("/") for w in words[1:]] for words in lines if words[0] == "f"])
    np.testing.assert_array_equal(vertices, icub.skin("left_forearm").positions)
    flat = prepared("left_forearm").flat
    np.testing.assert_array_equal(uv, np.concatenate([chart.uv for chart in flat.charts]))
    place, texture = corners.astype(int)[..., 0] - 1, corners.astype(int)[..., 1] - 1
    np.testing.assert_array_equal(
        place, np.concatenate([chart.taxels[chart.faces] for chart in flat.charts])
    )
    np.testing.assert_array_equal(flat.uv[place], uv[texture])  # no seam here


def test_meshes_with_seams_double_the_texture_not_the_taxels(tmp_path, sphere):
    vertices, faces = sphere
    write_obj(tmp_path / "ball.obj", vertices, faces)
    result = run(tmp_path / "ball.obj", "--out", tmp_path / "out")
    (row,) = result["patches"]
    assert row["cut_mm"] > 0
    text = (tmp_path / "out" / "ball_flat.obj").read_text()
    assert text.count("\nv ") == len(vertices)
    assert text.count("\nvt ") == row["vertices"] > len(vertices)


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "off"])
def test_every_mesh_format_gives_the_same_map(tmp_path, half_cylinder, suffix):
    path = tmp_path / f"sheet.{suffix}"
    trimesh.Trimesh(*half_cylinder, process=False).export(path)
    (row,) = run(path, "--method", "accurate")["patches"]
    assert set(row) >= PROMISED
    assert (row["part"], row["vertices"], row["faces"], row["flips"]) == (path.name, 225, 392, 0)
    assert row["edge_rms_percent"] < 0.4  # the facets of the cylinder; STL keeps seven digits


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_the_size_of_a_mesh_does_not_matter(tmp_path, square_grid, scale):
    vertices, faces = square_grid(9)
    vertices[:, 2] = 0.3 * np.sin(np.pi * vertices[:, 0]) * np.sin(np.pi * vertices[:, 1])
    write_obj(tmp_path / "plain.obj", vertices, faces)
    (plain,) = run(tmp_path / "plain.obj")["patches"]
    write_obj(tmp_path / "sheet.obj", vertices * scale, faces)
    out = ["--out", tmp_path / "out"] if scale < 1 else []
    result = run(tmp_path / "sheet.obj", *out)
    for key in ("edge_rms_percent", "area_sd", "geodesic_stress"):
        assert result["patches"][0][key] == pytest.approx(plain[key], rel=1e-4)
        assert plain[key] > 1e-3
    for name in result["files"]:
        assert (tmp_path / "out" / name).stat().st_size > 5_000  # no empty picture


def test_components_pinches_and_turned_faces_are_sorted_out(tmp_path, square_grid):
    vertices, faces = square_grid(4)
    turned = faces.copy()
    turned[::2] = turned[::2, ::-1]
    # The second sheet touches the first in one corner only.
    second = vertices + [1.0, 1.0, 0.0]
    write_obj(
        tmp_path / "two.obj",
        np.concatenate([vertices, second]),
        np.concatenate([turned, faces + len(vertices)]),
    )
    rows = run(tmp_path / "two.obj")["patches"]
    assert [row["vertices"] for row in rows] == [16, 16]
    assert all(row["flips"] == 0 and row["edge_rms_percent"] < 1e-5 for row in rows)


def test_drawings_are_laid_over_the_charts(tmp_path, icub):
    # Planted: the drawing is our own map of a sole in another place, turned, halved and mirrored;
    # triangles of the drawing format stand where the modules are.
    from skinmap.skin.modules import BUILTIN

    layout = BUILTIN["triangle_10pad"]
    lines = ["[SENSORS]"]
    for k in range(4):
        lines.append(f"triangle_10pad {k} {16.0 * k} {9.2 * (k % 2)} {180 * (k % 2)} 1 0")
    (tmp_path / "sole.ini").write_text("\n".join(lines) + "\n")
    from skinmap.io.flat_maps.drawing import read_drawing

    drawing = read_drawing(tmp_path / "sole.ini")
    rows = ["channel,module,x,y,z,nx,ny,nz"]
    for channel, module, (x, y) in zip(
        drawing.channels, drawing.modules, drawing.xy.tolist(), strict=True
    ):
        rows.append(f"{channel},{module},{x / 2},{-y / 2},0,0,0,1")
    (tmp_path / "sole.csv").write_text("\n".join(rows) + "\n")
    trimesh.creation.box((0.2, 0.2, 1e-3)).export(tmp_path / "plate.stl")
    (tmp_path / "sole.toml").write_text(
        '[robot]\nname = "sole"\nmesh = "plate.stl"\n[[part]]\nname = "sole"\nlink = "body"\n'
        'taxels = "sole.csv"\ndrawing = "sole.ini"\n'
    )
    assert len(drawing) == 4 * int((~layout.thermal).sum())
    result = run(tmp_path / "sole.toml", "--compare", "drawing", "--out", tmp_path / "out")
    (row,) = result["compare"]
    assert (row["with"], row["flips"], row["missing"]) == ("drawing", 0, 0)
    assert row["mirrored"]
    assert row["edge_rms_percent"] < 1e-4
    assert row["distance_mm"] < 1e-4
    assert row["scale"] == pytest.approx(0.5)
    assert "sole_compared.png" in result["files"]


def test_budgets_of_a_profile_choose_the_method(tmp_path, sheet):
    head = f'[profile]\nformat = 1\nskinmap = "{skinmap.__version__}"\n[flatten]\n'
    (tmp_path / "p.toml").write_text(head + "max_edge_rms = 50\n")
    cheap = run(sheet, "--profile", tmp_path / "p.toml")
    assert cheap["profile"]["took"] == {"max_edge_rms": 50}
    assert cheap["metric"] == "edge_strain"
    (tmp_path / "p.toml").write_text(head + 'metric = "area"\n')
    assert run(sheet, "--profile", tmp_path / "p.toml")["metric"] == "area"
    assert tuple(costs.METRICS) == METRICS
    assert cheap["method"] == "auto"
    assert cheap["patches"][0]["method"] == "fast"
    assert cheap["patches"][0]["reason"]


@pytest.mark.parametrize("meshing", ["consensus", "fast", "accurate"])
def test_every_meshing_flattens_a_hand(meshing):
    result = run("icub", "--part", "left_hand", "--meshing", meshing)
    assert result["meshing"] == meshing
    assert result["patches"][0]["vertices"] == 48


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--method", "best"], "no flattening method 'best'; the flattening methods are: .*bff"),
        (["--meshing", "best"], "no meshing method 'best'; the meshing methods are: consensus"),
        (["--compare", "bff,best"], "no flattening method 'best'"),
        (["--compare", "drawing"], "expected `drawing = ...`"),
        (["--compare", "drawing:gone.ini"], "no file 'gone.ini'"),
        (["--part", "tail"], "no part 'tail'"),
        (["--part", "left_hand", "--out", "/proc/maps"], "cannot write to the folder"),
    ],
)
def test_bad_options_are_named(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SkinError, match=message):
        CliRunner().invoke(cli, ["flatten", "icub", *words], catch_exceptions=False)
    assert list(tmp_path.iterdir()) == []


FLAT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 2 0 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "without triangles"),
        (FLAT, "without triangles"),
        (FLAT + "f 1 2 9\n", "not a mesh that can be read"),
        ("v 0 0 nan\n" + FLAT + "f 1 2 3\n", "NaN"),
        (FLAT + "f 1 2 6\n", "bad.obj: none of 1 faces has an area"),
    ],
)
def test_files_that_are_no_surface_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(SkinError, match=message):
        CliRunner().invoke(cli, ["flatten", str(path)], catch_exceptions=False)


def test_a_moebius_strip_is_refused(tmp_path):
    n = 30
    angle = 2 * np.pi * np.arange(n) / n
    across = np.array([-0.2, 0.2])
    radius = 1 + across * np.cos(angle / 2)[:, None]
    strip = np.stack(
        [radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None],
         across * np.sin(angle / 2)[:, None]], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    a = 2 * np.arange(n)
    c, d = np.append(a[1:], 1), np.append(a[1:] + 1, 0)  # the last two are swapped: half a turn
    faces = np.concatenate([np.column_stack([a, c, a + 1]), np.column_stack([a + 1, c, d])])
    write_obj(tmp_path / "strip.obj", strip, faces)
    with pytest.raises(SkinError, match=r"strip.obj: the surface has one side only"):
        CliRunner().invoke(cli, ["flatten", str(tmp_path / "strip.obj")], catch_exceptions=False)


def test_missing_files_folders_and_parts_of_meshes_are_refused(tmp_path, sheet):
    (tmp_path / "folder.obj").mkdir()
    for words, message in (
        (["gone.obj"], "no file 'gone.obj'"),
        ([str(tmp_path / "folder.obj")], "folder.obj' is a folder; expected a mesh file"),
        ([str(sheet), "--part", "left_arm"], "no part 'left_arm'; there are not any parts"),
    ):
        with pytest.raises(SkinError, match=message):
            CliRunner().invoke(cli, ["flatten", *words], catch_exceptions=False)


def test_out_onto_a_file_is_refused(sheet):
    result = CliRunner().invoke(cli, ["flatten", str(sheet), "--out", str(sheet)])
    assert result.exit_code == 2
    assert "is a file" in result.output


def test_tables_for_people_name_what_was_compared(sheet):
    result = CliRunner().invoke(cli, ["flatten", str(sheet), "--compare", "lscm"])
    assert result.exit_code == 0, result.output
    assert "compared with" in result.output
    assert "lscm" in result.output


def test_jobs_change_no_number():
    words = ["flatten", "icub", "--part", "left_foot", "--part", "right_forearm", "--json"]

    def rows(*more: str) -> list[dict]:
        result = CliRunner().invoke(cli, [*words, *more], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        found = json.loads(result.stdout)["patches"]
        return [{key: row[key] for key in row if key != "seconds"} for row in found]

    assert rows("--jobs", "2") == rows()


def test_several_meshes_are_laid_flat_in_one_go(tmp_path, square_grid):
    for name, n in (("a.obj", 5), ("b.obj", 7)):
        write_obj(tmp_path / name, *square_grid(n))
    words = ["flatten", str(tmp_path / "a.obj"), str(tmp_path / "b.obj"), "--json"]
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    found = json.loads(result.stdout)["patches"]
    assert [(row["part"], row["vertices"]) for row in found] == [("a.obj", 25), ("b.obj", 49)]
    mixed = CliRunner().invoke(cli, ["flatten", "icub", str(tmp_path / "a.obj")])
    assert mixed.exit_code == 2
    assert "several mesh files, several CySkin files, or one robot" in mixed.stderr


@pytest.mark.parametrize("names", [("x y.obj", "x_y.obj"), ("a.obj", "a_flat.stl")])
def test_no_mesh_takes_the_files_of_another(tmp_path, square_grid, names):
    import trimesh

    for name, n in zip(names, (5, 7), strict=True):
        trimesh.Trimesh(*square_grid(n), process=False).export(tmp_path / name)
    result = run(*(tmp_path / name for name in names), "--out", tmp_path / "out")
    assert len(set(result["files"])) == len(result["files"]) == 5
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(result["files"])


def refusal(*words: object) -> str:
    """What the command says to input that it cannot take."""
    result = CliRunner().invoke(cli, ["flatten", *map(str, words)])
    if isinstance(result.exception, SkinError):
        return str(result.exception)
    assert result.exit_code == 2
    return result.stderr


@pytest.fixture(scope="module")
def sleeve(tmp_path_factory):
    """A tube as a mesh file, and a recording of touches at one place on it."""
    from skinmap.touch.recording import Recording, save_recordings

    folder = tmp_path_factory.mktemp("sleeve")
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(24), np.arange(20)))
    angle = 2.0 * np.pi * i / 24
    vertices = np.column_stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), 0.2 * j / 19])
    p = np.arange(24 * 19)
    q = p // 24 * 24 + (p + 1) % 24
    lower = np.column_stack([p, q, p + 24])
    faces = np.concatenate([lower, np.column_stack([q, q + 24, p + 24])])
    write_obj(folder / "sleeve.obj", vertices, faces)
    rng, count = np.random.default_rng(0), 40
    pressures, events = [np.zeros((20, len(vertices)))], [-1] * 20
    for event in range(count):
        middle = vertices[24 * 9] + rng.normal(0.0, 0.006, 3)
        push = 200.0 - 8e5 * ((vertices - middle) ** 2).sum(axis=1)
        pressures += [np.clip(push, 0.0, 255.0)[None].repeat(4, 0), np.zeros((4, len(vertices)))]
        events += [event] * 4 + [-1] * 4
    table = np.concatenate(pressures).astype(np.uint8)
    recording = Recording(
        "sleeve", np.arange(len(table)) / 50.0, table, np.array(events), ("poke",) * count
    )
    save_recordings([recording], folder / "touches.npz")
    return folder


def test_a_seam_keeps_out_of_the_touches_of_a_recording(sleeve):
    mesh = sleeve / "sleeve.obj"
    (row,) = run(mesh, "--seam", f"contacts:{sleeve / 'touches.npz'}")["patches"]
    assert 36 <= row["touches"] <= 40  # one or another is too faint to be felt
    assert row["touches_divided"] == 0 < row["touches_divided_shortest"]
    (row,) = run(mesh)["patches"]
    assert row["touches"] is None


def test_a_tube_without_a_seam_says_after_what_it_repeats_itself(sleeve):
    result = run(sleeve / "sleeve.obj", "--seam", "none", "--out", sleeve / "out")
    (row,) = result["patches"]
    assert (row["method"], row["cut_mm"], result["seam"]) == ("periodic", 0.0, "none")
    assert row["period_mm"] == pytest.approx(24 * 80.0 * np.sin(np.pi / 24), rel=1e-4)
    assert {"sleeve.png", "sleeve_flat.obj"} <= set(result["files"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--seam", "contacts"], "write --seam contacts:RECORDING"),
        (["--seam", "contacts:nothing.npz"], "no file 'nothing.npz'"),
        (["--seam", "nowhere"], "contacts:RECORDING, shortest, none"),
        (["--seam", "none", "--max-distortion", "4.1"], "--seam none cuts nothing"),
    ],
)
def test_seams_that_cannot_be_are_refused_in_one_line(sleeve, words, message):
    assert message in refusal(sleeve / "sleeve.obj", *words)


def test_a_file_of_channels_is_the_seam(sleeve):
    path = sleeve / "seam.txt"
    path.write_text("# from rim to rim\n5, 461\n")
    (row,) = run(sleeve / "sleeve.obj", "--seam", path)["patches"]
    assert row["cut_mm"] == pytest.approx(200.0)
    path.write_text("5 461\n7 999\n")
    assert "line 2: no channel 999" in refusal(sleeve / "sleeve.obj", "--seam", path)
