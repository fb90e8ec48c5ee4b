from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.touched_taxels import Touched, TouchedPart
from skinmap.memory_features import FEATURES
from skinmap.neighbours.offsets import auto_radius
from skinmap.neighbours.structures import find_structures
from skinmap.touch.load_calibration import LoadCalibration
from viewer.drawing.skin.skin_view import signs_of
from viewer.drawing.skin.taxel_drawing import fade
from viewer.layers import DEAD, LAYERS, NEVER, OK, SATURATED, STALE, STATES, Layers

SIZES = {"torso": 430, "left_arm": 350}


@pytest.fixture
def layers(prepared):
    return Layers({part: prepared(part) for part in SIZES})


@pytest.fixture
def ramped():
    return Moment(0.0, {part: np.linspace(0, 255, n) for part, n in SIZES.items()})


@pytest.mark.parametrize("name", LAYERS)
def test_every_layer_gives_one_value_and_colour_for_each_taxel(layers, ramped, name):
    layer = layers.get(name)
    for part, n in SIZES.items():
        values = layer.values(part, ramped)
        assert values.shape == (n,)
        colours = layer.colours(values)
        assert colours.shape == (n, 3)
        assert colours.dtype == np.uint8
        known = values[np.isfinite(values)]
        if layer.categories:
            assert set(known) <= set(range(len(layer.categories)))
    assert len(layer.table) == (len(layer.categories) or 256)
    assert layer.title


def test_colours_are_the_tables_ends_at_the_limits_and_beyond(layers):
    layer = layers.get("pressure")
    found = layer.colours(np.array([-5.0, 0.0, 255.0, 300.0]))
    assert (found[:2] == layer.table[0, :3]).all()
    assert (found[2:] == layer.table[-1, :3]).all()


def test_what_is_not_known_has_a_colour_that_no_value_has(layers):
    for name in LAYERS:
        layer = layers.get(name)
        unknown = layer.colours(np.array([np.nan]))[0].astype(int)
        apart = np.abs(layer.table[:, :3].astype(int) - unknown).max(axis=1)
        assert apart.min() > 20, name
    assert np.isnan(layers.get("pressure").values("torso", None)).all()
    assert np.isnan(layers.get("raw").values("torso", Moment(0.0, {}))).all()
    assert np.isnan(layers.get("uncertainty").values("torso", None)).all()


def test_binary_says_which_taxels_are_above_the_noise(layers):
    pressures = np.zeros(430)
    pressures[:3] = 12.0, 12.5, np.nan
    values = layers.get("binary").values("torso", Moment(0.0, {"torso": pressures}))
    np.testing.assert_array_equal(values[:4], [0.0, 1.0, np.nan, 0.0])


def test_uncertainty_is_the_largest_deviation_in_millimetres(prepared):
    covariance = np.tile(np.diag([1e-6, 4e-6, 2e-6]), (430, 1, 1))
    layers = Layers({"torso": prepared("torso")}, covariances={"torso": covariance})
    values = layers.get("uncertainty").values("torso", None)
    np.testing.assert_allclose(values, 2.0, rtol=1e-12)  # sqrt of the largest eigenvalue, exact
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turned = Layers({"torso": prepared("torso")}, covariances={"torso": turn @ covariance @ turn.T})
    # Whichever way the part is turned; an eigenvalue solver's rounding.
    np.testing.assert_allclose(turned.get("uncertainty").values("torso", None), 2.0, rtol=1e-9)


def test_distortion_is_the_edge_error_of_the_flat_map(layers, prepared):
    values = layers.get("distortion").values("left_arm", None)
    flat = prepared("left_arm").flat
    total, count = 0.0, 0.0
    for chart in flat.charts:
        valence = np.bincount(chart.distortion.edges.ravel(), minlength=len(chart.taxels))
        total += (valence * (values[chart.taxels] / 100.0) ** 2).sum()
        count += 2 * (chart.distortion.edge_strain**2).sum()
    # Each edge counts once at either end: the sum over taxels is twice that over edges.
    np.testing.assert_allclose(total, count, rtol=1e-9)


def test_structures_are_those_of_the_search_the_most_common_first(prepared):
    skin = prepared("torso")
    layer = Layers({"torso": skin}).get("structures")
    values = layer.values("torso", None)
    radius = auto_radius([skin.skin.positions], near=0.008)  # as `skinmap structures` does
    found = find_structures(skin.neighbourhoods(radius=radius), rotations=6)
    assert layer.title == f"periodic structure within {1e3 * radius:.2f} mm"
    for s in range(4):
        np.testing.assert_array_equal(values == s, found.labels == s)
        assert layer.categories[s] == f"{s}: {found.counts[s]:,} taxels"


def test_patches_are_the_connected_ones_and_those_of_all_parts_are_apart(layers, prepared):
    layer = layers.get("patches")
    chest = prepared("torso").mesh.n_patches
    names = [f"torso {k}" for k in range(chest)] + [f"left arm {k}" for k in range(4)]
    assert layer.categories == (*names, "none")
    patches = prepared("left_arm").patches
    np.testing.assert_array_equal(layer.values("left_arm", None), chest + patches)
    alone = Layers({"left_arm": prepared("left_arm")}).get("patches")
    assert alone.categories == ("patch 0", "patch 1", "patch 2", "patch 3", "none")
    np.testing.assert_array_equal(alone.values("left_arm", None), patches)


def test_health_keeps_what_the_calibration_said_and_learns_who_was_touched(prepared):
    names = np.full(430, "never touched", dtype=object)
    names[:2] = "dead", "ok"
    layers = Layers({"torso": prepared("torso")}, healths={"torso": names})
    layers.observe(Moment(-0.02, {"torso": np.zeros(430)}))
    pressures = np.zeros(430)
    pressures[[0, 1, 2]] = 255.0, 255.0, 40.0
    moment = Moment(0.0, {"torso": pressures})
    layers.observe(moment)
    health = layers.get("health")
    np.testing.assert_array_equal(health.values("torso", moment)[:4], [DEAD, SATURATED, OK, NEVER])
    np.testing.assert_array_equal(
        health.values("torso", Moment(1.0, {"torso": np.zeros(430)}))[:4], [DEAD, OK, OK, NEVER]
    )
    silent = Moment(2.0, {"torso": pressures}, stale=True)
    np.testing.assert_array_equal(health.values("torso", silent)[:3], [DEAD, STALE, STALE])


def test_faded_colours_differ_from_fresh_ones(layers):
    table = layers.get("pressure").table
    assert (np.abs(fade(table).astype(int) - table).max(axis=1) > 20).mean() > 0.9


def test_layers_refuse_what_they_do_not_know(layers, prepared):
    skins = {"torso": prepared("torso")}
    with pytest.raises(UnknownNameError, match=r"'presure'.*pressure, raw, binary"):
        layers.get("presure")
    with pytest.raises(UnknownNameError, match=r"'head'.*torso, left_arm"):
        layers.get("pressure").values("head", None)
    with pytest.raises(SkinMismatchError, match=r"\(3,\).*430 taxels of 'torso'"):
        layers.get("pressure").values("torso", Moment(0.0, {"torso": np.zeros(3)}))
    with pytest.raises(SkinMismatchError, match=r"not numbers"):
        layers.get("pressure").values("torso", Moment(0.0, {"torso": np.array(["a"] * 430)}))
    with pytest.raises(SkinMismatchError, match=r"3 taxels for the 430"):
        Layers(skins, covariances={"torso": np.zeros((3, 3, 3))})
    with pytest.raises(InvalidArrayError, match="NaN"):
        Layers(skins, covariances={"torso": np.full((430, 3, 3), np.nan)})
    with pytest.raises(UnknownNameError, match=r"'broken'.*dead, stuck"):
        Layers(skins, healths={"torso": ["broken"] * 430})
    with pytest.raises(SkinMismatchError, match=r"2 taxels for the 430"):
        Layers(skins, healths={"torso": ["ok", "ok"]})
    with pytest.raises(UnknownNameError, match="'head'"):
        Layers(skins, healths={"head": ["ok"]})


def test_states_are_those_of_the_response_calibration_and_stale():
    from calibration.response.response import Health

    assert set(STATES) == set(Health) | {"unheard", "stale"}


def test_pressures_are_kilopascals_where_a_load_calibration_is_given(prepared):
    n, line = 430, np.zeros((430, FEATURES))
    line[:, 1] = 0.5
    line[7] = np.nan
    each = np.ones(n)
    load = LoadCalibration(
        line, 10 * each, 200 * each, 0 * each, 0.5 * each, 0.01 * each, 0.01, 50.0, "linear",
        0 * each, 0.0,
    )  # fmt: skip
    layers = Layers({"torso": prepared("torso")}, loads={"torso": load})
    layer = layers.get("pressure")
    assert (layer.unit, layer.limits) == ("kPa", (0.0, 50.0))
    found = layer.values("torso", Moment(0.0, {"torso": np.full(n, 110.0)}))
    assert np.isnan(found[7])
    np.testing.assert_allclose(np.delete(found, 7), 25.0)
    assert layers.counts.unit == "counts"
    raw = replace(load, rest=240 * each, span=-200 * each)  # counts that fall from 240
    layers = Layers({"torso": prepared("torso")}, loads={"torso": raw})
    assert np.isnan(layers.get("pressure").values("torso", Moment(0.0, {"torso": 0 * each}))).all()


def test_a_taxel_that_was_never_touched_is_grey_and_sound(prepared):
    skins = {"torso": prepared("torso")}
    part = TouchedPart.of(430)
    part.count[7], part.last[7] = 1, 3.0
    for recordings, where in (["a"], "the whole recording"), (["a", "b"], "all 2 recordings"):
        layers = Layers(skins, touched=lambda r=recordings: Touched(skins, {"torso": part}, r))
        assert layers.get("touched").unit == f"of each taxel, in {where}"
    last = layers.get("touched:last")
    values = last.values("torso", None)
    assert last.grey == "never touched"
    assert np.flatnonzero(np.isfinite(values)).tolist() == [7]
    assert len(signs_of(layers, "torso", last, values)[0]) == 0
    assert len(signs_of(layers, "torso", layers.get("pressure"), values)[0]) == 429
    assert (layers.get("touched").heard, last.heard) == (True, False)


def test_ranges_that_cut_values_are_told(prepared):
    ranges = {"pressure": (10, 40), "raw": (0, 300), "distortion": (0, 9)}
    layers = Layers({"torso": prepared("torso")}, ranges=ranges)
    found = [layers.get(name).cut for name in (*ranges, "uncertainty", "binary")]
    assert found == [(True, True), *[(False, False), (False, True)], (False, True), (False, False)]
