"""The gallery's script makes all its pictures, and each shows something else."""

from __future__ import annotations

from pathlib import Path


def test_gallery_makes_every_picture_that_the_page_shows(opengl, icub, tmp_path):
    import imageio.v3 as iio

    from viewer.gallery import PICTURES, make_gallery

    files = make_gallery(icub, ("left_foot",), tmp_path, size=(480, 360), seconds=1.5)
    assert [path.stem for path in files] == list(PICTURES)
    pictures = [iio.imread(path)[..., :3] for path in files]
    assert all(picture.shape == (360, 480, 3) for picture in pictures)
    assert all(picture.std() > 10 for picture in pictures)
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)
    page = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text()
    assert all(f"pictures/viewer/{name}.png" in page for name in PICTURES)


def test_page_lists_every_key():
    from viewer.interaction.keys import KEYS

    page = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text()
    for key in KEYS:
        assert not key.shown or f"`{key.shown}`" in page, key.shown
