from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import SkinError, SkinWarning
from skinmap.report.result import plain


def run(*words: str) -> dict:
    """The JSON that a command prints, and nothing else, on standard output."""
    result = CliRunner().invoke(cli, [*words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def run_process(*words: str) -> subprocess.CompletedProcess[str]:
    script = "import sys; from skinmap.cli.main import main; sys.argv[0] = 'skinmap'; main()"
    return subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, timeout=120
    )


def test_inspect_counts_and_measures_a_part():
    result = run("inspect", "icub", "--part", "left_foot")
    (part,) = result["parts"]
    assert (part["name"], part["link"], part["taxels"], part["modules"]) == (
        "left_foot", "l_foot", 250, 25,
    )  # fmt: skip
    assert part["pitch_mm"]["median"] == pytest.approx(6.533, abs=0.05)
    assert part["distance_mm"]["max"] < 1.0
    assert (part["verdict"], part["warnings"], part["inward"]) == ("ok", [], 0)


def test_inspect_names_swapped_modules():
    (part,) = run("inspect", "icub", "--part", "right_foot")["parts"]
    assert len(part["swapped"]) == 12
    assert part["verdict"] == "check the module numbers against the hardware"
    assert "modules stand where the URDF has others: 0 at 4" in part["warnings"][0]


@pytest.mark.filterwarnings("ignore:no body mesh")
def test_inspect_names_the_channels_of_taxels_at_one_place(tmp_path):
    rows = ["channel,module,x,y,z,nx,ny,nz"]
    grid = [(5e-3 * i, 5e-3 * j) for i in range(6) for j in range(5)]
    grid[17] = grid[4]
    rows += [f"{k},{k // 10},{x},{y},0,0,0,1" for k, (x, y) in enumerate(grid)]
    (tmp_path / "twice.csv").write_text("\n".join(rows) + "\n")
    (part,) = run("inspect", str(tmp_path / "twice.csv"))["parts"]
    assert part["warnings"] == ["channels at one place: 4 and 17"]
    assert part["verdict"] == "check the places of these channels"
    rows[11:21] = [f"{k},1,0.1,0.1,0,0,0,1" for k in range(10, 20)]
    (tmp_path / "module.csv").write_text("\n".join(rows) + "\n")
    (part,) = run("inspect", str(tmp_path / "module.csv"))["parts"]
    assert part["warnings"] == ["all taxels of module 1 are at one place"]
    assert part["verdict"] == "name the module layout"


def test_inspect_and_flatten_name_taxels_without_a_surface(tmp_path):
    grid = [(5 * i, 5 * j) for i in range(6) for j in range(5)] + [(90, 0), (90, 60)]
    rows = ["channel,module,x,y,z,nx,ny,nz"]
    rows += [f"{k},0,{x},{y},0,0,0,1" for k, (x, y) in enumerate(grid)]
    (tmp_path / "skin.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "body.stl").write_text(
        "solid b\nfacet normal 0 0 1\nouter loop\nvertex -1 -1 0\nvertex 1 -1 0\n"
        "vertex 0 1 0\nendloop\nendfacet\nendsolid b\n"
    )
    (tmp_path / "r.toml").write_text(
        '[robot]\nname = "r"\nmesh = "body.stl"\nunits = "m"\n[[part]]\nname = "skin"\n'
        'link = "body"\ntaxels = "skin.csv"\nunits = "mm"\n'
    )
    (part,) = run("inspect", str(tmp_path / "r.toml"))["parts"]
    assert part["warnings"] == ["2 taxels are in no triangle: channels 30, 31"]
    assert part["verdict"] == "check the taxels without a surface"
    with pytest.warns(SkinWarning, match="'skin': 2 taxels are in no triangle: channels 30, 31"):
        run("flatten", str(tmp_path / "r.toml"))


def test_inspect_reads_a_bare_table(tmp_path):
    from skinmap.io.robots.manifest import data_folder

    path = data_folder() / "icub" / "taxels" / "left_foot.csv"
    (part,) = run("inspect", str(path), "--module", "triangle_10pad")["parts"]
    assert (part["name"], part["taxels"], part["distance_mm"]) == ("left_foot", 250, None)
    assert part["module_side_mm"] == pytest.approx(33.46, abs=0.05)


def test_structures_of_a_sole_are_few(tmp_path):
    result = run("structures", "--part", "left_foot", "--out", str(tmp_path))
    assert result["structures"] == len(result["table"]) <= 7  # a 10-pad tiling has 7 at most
    assert sum(row["taxels"] for row in result["table"]) == result["taxels"] == 250
    assert (tmp_path / "structures.png").exists()


def test_simulate_train_classify_and_back(tmp_path):
    recording, model = tmp_path / "t.npz", tmp_path / "m.skinmodel"
    made = run(
        "simulate", "icub", "--part", "left_foot", "--part", "right_hand",
        "--per-gesture", "10", "-o", str(recording),
    )  # fmt: skip
    assert {row["part"] for row in made["parts"]} == {"left_foot", "right_hand"}
    trained = run("train", str(recording), "--part", "left_foot", "-o", str(model))
    assert trained["tested"]["same_parts"] == 12
    assert trained["accuracy"]["same_parts"] >= 0.75  # 12 touches, 28 to learn from
    named = run("classify", str(model), str(recording), "--part", "right_hand")
    assert named["events"] == sum(made["parts"][1]["touches"].values())
    assert {row["event"] for row in named["touches"]} == set(range(named["events"]))
    assert {row["part"] for row in named["touches"]} == {"right_hand"}
    assert all(0 <= row["confidence"] <= 1 for row in named["touches"])
    alone = run("classify", str(recording))  # by the model that comes with Skinmap
    assert alone["events"] == sum(sum(part["touches"].values()) for part in made["parts"])
    assert alone["accuracy"] >= 0.75


def test_pairs_are_named_one_by_one(tmp_path):
    alone, pairs, model = tmp_path / "t.npz", tmp_path / "p.npz", tmp_path / "m.skinmodel"
    foot = ("--part", "left_foot")
    run("simulate", "icub", *foot, "--per-gesture", "14", "-o", str(alone))
    run("train", str(alone), "-o", str(model))
    made = run(
        "simulate", "icub", *foot, "--gesture", "pairs", "--gesture", "poke",
        "--per-gesture", "3", "--fault", "dead=0.02",
        "--fault", "noise=1", "-o", str(pairs),
    )  # fmt: skip
    assert made["parts"][0]["touches"] == {"poke+poke": 3}
    named = run("classify", str(model), str(pairs))
    assert named["events"] == 3
    assert len(named["touches"]) > 3  # some pair is told apart; tests/touch has the rule itself
    assert {row["recorded_label"] for row in named["touches"]} == {"poke"}
    with pytest.raises(
        SkinError, match="no recorded part 'torso'; the only recorded part is left_foot"
    ):
        run("classify", str(model), str(pairs), "--part", "torso")


def test_same_seed_writes_the_same_recording(tmp_path):
    for name in ("a.npz", "b.npz"):
        run(
            "simulate", "--part", "left_hand", "--per-gesture", "1", "--seed", "4",
            "-o", str(tmp_path / name),
        )  # fmt: skip
    from skinmap.touch.recording import load_recordings

    one, other = (load_recordings(tmp_path / name)[0] for name in ("a.npz", "b.npz"))
    assert (one.pressures == other.pressures).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("inspect", "icu"), "no robot .*'icu'; did you mean 'icub'. The robots are: .*icub"),
        (("inspect", "icub", "--part", "tail"), "no part 'tail'; the parts are: torso"),
        (("flatten", "icub", "--method", "best"), "no flattening method 'best'"),
        (("flatten", "gone.toml"), r"no file 'gone\.toml'"),
        (("structures", "--radius-mm", "-1"), "must lie in 0.1..1000, or auto"),
        (("simulate", "--gesture", "slap", "--part", "torso", "-o", "x.npz"), "no gesture 'slap'"),
        (("simulate", "--part", "torso", "--fault", "dead=2"), "2.0 is not in the range 0<=x<=1"),
        (("simulate", "--part", "torso", "--fault", "dad=0.1"), "no fault 'dad'; did you mean"),
        (("simulate", "--part", "torso", "--fault", "dead"), "'' is not a number"),
        (("simulate", "--part", "torso", "--dead", "0.1"), "removed: write --fault dead=VALUE"),
        (("inspect", "icub", "--allow-outside"), "removed: set SKINMAP_ALLOW_OUTSIDE=1"),
        (("simulate", "--part", "left_hand", "-o", "/proc/x/y.npz"), "cannot write"),
        (("train", "gone.npz"), r"no file 'gone\.npz'"),
        (("classify", "gone.skinmodel", "gone.npz"), r"no file 'gone\.skinmodel'"),
        (("classify", "touch.skinmodel"), "touch.skinmodel is a model: name what it should"),
        (("classify", "a.skinmodel", "b.npz", "c.npz"), "a model and one source, got 3"),
        (("dance",), "no command 'dance'; the commands are: demo, new, inspect"),
        (
            ("calibrate", "wrp"),
            "no command 'wrp'; did you mean 'wrap'\\? The commands are: wrap, batch",
        ),
        (("inspect", "--size", "3"), "No such option"),
    ],
)
def test_bad_input_is_one_clear_line_and_exit_2(words, message, tmp_path, monkeypatch):
    import re

    monkeypatch.chdir(tmp_path)
    result = run_process(*words)
    assert result.returncode == 2
    assert result.stdout == ""
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert re.search(message, line)
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_debug_shows_the_traceback():
    result = run_process("--debug", "inspect", "icu")
    assert result.returncode == 2
    assert "Traceback" in result.stderr


def test_errors_of_ours_reach_python_as_they_are():
    with pytest.raises(SkinError, match="no robot"):
        CliRunner().invoke(cli, ["inspect", "icu"], catch_exceptions=False)


def test_tables_for_people_name_every_part():
    result = CliRunner().invoke(cli, ["inspect", "icub", "--part", "left_hand"])
    assert result.exit_code == 0
    assert "left_hand" in result.output
    assert "covered" in result.output


def test_plain_turns_what_json_lacks_into_null():
    import numpy as np

    assert plain({"a": np.inf, "b": [np.nan, np.float64(1.5), np.int64(3)]}) == {
        "a": None,
        "b": [None, 1.5, 3],
    }


def test_inspect_leaves_repairs_out_when_asked():
    words = ("inspect", "--part", "left_foot", "--skip", "normals")
    (part,) = run(*words)["parts"]
    assert part["normals_repaired"] == 0
    assert part["normal_angle_deg"]["median"] > 45
    result = run_process("inspect", "--part", "left_foot", "--skip", "polish")
    assert result.returncode == 2
    assert "no repair step 'polish'; the repair steps are: units, thermal" in result.stderr


def test_flatten_takes_any_mesh_file(tmp_path):
    import trimesh

    path = tmp_path / "tube.obj"
    mesh = trimesh.creation.cylinder(0.05, 0.2, sections=32)
    caps = np.abs(mesh.face_normals[:, 2]) > 0.5
    mesh.update_faces(~caps)
    mesh.export(path)
    (row,) = run("flatten", str(path), "--method", "bff")["patches"]
    assert (row["flips"], row["method"], row["fallback"]) == (0, "bff", False)
    assert row["cut_mm"] == pytest.approx(200.0)
    assert row["edge_rms_percent"] < 0.5
    result = run_process("flatten", str(tmp_path / "gone.obj"))
    assert (result.returncode, "no file" in result.stderr) == (2, True)


@pytest.mark.parametrize(
    "words",
    [
        ("inspect", "--part", "left_foot"),
        ("flatten", "--part", "left_hand"),
        ("structures", "--part", "left_hand"),
    ],
)
def test_every_key_that_json_has_is_documented(words):
    from pathlib import Path

    text = (Path(__file__).parents[2] / "docs" / "json.md").read_text()
    result = run(*words)
    rows = [row for value in result.values() if isinstance(value, list) for row in value]
    keys = {*result, *(key for row in rows if isinstance(row, dict) for key in row)}
    assert [key for key in sorted(keys) if f"`{key}`" not in text] == []


@pytest.mark.parametrize(("drawing", "missing"), [("left_arm_V2_7.ini", 0), ("left_arm.ini", None)])
def test_inspect_compares_with_a_drawing(tmp_path, drawing, missing):
    import shutil
    from pathlib import Path

    gui = Path(__file__).parents[3] / "shared" / "data" / "icub-main" / "skinGui"
    if not gui.is_dir():
        pytest.skip("the drawings of icub-main are not beside the checkout")
    from skinmap.io.robots.manifest import data_folder

    shutil.copy(data_folder() / "icub" / "taxels" / "left_arm.csv", tmp_path)
    shutil.copy(gui / drawing, tmp_path)
    path = tmp_path / "arm.toml"
    path.write_text(
        '[robot]\nname = "arm"\nurdf = "icub-models:iCubGazeboV2_7"\n[[part]]\nname = "left_arm"\n'
        f'link = "l_upper_arm"\ntaxels = "left_arm.csv"\ndrawing = "{drawing}"\n'
    )
    result = run_process("inspect", str(path), "--json")
    assert result.returncode == 0, result.stderr
    (part,) = json.loads(result.stdout)["parts"]
    if missing == 0:
        assert (part["drawing"]["missing"], part["drawing"]["extra"]) == (0, 0)
        assert part["verdict"] == "ok"
    else:
        assert part["drawing"]["missing"] > 0
        assert part["verdict"] == "name the drawing that belongs to the table"


def test_classify_notes_a_skin_that_is_too_coarse_for_a_finger(capsys):
    from skinmap.cli.classify.live_naming import _note_coarse
    from skinmap.skin.skin import skin_from_points
    from skinmap.touch.prepared_skin import PreparedSkin

    grid = np.array([(x, y, 0) for x in range(5) for y in range(5)], float)
    up = np.tile([0.0, 0.0, 1.0], (25, 1))
    _note_coarse(PreparedSkin(skin_from_points(step * grid, up, part="p")) for step in (8e-3, 0.03))
    assert capsys.readouterr().err.count("taxels of 'p' lie 30 mm apart") == 1
