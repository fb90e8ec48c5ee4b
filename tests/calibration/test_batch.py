"""`skinmap calibrate batch`: as many boards as a table has rows, each as `wrap` lays it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import DataFormatError


@pytest.fixture
def batch(tmp_path, bent):
    """A table of two patches and one whose mesh is not there; files beside it."""
    rows = [f"{k},{x!r},{y!r}" for k, (x, y) in enumerate(bent.layout.tolist())]
    (tmp_path / "board.csv").write_text("\n".join(["channel,x,y", *rows]) + "\n")
    trimesh.Trimesh(bent.vertices, bent.faces).export(tmp_path / "link.ply")
    for name, seed in (("one", 1), ("two", 2)):
        noise = np.random.default_rng(seed).normal(0, 0.5e-3, (len(bent.corners), 3))
        rows = [
            f"{taxel},{x!r},{y!r},{z!r}"
            for taxel, (x, y, z) in zip(
                bent.corners.tolist(), (bent.places[bent.corners] + noise).tolist(), strict=True
            )
        ]
        (tmp_path / f"{name}.csv").write_text("\n".join(["channel,x,y,z", *rows]) + "\n")
    (tmp_path / "patches.csv").write_text(
        "name,layout,mesh,anchors\none,board.csv,link.ply,one.csv\n"
        "lost,board.csv,gone.ply,one.csv\ntwo,board.csv,link.ply,two.csv\n"
    )
    return tmp_path


def run(folder, out, *more, code=3):
    words = ["calibrate", "batch", str(folder / "patches.csv"), "-o", str(folder / out), "--json"]
    result = CliRunner().invoke(cli, [*words, *more])
    assert result.exit_code == code, (result.output, result.exception)
    return json.loads(result.stdout), result.stderr


def test_a_batch_gives_the_files_of_single_wraps(batch):
    found, _ = run(batch, "out")
    assert [patch["patch"] for patch in found["patches"]] == ["one", "lost", "two"]
    assert found["statuses"] == {"ok": 2, "failed": 1}
    assert "gone.ply" in found["patches"][1]["reasons"][0]
    words = [
        "calibrate", "wrap", "--layout", str(batch / "board.csv"), "--mesh",
        str(batch / "link.ply"), "--anchors", str(batch / "two.csv"), "-o", str(batch / "single"),
    ]  # fmt: skip
    assert CliRunner().invoke(cli, words).exit_code == 0
    single = (batch / "single" / "taxels.csv").read_bytes()
    assert (batch / "out" / "two" / "taxels.csv").read_bytes() == single
    assert not (batch / "out" / "lost").exists()


def test_a_batch_by_two_processes_is_the_same(batch):
    run(batch, "out", code=3)
    run(batch, "again", "--jobs", "2", code=3)
    table = (batch / "again" / "one" / "taxels.csv").read_bytes()
    assert table == (batch / "out" / "one" / "taxels.csv").read_bytes()


def test_an_interrupted_batch_keeps_the_patches_that_are_done(batch, monkeypatch):
    from skinmap.parallel import run as parallel

    whole = parallel.each_result

    def broken(*words, **more):
        yield next(whole(*words, **more))
        raise KeyboardInterrupt

    monkeypatch.setattr(parallel, "each_result", broken)
    words = ["calibrate", "batch", str(batch / "patches.csv"), "-o", str(batch / "out")]
    assert CliRunner().invoke(cli, words).exit_code != 0
    names = [path.relative_to(batch / "out").as_posix() for path in (batch / "out").rglob("*.*")]
    assert sorted(names) == ["one/report.html", "one/taxels.csv"]


def test_a_page_of_refusal_goes_when_the_patch_becomes_ok(batch):
    """And the reasons of others are printed whole."""
    table = (batch / "patches.csv").read_text()
    *anchors, last = (batch / "one.csv").read_text().splitlines()
    channel, x, y, z = last.split(",")
    anchors.append(f"{channel},{float(x) + 0.02},{y},{z}")  # 20 mm off
    (batch / "far.csv").write_text("\n".join(anchors) + "\n")
    (batch / "patches.csv").write_text(table.replace("ply,one.csv\nlost", "ply,far.csv\nlost"))
    words = ["calibrate", "batch", str(batch / "patches.csv"), "-o", str(batch / "out")]
    first = CliRunner().invoke(cli, words)
    assert (batch / "out" / "one" / "refused.html").exists(), first.output
    page = json.loads(CliRunner().invoke(cli, [*words, "--json"]).stdout)
    for patch in page["patches"]:
        for reason in patch["reasons"]:
            assert reason in first.output
    (batch / "patches.csv").write_text(table)
    assert CliRunner().invoke(cli, words).exit_code == 3
    assert not (batch / "out" / "one" / "refused.html").exists()
    assert (batch / "out" / "one" / "report.html").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "1: expected the columns name,layout,mesh,anchors"),
        ("name,layout,mesh\n", "1: expected the columns"),
        ("name,layout,mesh,anchors\n", "1: the table has no row"),
        ("name,layout,mesh,anchors\na,b,c\n", "2: expected 4 columns, got 3"),
        ("name,layout,mesh,anchors\n../a,b,c,d\n", "2: '../a' cannot name a folder"),
        ("name,layout,mesh,anchors\na,b,c,d\na,b,c,d\n", "3: the patch 'a' comes more than once"),
        ("name,layout,mesh,anchors,units\na,b,c,d,ell\n", "2: no unit 'ell'; the units are: m, cm"),
        ("name,layout,mesh,anchors,mirror\na,b,c,d,1\n", "2: mirror is yes or no, got '1'"),
    ],
)
def test_tables_that_cannot_be_read_are_refused_by_line(tmp_path, text, message):
    (tmp_path / "patches.csv").write_text(text)
    words = ["calibrate", "batch", str(tmp_path / "patches.csv"), "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(cli, words)
    assert isinstance(result.exception, DataFormatError)
    assert message in str(result.exception)
    assert not (tmp_path / "out").exists()
