import numpy as np
import pytest

import skinmap
from skinmap.touch.simulation.gestures import GESTURES, TIME
from viewer.colours import (
    BACKGROUND,
    BODY,
    CATEGORIES,
    CLASS_COLOURS,
    DISTORTION_STOPS,
    FAINT,
    HEALTH,
    MOTION_COLOURS,
    NAMELESS,
    NONE,
    PANEL,
    PRESSURE_STOPS,
    RARER,
    RAW_STOPS,
    TOUCHED,
    TRACES,
    UNCERTAINTY_STOPS,
    UNTOUCHED,
    class_colour,
    ink_on,
    luminance,
    ramp,
    rgb,
)

# Viénot, Brettel and Mollon, "Digital video colourmaps for checking the legibility of displays
# by dichromats", Color Res. Appl. 24(4), 1999: what protanopes and deuteranopes see, linear RGB.
DICHROMATS = {
    "protan": [[0.1124, 0.8876, 0], [0.1124, 0.8876, 0], [0.004, -0.004, 1]],
    "deutan": [[0.2927, 0.7073, 0], [0.2927, 0.7073, 0], [-0.0223, 0.0223, 1]],
}


def seen(colours, kind):
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ np.array(DICHROMATS[kind]).T, 0, 1)


def tritan(colours):
    """Machado, Oliveira and Fernandes, IEEE TVCG 15(6), 2009: tritanopia, linear RGB."""
    mix = [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]]
    linear = np.array([rgb(colour) for colour in colours]) ** 2.2
    return np.clip(linear @ np.array(mix).T, 0, 1)


def least_apart(linear):
    views = linear ** (1 / 2.2)
    distance = np.linalg.norm(views[:, None] - views[None], axis=2)
    return distance[~np.eye(len(views), dtype=bool)].min()


def chroma(colours):
    channels = np.array([rgb(colour) for colour in colours])
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    srgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ratio = linear @ np.array(srgb).T / [0.9505, 1.0, 1.089]
    x, y, z = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116).T
    return np.hypot(500 * (x - y), 200 * (y - z)).tolist()


def test_pressure_colours_darken_all_the_way():
    light = luminance(ramp(PRESSURE_STOPS)[:, :3] / 255.0)
    # Rounding to 8 bits may hold a step, never turn it back by more than one of them.
    assert (np.diff(light) < 2e-3).all()
    assert light[0] > 0.85
    assert light[-1] < 0.05


def test_skin_at_rest_differs_from_the_bare_body():
    rest = ramp(PRESSURE_STOPS)[0, :3] / 255.0
    assert luminance(rest[None])[0] > 1.8 * luminance(rgb(BODY)[None])[0]


@pytest.mark.parametrize("kind", DICHROMATS)
def test_class_colours_stay_apart_for_colour_blind_eyes(kind):
    assert least_apart(seen(np.array([rgb(name) for name in CLASS_COLOURS]), kind)) > 0.3


def test_class_colours_stay_apart_in_tritan_vision():
    assert least_apart(tritan(CLASS_COLOURS)) > 0.3
    assert least_apart(tritan(["#1f6fd0", "#00966f"])) < 0.1  # a blue and a green that do not


def test_class_colours_are_of_even_strength_and_stand_out_from_the_ground():
    """CIE 1976 L*a*b*, for a white of D65."""
    assert max(chroma(CLASS_COLOURS)) < 70
    assert min(chroma(["#0002f2", "#c2f200"])) > 90  # garish
    for ground in (BACKGROUND, PANEL):
        light = luminance(np.array([rgb(colour) for colour in (ground, *CLASS_COLOURS)])) + 0.05
        assert (light[0] / light[1:]).min() > 2.0


def test_class_colour_is_fixed_and_distinct_for_each_gesture():
    assert len({class_colour(name) for name in GESTURES}) == len(GESTURES)
    assert class_colour("my own class") == class_colour("my own class")
    assert class_colour("my own class") in CLASS_COLOURS


@pytest.mark.parametrize("stops", [RAW_STOPS, UNCERTAINTY_STOPS, DISTORTION_STOPS])
def test_lightness_of_each_layer_goes_one_way(stops):
    light = luminance(ramp(stops)[:, :3] / 255.0)
    steps = np.diff(light) * np.sign(light[-1] - light[0])
    # As for pressures: rounding to 8 bits may hold a step, never turn it back by more than one.
    assert (steps > -2e-3).all()
    assert abs(light[-1] - light[0]) > 0.6


@pytest.mark.parametrize("kind", DICHROMATS)
@pytest.mark.parametrize(
    ("colours", "least"),
    [
        ([*CATEGORIES, RARER, NONE], 0.35),
        (list(HEALTH.values()), 0.3),
        ([TOUCHED, UNTOUCHED], 0.3),
        ([*TRACES], 0.17),
        ([HEALTH["dead"], HEALTH["stuck"], HEALTH["noisy"], UNTOUCHED], 0.3),
    ],
)
def test_categories_stay_apart_for_colour_blind_eyes(colours, least, kind):
    assert least_apart(seen(np.array([rgb(colour) for colour in colours]), kind)) > least


def test_structures_stay_apart_in_tritan_vision():
    assert least_apart(tritan(CATEGORIES)) > 0.35
    assert least_apart(tritan(["#f4e9a0", "#f2f230"])) < 0.35


def test_grey_letters_can_be_read():
    """WCAG 2.1: 4.5 for small letters."""
    for ground in (BACKGROUND, PANEL):
        light = luminance(np.array([rgb(FAINT), rgb(ground)]))
        assert (light.max() + 0.05) / (light.min() + 0.05) > 4.5


def test_letters_on_a_label_can_be_read():
    greys = [f"#{level:02x}{level:02x}{level:02x}" for level in range(256)]
    for colour in (*CLASS_COLOURS, *MOTION_COLOURS, NAMELESS, *greys):
        light = luminance(np.array([rgb(colour), rgb(ink_on(colour))]))
        assert (light.max() + 0.05) / (light.min() + 0.05) >= 4.5  # WCAG 2.1, any letters


def test_no_two_names_share_a_colour():
    names = {*GESTURES, *TIME, *skinmap.default_model().labels, "touch"}
    assert len({class_colour(name) for name in names}) == len(names)


@pytest.mark.parametrize("kind", DICHROMATS)
def test_colours_of_all_names_stay_apart_for_colour_blind_eyes(kind):
    every = np.array([rgb(name) for name in (*CLASS_COLOURS, *MOTION_COLOURS)])
    assert least_apart(seen(every, kind)) > 0.17


def test_touches_without_a_name_are_grey():
    from skinmap.live.contacts.named_touch import UNNAMED
    from skinmap.recognition.classifier import NO_CONTACT
    from skinmap.recognition.prediction_sets import UNKNOWN

    for name in (UNNAMED, UNKNOWN, NO_CONTACT):
        channels = rgb(class_colour(name))
        assert np.ptp(channels) < 0.15, name
