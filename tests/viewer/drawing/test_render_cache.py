"""What is drawn from the cache is what would be drawn without it, to the bit."""

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray


def pixels(scene) -> np.ndarray:
    """What the window shows, without drawing."""
    window = scene.plotter.render_window
    width, height = window.GetSize()
    shown = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, shown, 0)
    return vtk_to_numpy(shown).reshape(height, width, 3).copy()


def drawn_anew(scene) -> np.ndarray:
    """The same scene drawn by VTK alone."""
    scene.plotter.render_window.Render()
    return pixels(scene)


def rest(scene) -> None:
    scene.refresh(360.0)
    while scene.refresh(360.0):
        pass


def test_cached_pictures_are_identical_to_those_drawn_anew(at_rest, press):
    scene = at_rest
    rest(scene)
    np.testing.assert_array_equal(pixels(scene), drawn_anew(scene))
    for number, (part, taxel) in enumerate([("torso", 5), ("left_arm", 40), ("torso", 200)]):
        pressures, touch = press(part, taxel)
        scene.set_pressures(part, pressures)
        scene.set_touches([touch])
        assert scene.refresh(360.0), number
        shown = pixels(scene)
        np.testing.assert_array_equal(shown, drawn_anew(scene))
    scene.set_touches([])
    scene.refresh(360.0)
    np.testing.assert_array_equal(pixels(scene), drawn_anew(scene))


def test_cached_pictures_are_identical_while_the_camera_moves_and_after(at_rest):
    scene = at_rest
    rest(scene)
    before = pixels(scene)
    scene.look(scene.front.azimuth + 30.0)
    assert scene.refresh()
    moving = pixels(scene)
    assert scene.canvas.body.quick
    np.testing.assert_array_equal(moving, drawn_anew(scene))
    rest(scene)
    assert not scene.canvas.body.quick
    after = pixels(scene)
    np.testing.assert_array_equal(after, drawn_anew(scene))
    # The quick body differs where it must: in few pixels and by little.
    difference = np.abs(moving.astype(int) - after).max(axis=2)
    assert (difference > 0).any()
    assert (difference > 60).mean() < 0.02
    scene.look(scene.front.azimuth)
    rest(scene)
    np.testing.assert_array_equal(pixels(scene), before)


def test_cached_pictures_follow_pose_style_and_layer(at_rest):
    scene = at_rest
    rest(scene)
    for change in (
        lambda: scene.set_pose({"l_elbow": 0.9, "torso_yaw": 0.3}),
        lambda: scene.set_style("discs"),
        lambda: scene.set_layer("patches"),
        lambda: scene.set_style("surface"),
        lambda: scene.set_layer("pressure"),
        lambda: scene.set_pose({}),
    ):
        before = pixels(scene)
        change()
        rest(scene)
        shown = pixels(scene)
        assert (shown != before).any()
        np.testing.assert_array_equal(shown, drawn_anew(scene))


def test_an_older_mesh_put_in_the_place_of_a_newer_one_is_another_shape(opengl):
    """What is kept shows the newer one, which the older one may not cover."""
    import pyvista as pv

    from viewer.drawing.frame.render_cache import Resting

    older, newer = pv.Plane(i_resolution=1, j_resolution=1), pv.Sphere()
    plotter = pv.Plotter(off_screen=True, window_size=(64, 64))
    actor = pv.Actor(mapper=pv.DataSetMapper(newer))
    actor.mapper.SetScalarVisibility(True)
    plotter.add_actor(actor)
    one = Resting(plotter.renderer, [actor])
    for _ in range(2):
        one.compare()
        one.settle()
    one.compare()
    assert not one.moved
    assert not one.changed
    actor.mapper.dataset = older
    one.compare()
    assert one.moved
    assert one.changed
    one.settle()
    actor.prop.opacity = 0.5
    one.compare()
    assert one.changed
    assert not one.moved
    plotter.close()


def test_refresh_draws_nothing_where_nothing_changed(at_rest, press):
    scene = at_rest
    rest(scene)
    frames = []
    window = scene.plotter.render_window
    watch = window.AddObserver("EndEvent", lambda *_: frames.append(1))
    try:
        assert not scene.refresh()
        scene.set_pressures("torso", np.zeros(len(scene.layers["torso"].skin)))
        assert not scene.refresh()
        assert not frames
        scene.set_pressures("torso", press("torso", 5)[0])
        assert scene.refresh()
        assert frames
    finally:
        window.RemoveObserver(watch)


def test_cached_pictures_follow_the_size_of_the_window(at_rest):
    scene = at_rest
    window = scene.plotter.render_window
    size = tuple(window.GetSize())
    rest(scene)
    before = pixels(scene)
    try:
        window.SetSize(800, 500)
        rest(scene)
        assert pixels(scene).shape == (500, 800, 3)
        np.testing.assert_array_equal(pixels(scene), drawn_anew(scene))
    finally:
        window.SetSize(*size)
    rest(scene)
    np.testing.assert_array_equal(pixels(scene), before)


def test_a_smoothed_still_leaves_the_live_picture_as_it_was(at_rest, tmp_path):
    scene = at_rest
    rest(scene)
    before = pixels(scene)
    scene.screenshot(tmp_path / "still.png")
    rest(scene)
    np.testing.assert_array_equal(pixels(scene), before)


def test_memory_stays_flat_over_many_updates(at_rest, press):
    import resource
    from pathlib import Path

    def memory() -> float:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize() / 2**20

    scene = at_rest
    samples = [press("torso", taxel) for taxel in (5, 80, 200)]

    def update(number: int) -> None:
        pressures, touch = samples[number % 3]
        scene.set_pressures("torso", pressures)
        scene.set_touches([touch] if number % 5 else [])
        scene.refresh(360.0)

    for number in range(60):
        update(number)
    before = memory()
    for number in range(300):
        update(number)
    # A picture of 640 x 480 is 0.9 MB, what a sample brings 0.01: a leak of either would show.
    assert memory() - before < 2.0


def test_cached_pictures_are_identical_when_still_colours_are_kept(at_rest, press):
    """Colours that stay for a while move into the kept picture, and come out of it again."""
    from viewer.drawing.frame.render_cache import IDLE

    scene = at_rest
    rest(scene)
    body = scene.canvas.cache.renderers[0]
    torso = scene.canvas.skins["torso"].drawing.sheet
    scene.set_pressures("torso", press("torso", 5)[0])
    kept = []
    for number in range(IDLE + 4):
        scene.set_pressures("left_arm", press("left_arm", 10 + number)[0])
        assert scene.refresh()
        kept.append(next(one.kept for one in body.coloured if one.actor is torso))
        shown = pixels(scene)
        np.testing.assert_array_equal(shown, drawn_anew(scene))
    assert not kept[0]
    assert kept[-1]
    scene.set_pressures("torso", press("torso", 200)[0])
    scene.refresh()
    assert not next(one.kept for one in body.coloured if one.actor is torso)
    np.testing.assert_array_equal(pixels(scene), drawn_anew(scene))


def test_the_flat_map_catches_up_with_a_moving_body(at_rest, press):
    """Drawn in every other picture while the body moves, it is right again when that rests."""
    scene = at_rest
    rest(scene)
    for number in range(5):
        scene.look(scene.front.azimuth + 4.0 * number)
        scene.set_pressures("torso", press("torso", 20 * number)[0])
        assert scene.refresh()
    rest(scene)
    np.testing.assert_array_equal(pixels(scene), drawn_anew(scene))
