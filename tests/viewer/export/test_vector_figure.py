"""Figures for papers: `--screenshot` with .svg and .pdf."""

from __future__ import annotations

import base64
import errno
import io
import re
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from PIL import Image

import skinmap
from skinmap.errors import OutputError

SVG = "{http://www.w3.org/2000/svg}"
INCH = 25.4


@pytest.fixture(scope="module")
def scene():
    made = skinmap.Scene.load("kaspar", ["torso"], window_size=(800, 550))
    pressures = np.zeros(240)
    pressures[40:60] = 150.0
    made.set_pressures("torso", pressures)
    made.set_title("a title of the frame")
    yield made
    made.close()


@pytest.fixture(scope="module")
def figure(scene, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("figure")
    for suffix in ("svg", "pdf"):
        scene.screenshot(folder / f"figure.{suffix}")
    return folder


@pytest.fixture(scope="module")
def root(figure):
    return etree.parse(figure / "figure.svg").getroot()


def test_figure_is_as_many_millimetres_wide_as_its_view_box(root):
    width, height = (float(root.get(side).removesuffix("mm")) for side in ("width", "height"))
    assert width == 180.0
    np.testing.assert_allclose(height, 180.0 * 550 / 800, rtol=0, atol=1e-3)
    assert [float(one) for one in root.get("viewBox").split()] == [0.0, 0.0, width, height]


def test_figure_writes_legend_and_map_as_text_and_no_words_of_the_frame(root):
    texts = [one.text for one in root.iter(f"{SVG}text")]
    assert {"pressure", "counts", "255", "flat map: torso", "no touch"} <= set(texts)
    assert "a title of the frame" not in texts
    for one in root.iter(f"{SVG}text"):
        assert 0.0 <= float(one.get("x")) <= 180.0
        assert 0.0 <= float(one.get("y")) <= float(root.get("height").removesuffix("mm"))


def test_figure_has_the_body_as_its_only_picture(root):
    pictures = list(root.iter(f"{SVG}image"))
    assert len(pictures) == 1
    data = pictures[0].get("href").partition("base64,")[2]
    picture = np.array(Image.open(io.BytesIO(base64.b64decode(data))))
    assert (picture[0, 0] == 255).all()  # on white
    assert picture.std() > 10.0


def test_figure_draws_each_taxel_of_the_map(root):
    paths = [one.get("d") for one in root.iter(f"{SVG}path") if one.get("class") == "map"]
    assert sum(path.count("M") for path in paths) >= 240 + 240  # dots, and triangles between them


def test_figure_scale_bar_is_as_long_as_it_claims(root, scene):
    """The map is drawn at one scale: 10 cm of its bar are 10 cm of its taxels."""
    words = next(one.text for one in root.iter(f"{SVG}text") if one.text.endswith(" cm"))
    lines = [
        np.array(re.findall(r"[-\d.]+", one.get("d")), float).reshape(-1, 2)
        for one in root.iter(f"{SVG}path")
        if one.get("class") == "map" and one.get("fill") == "none"
    ]
    bar = next(line for line in lines if len(line) == 2)
    border = np.concatenate([line for line in lines if len(line) > 2])
    drawn = np.ptp(border, axis=0) / np.ptp(bar[:, 0])  # in lengths of the bar
    size = np.ptp(scene.panel.flat_maps["torso"].uv, axis=0) / (1e-2 * float(words.split()[0]))
    np.testing.assert_allclose(drawn, size, rtol=0.01)  # a hundredth: pixels of the window


def test_figure_pdf_has_a_font_and_the_same_size(figure):
    data = (figure / "figure.pdf").read_bytes()
    assert b"/FontFile2" in data
    box = re.search(rb"/MediaBox \[([^\]]+)\]", data)
    assert box is not None
    sides = [float(one) for one in box.group(1).split()][2:]
    np.testing.assert_allclose(sides[0] / 72.0 * INCH, 180.0, atol=0.2)


def test_figure_leaves_the_window_as_it_was(scene, tmp_path):
    before = scene.frame(0.0)
    scene.screenshot(tmp_path / "figure.svg")
    again = scene.frame(0.0)
    np.testing.assert_array_equal(before, again)


def test_figure_on_a_full_disk_leaves_nothing(scene, tmp_path, monkeypatch):
    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match="No space left"):
        scene.screenshot(tmp_path / "figure.svg")
    assert not list(tmp_path.iterdir())
