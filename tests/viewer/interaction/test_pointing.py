"""The mouse in the window, off screen: what it points at and chooses on body and map."""

from __future__ import annotations

import numpy as np


def test_pointing_at_the_body_names_that_very_taxel(window, hands):
    taxels, places = hands.seen_taxels()
    assert len(taxels) > 100
    # The nearest taxel to the pixel is meant; neighbours are 7 pixels apart, pixels are whole.
    for taxel in taxels[::10]:
        pick = window.controls.pointing.pick(*np.round(places[taxel]))
        assert pick is not None
        near = np.linalg.norm(places[pick.taxel] - places[taxel])
        assert (pick.part, pick.where) == ("torso", "body")
        assert pick.taxel == taxel or near < 1.5


def test_pointing_at_the_map_names_that_very_taxel(window, hands):
    taxels, places = hands.map_places()
    for row in range(0, len(taxels), 9):
        pick = window.controls.pointing.pick(*places[row])
        assert (pick.part, pick.taxel, pick.where) == ("torso", taxels[row], "map")


def test_pointing_beside_the_skin_names_nothing(window):
    assert window.controls.pointing.pick(2, 300) is None
    panel = window.scene.panel.renderer
    x, y = panel.GetOrigin()
    assert window.controls.pointing.pick(x + 2, y + 2) is None


def test_box_tells_all_that_is_known_of_a_taxel(window, hands, icub, prepared):
    taxels, places = hands.seen_taxels()
    taxel = int(taxels[len(taxels) // 2])
    before = hands.picture()
    hands.hover(*places[taxel])
    pointing = window.controls.pointing
    skin = icub.skin("torso")
    taxel = pointing.pointed.taxel
    text = "\n".join(pointing.lines(pointing.pointed))
    assert f"torso, channel {skin.channels[taxel]}" in text
    assert f"module {skin.modules[taxel]}" in text
    x, y, z = 1e3 * skin.positions[taxel]
    assert f"position {x:.1f} {y:.1f} {z:.1f} mm" in text
    assert "normal " in text
    assert "structure " in text
    assert "pressure " in text
    faces = prepared("torso").mesh.faces
    around = set(skin.channels[faces[(faces == taxel).any(axis=1)].ravel()]) - {
        skin.channels[taxel]
    }
    told = text.split("neighbours ")[1].split("\n")[0].split()
    assert {int(word) for word in told} == around
    assert (hands.picture() != before).any()
    hands.hover(2, 300)
    assert pointing.pointed is None
    assert np.array_equal(hands.picture(), before), "the box goes away without a trace"


def test_hovering_is_looked_at_no_more_often_than_its_pace(window, hands, monkeypatch):
    pointing = window.controls.pointing
    looks = []
    monkeypatch.setattr(pointing, "pick", lambda x, y: looks.append((x, y)))
    monkeypatch.setattr(pointing._pace, "clock", lambda: 100.0)
    for k in range(50):
        hands.mouse("MouseMoveEvent", 100 + k, 300)
        window.turn()
    assert looks == [(100.0, 300.0)]


def test_click_chooses_taxel_module_and_patch_on_body_and_map(window, hands, icub, prepared):
    taxels, places = hands.seen_taxels()
    taxel = int(taxels[len(taxels) // 3])
    scene, skin = window.scene, icub.skin("torso")
    hands.click(*places[taxel])
    (chosen,) = scene.selection["torso"]
    hands.click(*places[taxel], shift=True)
    module = np.flatnonzero(skin.modules == skin.modules[chosen])
    assert np.array_equal(scene.selection["torso"], module)
    hands.click(*places[taxel], control=True)
    assert set(module) < set(scene.selection["torso"])
    owners, on_map = hands.map_places()
    hands.click(*on_map[10])
    assert scene.selection["torso"].tolist() == [owners[10]]
    hands.click(2, 300)
    assert scene.selection == {}


def test_lasso_on_the_map_chooses_what_it_encloses(window, hands):
    owners, places = hands.map_places()
    low, high = places.min(axis=0), places.max(axis=0)
    middle = (low + high) / 2
    corners = [
        low - 3,
        (middle[0], low[1] - 3),
        (middle[0], high[1] + 3),
        (low[0] - 3, high[1] + 3),
    ]
    wanted = np.unique(owners[places[:, 0] < np.round(middle[0])])
    camera = window.scene.plotter.renderers[0].GetActiveCamera().GetPosition()
    hands.drag(corners)
    chosen = window.scene.selection["torso"]
    # Corners fall on whole pixels: taxels on the line itself may be on either side of it.
    assert len(np.setxor1d(chosen, wanted)) <= 2
    assert len(chosen) > 50
    assert window.scene.plotter.renderers[0].GetActiveCamera().GetPosition() == camera
    right = [
        (middle[0], low[1] - 3),
        high + 3 - (0, high[1] - low[1] + 6),
        high + 3,
        (middle[0], high[1] + 3),
    ]
    hands.drag(right, shift=True)
    assert len(window.scene.selection["torso"]) >= len(np.unique(owners)) - 2
