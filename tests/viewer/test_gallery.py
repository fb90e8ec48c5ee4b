"""The gallery's script draws what the pages show."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "gallery.py"


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location(SCRIPT.stem, SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_shows_what_the_gallery_draws(gallery):
    docs = Path(__file__).parents[2] / "docs"
    pages = {name: (docs / f"{name}.md").read_text() for name in ("viewer", "gallery")}
    for name in gallery.COMMANDS:
        assert f"pictures/{name}.png" in pages[name.partition("/")[0]]
        assert (docs / "pictures" / f"{name}.png").stat().st_size < 150_000


def test_gallery_draws_a_picture_by_its_command(opengl, tmp_path, gallery, monkeypatch):
    import imageio.v3 as iio

    (tmp_path / "gallery").mkdir()
    monkeypatch.setattr(gallery, "OUT", tmp_path)
    gallery.draw("gallery/torso_modules")
    picture = iio.imread(tmp_path / "gallery" / "torso_modules.png")[..., :3]
    assert max(picture.shape) == gallery.WIDTH
    assert picture.std() > 10


def test_smaller_picture_keeps_rare_colours(gallery):
    """A gradient of greys must not take the place of a few red pixels, as in a legend."""
    from PIL import Image

    greys = np.random.default_rng(0).integers(0, 256, (200, 200, 1)).astype(np.uint8)
    picture = np.repeat(greys, 3, axis=2)
    picture[:5, :5] = 213, 94, 0
    kept = np.asarray(gallery.few_colours(Image.fromarray(picture)).convert("RGB"))
    assert np.abs(kept.astype(int) - picture).max() < 24


def test_page_lists_every_key():
    from viewer.interaction.controls import KEYS

    page = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text()
    for key in KEYS:
        assert not key.shown or f"`{key.shown}`" in page, key.shown
