from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import median_spacing
from skinmap.io.robots.manifest import load_robot
from skinmap.touch.images import contact_image
from skinmap.touch.images.contact_image import grey_levels, image_geometry, paper_images, resize
from skinmap.touch.prepared_skin import PreparedSkin


@pytest.fixture(scope="module")
def geometry(prepared):
    return image_geometry(prepared("right_forearm").flat)


def test_grey_levels_are_the_floor_of_255_p_over_max_p():
    pressures = np.arange(256, dtype=np.float32)
    for peak in (255, 200, 3, 7, 1):
        image = pressures[None, None, : peak + 1]
        exact = [255 * p // peak for p in range(peak + 1)]  # in whole numbers
        np.testing.assert_array_equal(grey_levels(image, [peak])[0, 0], exact)


def test_grey_levels_are_of_the_largest_taxel_and_not_of_the_brightest_pixel(geometry):
    alone = np.zeros((len(geometry), len(geometry)))
    np.fill_diagonal(alone, 80.0)
    pixels = geometry.images(alone).max(axis=(1, 2))
    levels = grey_levels(geometry.images(alone), alone.max(axis=1)).max(axis=(1, 2))
    np.testing.assert_array_equal(levels, np.floor(255.0 * pixels / 80.0 + 1e-3))
    assert np.median(levels) < 255


@pytest.mark.parametrize("robot", ["kaspar", "icub", "baxter-forearm", "ur10e-cyskin"])
def test_no_taxel_is_without_a_pixel(robot):
    for part in load_robot(robot).parts[:3]:
        skin = PreparedSkin(load_robot(robot).skin(part))
        geometry = skin.image_geometry
        assert (geometry.matrix.sum(axis=0) > 0).all()
        spacing = median_spacing(skin.skin.positions)
        assert 0.4 * spacing < geometry.pitch <= spacing


def test_no_pressure_gives_a_zero_image(geometry):
    for nothing in (np.zeros((2, len(geometry))), -np.ones((2, len(geometry)))):
        image = paper_images(geometry, nothing)
        assert image.dtype == np.uint8
        assert image.shape == (2, 66, 100)
        assert image.max() == 0
    assert paper_images(geometry, np.zeros((0, len(geometry)))).shape == (0, 66, 100)


def test_images_do_not_change_with_the_scale(geometry, rng):
    samples = rng.integers(0, 256, (3, len(geometry))).astype(np.float64)
    plain = paper_images(geometry, samples)
    for power in (-1000, -40, 40, 1000):  # at a power of two not one bit may differ
        np.testing.assert_array_equal(paper_images(geometry, np.ldexp(samples, power)), plain)
    np.testing.assert_array_equal(paper_images(geometry, samples.astype(np.uint8)), plain)
    for extreme in (1e308, 5e-324):
        assert paper_images(geometry, np.full((1, len(geometry)), extreme)).max() == 255


def test_batch_equals_single(geometry, rng):
    samples = rng.integers(0, 256, (9, len(geometry))).astype(np.uint8)
    together = paper_images(geometry, samples)
    for sample, image in zip(samples, together, strict=True):
        np.testing.assert_array_equal(paper_images(geometry, sample[None])[0], image)


def test_values_that_are_none_are_refused(geometry):
    samples = np.zeros((2, len(geometry)))
    for bad in (np.nan, np.inf):
        samples[1, 3] = bad
        with pytest.raises(InvalidArrayError, match="must be finite"):
            paper_images(geometry, samples)


def test_resize_keeps_constants_and_ramps(rng):
    level = np.full((1, 13, 31), 77, np.uint8)
    np.testing.assert_array_equal(resize(level, (66, 100)), np.full((1, 66, 100), 77))
    np.testing.assert_array_equal(resize(level, (5, 9)), np.full((1, 5, 9), 77))
    ramp = np.broadcast_to(np.arange(0, 200, 10, dtype=np.uint8), (1, 6, 20))
    place = (np.arange(60) + 0.5) / 3 - 0.5  # of the new pixels among the old
    expected = np.rint(10 * np.clip(place, 0, 19))
    np.testing.assert_array_equal(resize(ramp, (6, 60))[0, 3], expected)
    noise = rng.integers(0, 256, (2, 9, 12)).astype(np.uint8)
    np.testing.assert_array_equal(resize(noise, (9, 12)), noise)


def test_resize_turns_a_standing_map(rng):
    standing = np.zeros((1, 40, 20), np.uint8)
    standing[0, 0, :] = 255  # the top
    lying = resize(standing, (20, 40))
    assert (lying[0, :, -1] == 255).all()
    assert lying[0, :, :-1].max() == 0


def test_ties_between_two_levels_do_not_depend_on_the_order_of_a_sum(monkeypatch, rng):
    """Sums of another machine differ by some units in the last place; levels must not."""
    images = rng.integers(0, 256, (40, 30, 48)).astype(np.uint8)
    images[:, ::2] = images[:, 1::2]
    plain = resize(images, (45, 72))
    weights = contact_image._resampling
    for nudge in (1.0 - 2e-16, 1.0 + 4e-16):
        monkeypatch.setattr(
            contact_image, "_resampling", lambda n, wanted, nudge=nudge: weights(n, wanted) * nudge
        )
        np.testing.assert_array_equal(resize(images, (45, 72)), plain)
