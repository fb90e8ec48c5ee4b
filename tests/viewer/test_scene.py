from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.live.contacts.named_touch import Moment
from skinmap.touch.images.contact_image import paper_images
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.scene import Scene


def places(scene, part):
    """(n, 2) rows and columns of a part's taxels in the picture, (n,) cosine to the camera."""
    from viewer.drawing.frame.camera import project

    layer = scene.layers[part]
    pose = scene.poses[layer.skin.link]
    points = transform_points(pose, layer.skin.positions)
    normals = transform_directions(pose, layer.skin.normals)
    renderer = scene.plotter.renderers[0]
    xy = project(renderer, points)
    height = scene.plotter.window_size[1]
    camera = np.array(renderer.GetActiveCamera().GetPosition())
    way = camera - points
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    rows_columns = np.stack([height - 1 - xy[:, 1], xy[:, 0]], axis=1).round().astype(int)
    return rows_columns, np.einsum("ij,ij->i", normals, way)


def middle_taxel(scene):
    """A taxel of the torso that faces the camera, in the middle of those."""
    scene.frame()  # places the camera
    at, facing = places(scene, "torso")
    good = np.flatnonzero(facing > 0.9)
    return good[np.argmin(np.linalg.norm(at[good] - np.median(at[good], axis=0), axis=1))]


def test_set_pressures_colours_the_picture_where_the_taxels_are_and_nowhere_else(at_rest, press):
    before = at_rest.frame()
    taxel = middle_taxel(at_rest)
    pressures, _ = press("torso", taxel)
    at_rest.set_pressures("torso", pressures)
    changed = (at_rest.frame() != before).any(axis=2)
    at, _ = places(at_rest, "torso")
    near = np.linalg.norm(at - at[taxel], axis=1) < 8
    assert all(changed[r - 2 : r + 3, c - 2 : c + 3].any() for r, c in at[near])
    body = changed[:, : int(0.68 * changed.shape[1])]
    rows, columns = np.nonzero(body)
    radius = np.linalg.norm(at[pressures > 0] - at[taxel], axis=1).max()
    # One ring of triangles around the pad and the pixel's own width.
    assert np.hypot(rows - at[taxel, 0], columns - at[taxel, 1]).max() < radius + 20
    assert changed[:, body.shape[1] :].any(), "the flat map shows the same pressures"


def test_skin_lies_on_the_outside_of_the_body(at_rest):
    """Pressed everywhere, nearly every taxel that faces the camera shows the pressure's colour."""
    from viewer.colours import PRESSURE_STOPS, ramp, rgb

    layer = at_rest.layers["torso"]
    at_rest.set_pressures("torso", np.full(len(layer.skin), 115.0))
    picture = at_rest.frame().astype(float)
    at, facing = places(at_rest, "torso")
    wanted = ramp(PRESSURE_STOPS)[115, :3] / 255.0
    assert wanted[0] - wanted[2] > 0.5, "a colour that no grey body has"
    shown = 0
    front = np.flatnonzero(facing > 0.3)
    for r, c in at[front]:
        patch = picture[r - 2 : r + 3, c - 2 : c + 3] / 255.0
        shown += bool((patch[..., 0] - patch[..., 2] > 0.3).any())
    # The upper arm, drawn too, hides a few of them.
    assert shown / len(front) > 0.95
    assert np.ptp(rgb("#a6b0bb")) < 0.1


def test_sheet_and_dots_are_lifted_but_do_not_float(at_rest, icub):
    from skinmap.geometry.proximity import closest_on_mesh

    layer = at_rest.layers["torso"]
    mesh = icub.mesh("chest")
    taxels, _, _ = closest_on_mesh(layer.skin.positions, mesh.vertices, mesh.faces)
    k = len(layer.fine.taxels)
    lift = np.einsum(
        "ij,ij->i", layer.points[:k] - layer.fine.positions[:k], layer.fine.normals[:k]
    )
    assert ((lift >= 1.5e-3) & (lift <= 2.5e-3)).all()
    sheet, _, _ = closest_on_mesh(layer.points, mesh.vertices, mesh.faces)
    # Taxels lie within a millimetre or so of the cover; the sheet its lift above that.
    assert np.quantile(sheet, 0.95) < np.quantile(taxels, 0.95) + 2.5e-3
    dots = layer.places.centres
    above = np.einsum("ij,ij->i", dots - layer.skin.positions, layer.skin.normals)
    assert (above > 2.0e-3).all()
    assert (above < 2.7e-3).all()


def test_each_touch_has_a_label_an_outline_and_a_row(at_rest, press):
    taxel = middle_taxel(at_rest)
    one, first = press("torso", taxel, "poke")
    two, second = press("left_arm", 10, "full_finger")
    at_rest.set_pressures("torso", one)
    at_rest.set_pressures("left_arm", two)
    at_rest.set_touches([first, second])
    at_rest.update()
    assert at_rest.canvas.touch_view.labels.texts == (
        "poke 98 %",
        "full finger 98 %, behind",  # of the arm, that the camera has not come round yet
    )
    tints = np.unique(at_rest.canvas.touch_view.marks.outlines.lines.cell_data["colour"], axis=0)
    assert len(tints) == 2
    assert "2 touches" in at_rest.canvas.heading.actor.GetInput()
    at_rest.set_touches([first])
    at_rest.update()
    assert at_rest.canvas.touch_view.labels.texts == ("poke 98 %",)
    at_rest.set_touches([])
    at_rest.update()
    assert at_rest.canvas.touch_view.labels.texts == ()
    assert at_rest.canvas.touch_view.marks.outlines.lines.n_cells == 0


def test_outline_surrounds_the_touch_on_body_and_flat_map(at_rest, press):
    taxel = middle_taxel(at_rest)
    pressures, touch = press("torso", taxel)
    at_rest.set_pressures("torso", pressures)
    at_rest.set_touches([touch])
    at_rest.show_flat_map("torso")
    at_rest.update()
    pose = at_rest.poses["chest"]
    centre = transform_points(pose, touch.centre[None])[0]
    away = np.linalg.norm(
        np.asarray(at_rest.canvas.touch_view.marks.outlines.lines.points) - centre, axis=1
    )
    # A cap of 20 mm cut at a quarter of its peak has a radius of 20 sqrt(3/4) = 17 mm.
    assert away.min() > 0.012
    assert away.max() < 0.025
    uv = at_rest.canvas.panel.flat_maps["torso"].uv[taxel]
    flat = np.linalg.norm(np.asarray(at_rest.panel.marks.outlines.lines.points)[:, :2] - uv, axis=1)
    assert flat.min() > 0.012
    assert flat.max() < 0.025


def test_the_contact_image_stands_beside_the_flat_map(at_rest, press):
    panel = at_rest.canvas.panel
    at_rest.show_flat_map("torso")
    at_rest.update()
    assert not panel._image.GetVisibility()  # nothing is pressed
    at_rest.set_pressures("torso", np.arange(len(at_rest.layers["torso"].skin)) % 4.0)
    at_rest.update()
    assert not panel._image.GetVisibility()  # noise is not stretched to white
    pressures, _ = press("torso", 100)
    at_rest.set_pressures("torso", pressures)
    at_rest.update()
    assert panel._image.GetVisibility()
    shown = panel._image.GetMapper().GetInput()
    columns, rows, _ = shown.GetDimensions()
    assert columns / rows == pytest.approx(100 / 66, abs=0.03)
    grey = np.asarray(pv.wrap(shown)["grey"]).reshape(rows, columns)[::-1]
    skin = PreparedSkin(at_rest.layers["torso"].skin)
    wanted = paper_images(skin.image_geometry, pressures[None], size=(rows, columns))[0]
    np.testing.assert_array_equal(grey, wanted)
    at_rest.set_layer("distortion")
    at_rest.update()
    assert not panel._image.GetVisibility()


def reach(layer, touch, others=()):
    """How far the outline of a touch goes from its centre [m]."""
    from viewer.drawing.touches.touch_marks import outline_touch

    points = outline_touch(layer, touch, [touch, *others]).points(layer.points)
    return np.linalg.norm(points.reshape(-1, 3) - touch.centre, axis=1).max()


def test_outline_leaves_out_what_the_part_feels_elsewhere(at_rest, press):
    layer = at_rest.layers["torso"]
    heights = layer.skin.positions[:, 2]
    (low, touch), (high, _) = (
        press("torso", int(end)) for end in (heights.argmin(), heights.argmax())
    )
    layer.set_pressures(low)
    alone = reach(layer, touch)
    layer.set_pressures(low + high)
    assert reach(layer, touch) == alone < 0.03


def test_outline_ends_where_another_touch_begins(at_rest, press):
    layer = at_rest.layers["torso"]
    gap = np.linalg.norm(layer.skin.positions - layer.skin.positions[100], axis=1)
    (one, touch), (two, beside) = (
        press("torso", taxel) for taxel in (100, int(np.argmin(np.abs(gap - 0.03))))
    )
    layer.set_pressures(np.maximum(one, two))
    assert reach(layer, touch, [beside]) < reach(layer, touch) - 0.002


def test_labels_stay_in_the_picture_clear_of_each_other_and_of_the_bar(at_rest, press):
    from viewer.drawing.words.labels import overlaps

    touches = []
    for taxel in (5, 120, 240, 400):
        pressures, touch = press("torso", taxel, "whole_hand")
        at_rest.set_pressures("torso", pressures)
        touches.append(touch)
    at_rest.set_touches(touches)
    at_rest.update()
    boxes = np.array(at_rest.canvas.touch_view.labels.boxes)
    for i in range(len(boxes)):
        others = np.vstack([np.delete(boxes, i, axis=0), at_rest.canvas.legend.box])
        assert overlaps(boxes[i : i + 1], others)[0] == 0.0
    width, height = at_rest.plotter.renderers[0].GetSize()
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 2:] <= [width, height]).all()


def test_body_fits_in_the_picture_beside_the_panel(at_rest):
    from viewer.colours import BACKGROUND, rgb

    picture = at_rest.frame()
    width = int(0.68 * picture.shape[1])
    bare = np.rint(rgb(BACKGROUND) * 255)
    rows = np.concatenate([picture[1, :width], picture[-2, :width]])
    columns = np.concatenate([picture[:, 1], picture[:, width - 3]])
    for border in (rows, columns):
        # The background's colour is rounded to 8 bits twice.
        assert np.abs(border - bare).max() <= 1


def test_corners_of_a_plain_box_are_in_the_picture(opengl):
    from viewer import Scene
    from viewer.drawing.frame.camera import project

    example = Path(__file__).parents[2] / "docs" / "examples" / "robot" / "robot.toml"
    scene = Scene.load(example, window_size=(640, 480))
    try:
        body, size = scene.canvas.body, scene.canvas.renderer.GetSize()
        corners = [
            transform_points(scene.poses[link], np.asarray(mesh.points, np.float64))
            for link, mesh in body.meshes.items()
        ]
        for azimuth in range(0, 360, 30):
            scene.look(azimuth)
            scene.frame(360.0)
            places = project(scene.canvas.renderer, np.concatenate(corners))
            assert (places > 0).all(), azimuth
            assert (places < size).all(), azimuth
    finally:
        scene.close()


def test_fifty_updates_add_no_actor(at_rest, press):
    def count():
        return sum(r.GetViewProps().GetNumberOfItems() for r in at_rest.plotter.renderers)

    at_rest.set_touches([press("torso", 30)[1], press("left_arm", 30)[1]])
    at_rest.frame()
    before = count()
    for step in range(50):
        part = ("torso", "left_arm")[step % 2]
        pressures, touch = press(part, step, counts=100 + step)
        at_rest.set_pressures(part, pressures)
        at_rest.set_touches([touch] * (1 + step % 2))
        at_rest.show_flat_map(part)
        at_rest.frame()
    assert count() == before


def test_same_state_gives_the_same_picture(at_rest, press):
    pressures, touch = press("torso", 100)
    first = at_rest.frame()
    at_rest.set_pressures("torso", pressures)
    at_rest.set_touches([touch])
    at_rest.frame()
    at_rest.set_pressures("torso", np.zeros_like(pressures))
    at_rest.set_touches([])
    assert np.array_equal(at_rest.frame(), first)


def test_camera_turns_step_by_step_to_a_touch_that_it_does_not_see(at_rest, press):
    from viewer.drawing.frame.camera import View

    pressures, touch = press("torso", middle_taxel(at_rest))
    at_rest.set_pressures("torso", pressures)
    behind = View(at_rest.front.azimuth + 180.0, 12.0)
    at_rest.framing.look(behind, "auto")
    at_rest.set_touches([touch])
    at_rest.update(step=10.0)
    turned = at_rest.framing.view.direction @ behind.direction
    assert np.cos(np.radians(10.5)) < turned < 1.0
    assert at_rest.framing.hidden(at_rest.canvas.touch_view.targets[0])
    for _ in range(40):
        at_rest.update(step=10.0)
    assert not at_rest.framing.hidden(at_rest.canvas.touch_view.targets[0])


def test_screenshot_writes_a_whole_picture_and_nothing_else(at_rest, tmp_path):
    import imageio.v3 as iio

    path = at_rest.screenshot(tmp_path / "still.png")
    assert iio.imread(path).shape == (480, 640, 3)
    assert [file.name for file in tmp_path.iterdir()] == ["still.png"]


def test_set_title_replaces_the_summary_and_none_brings_it_back(at_rest):
    at_rest.set_title("my robot")
    at_rest.update()
    assert at_rest.canvas.heading.actor.GetInput() == "my robot"
    at_rest.set_title(None)
    at_rest.update()
    assert at_rest.canvas.heading.actor.GetInput().startswith("iCub   780 taxels")


def test_scene_refuses_what_it_does_not_know(at_rest, press, prepared, icub):
    from viewer import Scene

    with pytest.raises(UnknownNameError, match=r"'tors'.*torso, left_arm"):
        at_rest.set_pressures("tors", [0.0])
    with pytest.raises(SkinMismatchError, match=r"3,.*430 taxels"):
        at_rest.set_pressures("torso", [0.0, 1.0, 2.0])
    with pytest.raises(UnknownNameError, match="right_arm"):
        at_rest.set_touches([press("right_arm", 0)[1]])
    with pytest.raises(UnknownNameError, match="'head'"):
        at_rest.show_flat_map("head")
    mesh = prepared("torso").mesh
    with pytest.raises(UnknownNameError, match="'left_leg'"):
        Scene(icub, {"torso": mesh}, {}, parts=["left_leg"], links=["chest"])


def test_scene_without_flat_maps_or_body_is_only_the_skin(opengl, icub, prepared):
    from viewer import Scene

    scene = Scene(icub, {"torso": prepared("torso").mesh}, {}, links=(), window_size=(320, 240))
    try:
        picture = scene.frame()
        assert scene.panel is None
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
        with pytest.raises(UnknownNameError, match="flat map"):
            scene.show_flat_map("torso")
    finally:
        scene.close()


def test_the_first_flat_map_is_of_a_part_that_the_source_has(opengl, icub, prepared):
    skins = {part: prepared(part) for part in ("left_arm", "torso")}
    meshes, maps = ({p: getattr(s, k) for p, s in skins.items()} for k in ("mesh", "flat"))
    scene = Scene(icub, meshes, maps, links="skin", window_size=(320, 240))
    rest = Moment(0.0, {"torso": np.zeros(len(skins["torso"]))})
    scene.show_moment(rest)
    assert scene.panel.part == "torso"
    scene.show_flat_map("left_arm")
    scene.show_moment(replace(rest, time=1.0))
    assert scene.panel.part == "left_arm", "one that is chosen stays"
    scene.close()
