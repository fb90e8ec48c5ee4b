"""The gallery's script makes all its pictures, and each shows something else."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def test_gallery_makes_every_picture_that_the_page_shows(opengl, icub, tmp_path):
    import imageio.v3 as iio

    from viewer.gallery import PICTURES, make_gallery

    files = make_gallery(icub, ("left_foot",), tmp_path, size=(480, 360), seconds=1.5)
    assert [path.stem for path in files] == list(PICTURES)
    pictures = [iio.imread(path)[..., :3] for path in files]
    assert all(picture.shape == (360, 480, 3) for picture in pictures)
    assert all(picture.std() > 10 for picture in pictures)
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)
    kept = Path(__file__).parents[2] / "docs" / "pictures" / "viewer"
    assert all((kept / f"{name}.png").stat().st_size < 150_000 for name in PICTURES)
    page = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text()
    assert all(f"pictures/viewer/{name}.png" in page for name in PICTURES)


def test_smaller_picture_keeps_rare_colours(tmp_path):
    """A gradient of greys must not take the place of a few red pixels, as in a legend."""
    import imageio.v3 as iio

    from viewer.gallery import shrink

    greys = np.random.default_rng(0).integers(0, 256, (200, 200, 1)).astype(np.uint8)
    picture = np.repeat(greys, 3, axis=2)
    picture[:5, :5] = 213, 94, 0
    iio.imwrite(tmp_path / "a.png", picture)
    kept = iio.imread(shrink(tmp_path / "a.png"))[..., :3]
    assert np.abs(kept.astype(int) - picture).max() < 24


def test_page_lists_every_key():
    from viewer.interaction.controls import KEYS

    page = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text()
    for key in KEYS:
        assert not key.shown or f"`{key.shown}`" in page, key.shown
