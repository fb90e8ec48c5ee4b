"""`skinmap calibrate wrap`: files in, files out, and what stays untouched when it fails."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, SkinError
from skinmap.io.taxels.taxel_table import read_taxels

KEYS = {
    "mirrored", "predicted_mm", "leave_one_out_mm", "leave_one_out_expected_mm", "evidence",
    "strain_percent", "expected_strain_percent", "unexpected_strain_percent",
    "status", "reasons", "taxels", "predicted_sd_mm", "cross_validation_mm", "seconds", "coverage",
    "scale", "height_mm", "weakest", "next", "files", "mesh_notes",
}  # fmt: skip


def write(folder, bent, *, unit=1.0, taxels=None, noise=0.5e-3, mirrored=False):
    folder.mkdir(exist_ok=True)
    taxels = bent.corners if taxels is None else np.asarray(taxels)
    points = bent.places[taxels] + np.random.default_rng(2).normal(0, noise, (len(taxels), 3))
    drawn = bent.layout * ([-1.0, 1.0] if mirrored else [1.0, 1.0])
    rows = [f"{k + 100},{x!r},{y!r}" for k, (x, y) in enumerate((drawn / unit).tolist())]
    (folder / "board.csv").write_text("\n".join(["channel,x,y", *rows]) + "\n")
    rows = [
        f"{taxel + 100},{x!r},{y!r},{z!r}"
        for taxel, (x, y, z) in zip(taxels.tolist(), (points / unit).tolist(), strict=True)
    ]
    (folder / "anchors.csv").write_text("\n".join(["channel,x,y,z", *rows]) + "\n")
    trimesh.Trimesh(bent.vertices / unit, bent.faces).export(folder / "link.ply")
    return [
        "calibrate", "wrap", "--layout", str(folder / "board.csv"), "--mesh",
        str(folder / "link.ply"), "--anchors", str(folder / "anchors.csv"), "-o",
        str(folder / "out"), "--json",
    ]  # fmt: skip


def run(words, code=0):
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == code, (result.output, result.exception)
    return json.loads(result.stdout)


def test_wrap_writes_a_table_and_a_report(tmp_path, bent):
    result = run(write(tmp_path, bent))
    assert set(result) == KEYS
    assert result["status"] == "ok"
    assert result["taxels"] == len(bent.layout)
    assert set(result["predicted_sd_mm"]) == {"median", "p95", "max"}
    table = read_taxels(tmp_path / "out" / "taxels.csv")
    assert table.channels.tolist() == list(range(100, 172))
    apart = np.linalg.norm(table.positions - bent.places, axis=1)
    assert np.median(apart) < 1.5e-3
    icub = tmp_path / "taxels.txt"
    own = str(tmp_path / "out" / "taxels.csv")
    assert (
        CliRunner().invoke(cli, ["export", own, "--format", "icub", "-o", str(icub)]).exit_code == 0
    )
    icub = read_taxels(icub)
    np.testing.assert_array_equal(icub.positions, table.positions)
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "http" not in page  # self-contained


def test_wrap_of_a_board_drawn_from_its_other_side_wants_mirror(tmp_path, bent):
    words = write(tmp_path, bent, mirrored=True)
    result = CliRunner().invoke(cli, [*words, "--json"])
    assert result.exit_code == 3
    told = json.loads(result.stdout)
    assert told["mirrored"]
    assert "--mirror" in told["reasons"][0]
    right = run([*words, "--mirror"])
    assert right["status"] == "ok"
    assert right["mirrored"]
    table = read_taxels(tmp_path / "out" / "taxels.csv")
    assert np.median(np.linalg.norm(table.positions - bent.places, axis=1)) < 1.5e-3


def test_evidence_is_listed_by_channel(tmp_path, bent):
    rows = run(write(tmp_path, bent))["evidence"]
    assert [row["channel"] for row in rows] == (100 + bent.corners).tolist()
    for row in rows:
        assert row["missed_mm"] < row["leave_one_out_mm"]
        assert row["misfit"] < 6.0


def test_wrap_gives_the_same_in_millimetres(tmp_path, bent):
    run(write(tmp_path / "m", bent))
    run([*write(tmp_path / "mm", bent, unit=1e-3), "--units", "mm"])
    one, other = (read_taxels(tmp_path / name / "out" / "taxels.csv") for name in ("m", "mm"))
    np.testing.assert_allclose(other.positions, one.positions, rtol=0, atol=1e-6)


def test_wrap_that_is_not_ok_leaves_results_alone(tmp_path, bent):
    words = write(tmp_path, bent)
    run(words)
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    doubtful = run(write(tmp_path, bent, taxels=[0, 1, 8, 9]), code=3)
    assert doubtful["status"] != "ok"
    assert doubtful["files"] == ["refused.html"]
    after = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert {name: after[name] for name in before} == before
    accepted = run([*words, "--accept"])
    assert accepted["status"] == doubtful["status"]
    assert (tmp_path / "out" / "taxels.csv").read_bytes() != before["taxels.csv"]


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("board.csv", "channel,x\n1,2\n", "expected the columns channel,x,y"),
        (
            "board.csv",
            "channel,x,y\n1,0,0\n1,1,1\n",
            r"board.csv:3: channel 1 comes more than once",
        ),
        ("board.csv", "channel,x,y\n1,0,nan\n", r"board.csv:2: expected a finite number"),
        ("board.csv", "channel,x,y\n", "the table has no row"),
        ("anchors.csv", "channel,x,y,z\n100,0,0,0\n7,0,0,0\n", r"anchors.csv:3: the board has no"),
        ("anchors.csv", "channel,x,y,z\n100,0,0\n", r"anchors.csv:2: expected 4 columns, got 3"),
        ("anchors.csv", "channel,x,y,z\n100.5,0,0,0\n", r"anchors.csv:2: channels and modules"),
        ("link.ply", "ply\n", "not a mesh"),
    ],
)
def test_wrap_names_the_line_and_touches_nothing(tmp_path, bent, file, text, message):
    words = write(tmp_path, bent)
    (tmp_path / file).write_text(text)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "taxels.csv").write_text("kept")
    result = CliRunner().invoke(cli, [*words, "--force"])
    assert isinstance(result.exception, DataFormatError)
    with pytest.raises(SkinError, match=message):
        raise result.exception
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["taxels.csv"]
    assert (tmp_path / "out" / "taxels.csv").read_text() == "kept"


def test_calibrate_lists_its_commands():
    result = CliRunner().invoke(cli, ["calibrate", "--help"])
    assert result.exit_code == 0
    assert "wrap" in result.output
    assert "Example:" in result.output
