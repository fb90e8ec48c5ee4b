"""Taxels that hang, in a real browser: their sign, no pressure, and a word in the legend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from viewer import Layers
from viewer.export.html_page import page
from viewer.web.sample import pack_reel
from viewer.web.scene_data import WebScene

STUCK, NOISY = [3, 4, 5], [60]
UNKNOWN = 255


@pytest.fixture
def hanging(moments):
    """The touch on the chest beside taxels that hang at 198 counts, and one that is noisy."""
    states = np.full(len(moments[1].pressures["torso"]), "ok", "<U7")
    states[STUCK], states[NOISY] = "stuck", "noisy"
    felt = moments[1].pressures["torso"].copy()
    felt[STUCK + NOISY] = 198.0
    pressures = {**moments[1].pressures, "torso": felt}
    return replace(moments[1], pressures=pressures, states={"torso": states})


@pytest.fixture(params=["served", "a file"])
def tab(request, open_desk, start, hanging, icub, prepared, tmp_path):
    if request.param == "served":
        address = start(moments=[hanging]).url
    else:
        skins = {part: prepared(part) for part in ("torso", "left_arm")}
        scene = WebScene(icub, skins, links=("chest",))
        path = tmp_path / "page.html"
        path.write_text(page(scene.packed, pack_reel(scene, Layers(skins), [hanging]), "iCub"))
        address = path.as_uri()
    made = open_desk(address)
    made.wait()
    yield made
    assert made.faults == []
    made.context.close()


def test_page_draws_signs_and_no_pressure(tab):
    tab.wait("#bar-missing:has-text('with a sign, not to be trusted: 3 stuck, 1 noisy')")
    signed = tab.page.evaluate("skinmap.flat.signs.map(({ number }) => number)")
    assert sorted(signed) == STUCK + NOISY
    codes = tab.page.evaluate("[...skinmap.sample.arrays.values]")
    assert {codes[number] for number in signed} == {UNKNOWN}
    tab.page.select_option("#layer", "health")
    tab.until(f"skinmap.layer.name === 'health' && skinmap.sample.arrays.values[3] !== {UNKNOWN}")
    names = tab.page.evaluate(
        "[...skinmap.sample.arrays.values].map((code) => skinmap.layer.categories[code])"
    )
    assert [names[number] for number in STUCK + NOISY] == ["stuck"] * 3 + ["noisy"]
