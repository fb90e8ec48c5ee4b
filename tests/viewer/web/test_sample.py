"""What a page is sent of a moment."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment
from tests.viewer.unpacking import unpack
from viewer.drawing.touches.touch_marks import outline_touch
from viewer.interaction.pointing import describe
from viewer.layers import LAYERS, Layers
from viewer.web.sample import (
    UNKNOWN,
    SampleWriter,
    layer_message,
    table_rows,
    taxel_bytes,
)
from viewer.web.scene_data import WebScene

PARTS = ("torso", "left_arm")


@pytest.fixture(scope="module")
def skins(prepared):
    return {part: prepared(part) for part in PARTS}


@pytest.fixture(scope="module")
def scene(icub, skins, opengl):
    return WebScene(icub, skins, links=("chest",))


@pytest.fixture
def layers(skins):
    return Layers(skins)


@pytest.mark.parametrize("name", LAYERS)
def test_taxel_bytes_give_the_colours_of_the_layer(layers, moments, name):
    layer = layers.get(name)
    table = np.array(layer_message(layer)["table"])
    for part in PARTS:
        codes = taxel_bytes(layer, part, moments[1])
        values = layer.values(part, moments[1])
        known = np.isfinite(values)
        assert np.array_equal(codes == UNKNOWN, ~known)
        # 256 colours are sent as 255: a neighbour of the exact one, at most 6 of 255 away.
        gap = np.abs(table[codes[known]] - layer.colours(values)[known].astype(int))
        assert gap.max(initial=0) <= (0 if len(table) < 255 else 6)


def test_table_rows_keep_both_ends():
    for size in (1, 2, 7, 255, 256, 1000):
        rows = table_rows(size)
        assert len(rows) == min(size, 255)
        assert (rows[0], rows[-1]) == (0, size - 1)


def test_write_sends_a_byte_for_each_taxel_in_the_order_of_the_scene(scene, layers, moments):
    header, arrays = unpack(
        SampleWriter(scene, layers).write(moments[1], layers.get("pressure"), {})
    )
    counts = np.concatenate([moments[1].pressures[part] for part in PARTS])
    assert arrays["values"].dtype == np.uint8
    assert np.array_equal(arrays["values"] > 0, counts > 0)
    assert header["touches"][0]["text"] == "caress 90 %"


def test_write_sends_the_outline_that_the_window_draws(scene, layers, moments):
    header, arrays = unpack(
        SampleWriter(scene, layers).write(moments[1], layers.get("pressure"), {})
    )
    layer, touch = scene.layers["torso"], moments[1].touches[0]
    layer.pressures = moments[1].pressures["torso"]
    expected = outline_touch(layer, touch).points(layer.points)
    name = header["touches"][0]["outline"]
    first, second = arrays[name].reshape(-1, 2, 2).transpose(2, 0, 1)
    share = arrays[f"{name}.share"].reshape(-1, 2, 1) / 65535
    points = np.concatenate([scene.layers[part].points for part in PARTS])
    found = points[first] * (1 - share) + points[second] * share
    # A share is sent in steps of 1/65535 of an edge of at most 12 mm.
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-7)


def test_write_without_a_moment_says_that_nothing_is_known(scene, layers):
    header, arrays = unpack(SampleWriter(scene, layers).write(None, layers.get("pressure"), {}))
    assert (arrays["values"] == UNKNOWN).all()
    assert header["touches"] == []


def test_write_places_links_by_the_moment_s_angles(icub, scene, layers, moments):
    joint = next(iter(icub.body.joints))
    low, high = icub.body.joints[joint]
    writer = SampleWriter(scene, layers)
    moment = Moment(0.0, moments[0].pressures, angles={joint: (low + high) / 2})
    _, arrays = unpack(writer.write(moment, layers.get("pressure"), {}))
    expected = icub.body.poses({**icub.pose, joint: (low + high) / 2})
    found = arrays["poses"].reshape(-1, 4, 4).transpose(0, 2, 1)
    for link, pose in zip(scene.links, found, strict=True):
        np.testing.assert_allclose(pose, expected[link], atol=1e-6)  # single precision


def test_write_tells_of_angles_out_of_range_and_keeps_the_pose(icub, scene, layers, moments):
    joint = next(iter(icub.body.joints))
    moment = Moment(0.0, moments[0].pressures, angles={joint: 99.0})
    header, arrays = unpack(SampleWriter(scene, layers).write(moment, layers.get("pressure"), {}))
    assert joint in header["problem"]
    assert "poses" not in arrays


def test_describe_names_the_taxel(scene, layers, moments):
    taxel = int(moments[1].touches[0].taxels[0])
    found = describe(layers, "torso", taxel, moments[1])
    skin = scene.skins["torso"].skin
    assert found["channel"] == skin.channels[taxel]
    assert found["module"] == skin.modules[taxel]
    assert found["pressure"] == 200.0
    assert found["raw"] is None
    assert found["structure"]
    near = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
    places = np.isin(skin.channels, found["neighbours"])
    assert 2 <= places.sum() <= 9
    assert near[places].max() < 0.02  # neighbours along edges of the mesh, 20 mm at most


@pytest.mark.parametrize(
    ("part", "taxel", "message"),
    [
        ("tail", 0, "no part shown 'tail'"),
        ("torso", 99999, "'torso' has taxels 0 to"),
        ("torso", -1, "not -1"),
    ],
)
def test_describe_refuses_what_is_not_there(scene, layers, part, taxel, message):
    with pytest.raises((LookupError, ValueError), match=message):
        describe(layers, part, taxel, None)
