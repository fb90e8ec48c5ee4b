"""Contact images as files: written, read back, and refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, OutputError
from skinmap.io.recordings.image_files import LabelledImages, read_images, write_images
from skinmap.recognition.protocols.baxter import given_images


def labelled(rng, n=6):
    images = rng.integers(1, 256, (n, 66, 100)).astype(np.uint8)
    labels = np.array(["hand", "other"] * (n // 2))
    return LabelledImages(images, labels, np.arange(n) // 2, np.full(n, "torso"))


def test_images_come_back_as_they_were_written(tmp_path, rng):
    wanted = labelled(rng)
    names = write_images(wanted, tmp_path)
    assert len(names) == 7
    for path in (tmp_path, tmp_path / "images.npz"):
        found = read_images(path)
        np.testing.assert_array_equal(found.images, wanted.images)
        assert found.labels.tolist() == wanted.labels.tolist()
        assert found.touches.tolist() == [0, 0, 1, 1, 2, 2]
    with Image.open(tmp_path / names[1]) as picture:
        np.testing.assert_array_equal(np.asarray(picture), wanted.images[0])


def test_folders_of_pictures_are_read(tmp_path, rng):
    for label in ("hand", "other"):
        (tmp_path / label).mkdir()
        for number in range(2):
            pixels = rng.integers(1, 256, (22, 38)).astype(np.uint8)
            Image.fromarray(pixels).save(tmp_path / label / f"{number}.png")
    found = read_images(tmp_path)
    assert found.images.shape == (4, 22, 38)
    assert found.labels.tolist() == ["hand", "hand", "other", "other"]


@pytest.mark.parametrize(
    ("pixels", "match"),
    [
        (np.zeros((66, 100), np.uint8), "black everywhere"),
        (np.full((10, 10), 9, np.uint8), "images are of one size"),
    ],
)
def test_pictures_that_are_no_contact_images_are_refused(tmp_path, pixels, match):
    (tmp_path / "hand").mkdir()
    Image.fromarray(np.full((66, 100), 9, np.uint8)).save(tmp_path / "hand" / "0.png")
    Image.fromarray(pixels).save(tmp_path / "hand" / "1.png")
    with pytest.raises(DataFormatError, match=match):
        read_images(tmp_path)


def test_sets_that_are_none_are_refused(tmp_path):
    with pytest.raises(MissingFileError):
        read_images(tmp_path / "nowhere")
    with pytest.raises(DataFormatError, match="no pictures"):
        read_images(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "hand").mkdir()
    (tmp_path / "empty" / "hand" / "0.png").write_bytes(b"")
    with pytest.raises(DataFormatError, match="not a picture"):
        read_images(tmp_path / "empty")
    np.savez(tmp_path / "images.npz", images=np.ones((3, 4), np.uint16), labels=["a", "b", "c"])
    with pytest.raises(DataFormatError, match="8 bits"):
        read_images(tmp_path / "images.npz")


def test_given_images_are_hands_and_others(rng):
    images = rng.integers(1, 256, (40, 22, 38)).astype(np.uint8)
    names, touches = np.array(["whole_hand", "elbow"] * 20), np.arange(40)
    data = given_images(images, names, touches)
    assert data.images.shape == (40, 66, 100)
    assert data.labels.tolist() == ["hand", "other"] * 20
    with pytest.raises(InvalidArrayError, match="label 'cat'"):
        given_images(images, np.full(40, "cat"), touches)
    with pytest.raises(InvalidArrayError, match="0 touches of other: 10 at least"):
        given_images(images, np.full(40, "hand"), touches)


def test_export_writes_an_image_a_touch_and_never_over_others(tmp_path):
    robot = skinmap.load_robot("kaspar")
    recording = skinmap.simulate(robot.skin("left_hand"), gestures=["poke"], per_gesture=3, rng=0)
    path, folder = tmp_path / "t.mcap", tmp_path / "images"
    skinmap.save_recordings(recording, path, robot=robot)
    words = ["export", str(path), "--format", "images", "-o", str(folder)]
    first = CliRunner().invoke(cli, words)
    assert first.exit_code == 0, first.output
    found = read_images(folder)
    assert found.images.shape == (len(recording.labels), 66, 100)
    assert set(found.labels) == {"poke"}
    assert len(list(folder.glob("*.png"))) == len(found.images)
    again = CliRunner().invoke(cli, words)
    assert isinstance(again.exception, OutputError)
    assert "is there already" in str(again.exception)


def test_pictures_of_16_bits_and_with_alpha_are_read(tmp_path, rng):
    pixels = rng.integers(1, 256, (22, 38)).astype(np.uint8)
    mask = np.where(np.arange(38) < 10, 0, 255)[None].repeat(22, 0).astype(np.uint8)
    (tmp_path / "hand").mkdir()
    Image.fromarray(pixels.astype(np.uint16) * 257).save(tmp_path / "hand" / "a.png")
    shown = (Image.fromarray(pixels), Image.fromarray(mask))
    Image.merge("LA", shown).save(tmp_path / "hand" / "b.png")
    deep, masked = read_images(tmp_path).images
    np.testing.assert_array_equal(deep, pixels)
    np.testing.assert_array_equal(masked, np.where(mask > 0, pixels, 0))


def test_arrays_without_parts_have_none_and_others_are_one_an_image(tmp_path):
    path, images = tmp_path / "images.npz", np.full((2, 3, 4), 9, np.uint8)
    np.savez(path, images=images, labels=["hand", "other"])
    assert read_images(path).parts.tolist() == ["", ""]
    np.savez(path, images=images, labels=["hand", "other"], parts=["torso"])
    with pytest.raises(DataFormatError, match="2 images, 2 labels, 2 touches, 1 parts"):
        read_images(path)
