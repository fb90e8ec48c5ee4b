import numpy as np
import pytest

from skinmap.touch.gestures import GESTURES
from viewer.colours import BODY, CLASS_COLOURS, class_colour, luminance, pressure_colours, rgb

# Viénot, Brettel and Mollon, "Digital video colourmaps for checking the legibility of displays
# by dichromats", Color Res. Appl. 24(4), 1999: what protanopes and deuteranopes see, linear RGB.
DICHROMATS = {
    "protan": [[0.1124, 0.8876, 0], [0.1124, 0.8876, 0], [0.004, -0.004, 1]],
    "deutan": [[0.2927, 0.7073, 0], [0.2927, 0.7073, 0], [-0.0223, 0.0223, 1]],
}


def seen(colours, kind):
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ np.array(DICHROMATS[kind]).T, 0, 1)


def test_pressure_colours_darken_all_the_way():
    light = luminance(pressure_colours()[:, :3] / 255.0)
    # Rounding to 8 bits may hold a step, never turn it back by more than one of them.
    assert (np.diff(light) < 2e-3).all()
    assert light[0] > 0.85
    assert light[-1] < 0.05


def test_skin_at_rest_differs_from_the_bare_body():
    rest = pressure_colours()[0, :3] / 255.0
    assert luminance(rest[None])[0] > 1.8 * luminance(rgb(BODY)[None])[0]


@pytest.mark.parametrize("kind", DICHROMATS)
def test_class_colours_stay_apart_for_colour_blind_eyes(kind):
    colours = np.array([rgb(class_colour(name)) for name in GESTURES])
    views = seen(colours, kind) ** (1 / 2.2)
    distance = np.linalg.norm(views[:, None] - views[None], axis=2)
    assert distance[~np.eye(len(views), dtype=bool)].min() > 0.3


def test_class_colour_is_fixed_and_distinct_for_each_gesture():
    assert len({class_colour(name) for name in GESTURES}) == len(GESTURES)
    assert class_colour("my own class") == class_colour("my own class")
    assert class_colour("my own class") in CLASS_COLOURS
