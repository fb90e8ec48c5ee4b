"""Sheets of flat maps at their true size, as other programs read them."""

from __future__ import annotations

import errno
import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from lxml import etree
from scipy.spatial import cKDTree

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.flat.mesh_charts import flatten_mesh
from skinmap.geometry.triangles import pair_lengths, signed_areas
from skinmap.report.sheet import sheets
from skinmap.skin.skin import Skin

SVG = "{http://www.w3.org/2000/svg}"


def flatten(*words: object) -> dict:
    result = CliRunner().invoke(cli, ["flatten", *map(str, words), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def marks(path: Path) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Centres of all circles (n, 2) and, by channel, the place of its text [mm]."""
    root = etree.parse(path).getroot()
    circles = [(float(one.get("cx")), float(one.get("cy"))) for one in root.iter(f"{SVG}circle")]
    texts = {
        int(one.text): np.array([float(one.get("x")), float(one.get("y"))])
        for one in root.iter(f"{SVG}text")
        if one.text.isdigit()
    }
    return np.array(circles), texts


def entities(path: Path) -> list[list[tuple[int, str]]]:
    """Entities of a DXF as lists of group code and value."""
    lines = path.read_text().splitlines()
    pairs = list(zip(map(int, lines[::2]), lines[1::2], strict=True))
    begin = pairs.index((2, "ENTITIES")) + 1
    found: list[list[tuple[int, str]]] = []
    for pair in pairs[begin : pairs.index((0, "ENDSEC"), begin)]:
        if pair[0] == 0:
            found.append([])
        found[-1].append(pair)
    return found


def refused(sheet: Path) -> str:
    """The line that refuses a sheet."""
    words = ["flatten", "icub", "--part", "left_hand", "--sheet", str(sheet)]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code != 0
    return str(result.exception) if isinstance(result.exception, SkinError) else result.output


@pytest.fixture(scope="module")
def forearm(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sheet")
    for suffix in ("svg", "dxf", "pdf"):
        made = flatten("icub", "--part", "left_forearm", "--sheet", folder / f"sheet.{suffix}")
        assert made["sheets"] == [str(folder / f"sheet.{suffix}")]
    return folder


def test_sheet_has_each_channel_once_beside_its_own_mark(forearm):
    circles, texts = marks(forearm / "sheet.svg")
    channels = skinmap.load_robot("icub").skin("left_forearm").channels
    assert sorted(texts) == sorted(channels.tolist())
    assert len(circles) == len(channels)
    nearest = cKDTree(circles).query(np.array(list(texts.values())))[1]
    assert len(set(nearest.tolist())) == len(circles)


def test_taxels_at_one_place_share_its_mark_with_both_channels(square_grid):
    places, _ = square_grid(5)
    places, n = np.vstack([places, places[6]]), 26
    up, same = np.tile([0.0, 0.0, 1.0], (n, 1)), np.zeros(n, np.int64)
    skin = Skin("pad", "pad", np.arange(n), same, 0.1 * places, up)
    flat = skinmap.flatten(skinmap.build_surface(skin))
    (drawing,) = sheets("pad", {"pad": flat})
    named = [one.text for one in drawing.shapes if getattr(one, "layer", "") == "channels"]
    assert sorted(named) == sorted(["6, 25", *(str(k) for k in range(25) if k != 6)])


@pytest.mark.parametrize("method", ["bff", "balanced"])
def test_sheet_of_a_bulging_skin_has_its_area_and_states_the_errors_of_lengths(sphere, method):
    vertices, faces = sphere
    bowl = faces[(vertices[faces][:, :, 2] > -0.5).all(axis=1)]
    flat = flatten_mesh(0.05 * vertices, bowl, method=method)
    (chart,) = flat.charts
    own = chart.distortion
    assert signed_areas(chart.uv, chart.faces).sum() == pytest.approx(own.face_areas.sum())
    np.testing.assert_allclose(
        pair_lengths(chart.uv, own.edges), (1.0 + own.edge_strain) * own.edge_lengths
    )
    (drawing,) = sheets("bowl", {"bowl": flat})
    off = 100.0 * np.abs(own.edge_strain)
    words = f"neighbours: {np.median(off):.1f} % off (median), {off.max():.0f} % at worst"
    assert any(words in getattr(one, "text", "") for one in drawing.shapes)


def test_sheet_svg_is_as_large_as_its_unit_promises(forearm):
    root = etree.parse(forearm / "sheet.svg").getroot()
    assert (root.get("width"), root.get("height")) == ("210mm", "297mm")
    assert root.get("viewBox") == "0 0 210 297"


def test_sheet_keeps_lengths_of_the_flat_map(forearm):
    circles, _ = marks(forearm / "sheet.svg")
    skin = skinmap.load_robot("icub").skin("left_forearm")
    flat = skinmap.flatten(skinmap.build_surface(skin))
    apart = cKDTree(1e3 * flat.uv).query(1e3 * flat.uv, k=2)[0][:, 1]
    drawn = cKDTree(circles).query(circles, k=2)[0][:, 1]
    # Rounded to a tenth of a micrometre; the sheet is asked for 0.1 mm.
    np.testing.assert_allclose(np.sort(drawn), np.sort(apart), rtol=0, atol=1e-3)


def test_sheet_dxf_has_millimetres_circles_texts_and_outlines(forearm):
    text = (forearm / "sheet.dxf").read_text()
    assert re.search(r"\$INSUNITS\n70\n4\n", text)
    found = entities(forearm / "sheet.dxf")
    kinds = Counter(one[0][1] for one in found)
    assert kinds["CIRCLE"] == 240
    assert kinds["LWPOLYLINE"] == 24 + 1
    circles, _ = marks(forearm / "sheet.svg")
    x, y = ([float(dict(one)[code]) for one in found if one[0][1] == "CIRCLE"] for code in (10, 20))
    np.testing.assert_allclose(np.column_stack([x, 297.0 - np.array(y)]), circles, atol=1e-3)


def test_sheet_pdf_embeds_a_font(forearm):
    data = (forearm / "sheet.pdf").read_bytes()
    assert data.startswith(b"%PDF")
    assert b"/FontFile2" in data


def test_sheet_of_a_large_map_goes_over_several_pages(tmp_path):
    side = np.arange(0.0, 0.4, 0.02)
    grid = np.array([(x, y, 0.0) for y in side for x in side])
    count = len(side)
    cells = [j * count + i for j in range(count - 1) for i in range(count - 1)]
    faces = [(k, k + 1, k + count + 1) for k in cells] + [
        (k, k + count + 1, k + count) for k in cells
    ]
    mesh = tmp_path / "plate.obj"
    mesh.write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in grid)
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    )
    made = flatten(mesh, "--sheet", tmp_path / "sheet.svg")["sheets"]
    assert [Path(one).name for one in made] == [f"sheet-{n}.svg" for n in range(1, len(made) + 1)]
    assert 6 <= len(made) <= 9  # 40 cm are three widths and two heights of A4, at an angle more
    assert not (tmp_path / "sheet.svg").exists()
    pages = [marks(Path(one)) for one in made]
    channels = [channel for _, texts in pages for channel in texts]
    assert sorted(channels) == list(range(count**2))
    foot = [one for one in etree.parse(made[0]).getroot().iter(f"{SVG}text") if one.text[0] in "c1"]
    height = {one.text.split()[0]: float(one.get("y")) for one in foot if " " in one.text}
    assert height["column"] < height["100"] - 5.0  # beside each other they would overlap
    for circles, _ in pages:
        assert (circles >= 0).all()
        assert (circles <= (210.0, 297.0)).all()


@pytest.mark.parametrize(
    ("name", "line"),
    [("none/x.pdf", "no folder"), ("x.png", "the formats are: .pdf, .svg, .dxf")],
)
def test_sheet_refuses_in_one_line(tmp_path, name, line):
    assert line in refused(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_sheet_on_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert "No space left" in refused(tmp_path / "x.svg")
    assert not list(tmp_path.iterdir())
