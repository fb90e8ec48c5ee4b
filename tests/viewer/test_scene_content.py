"""What the scene shows: layers, styles, moments, selections, poses, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.geometry.topology import border_edges
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from viewer.layers import LAYERS


@pytest.fixture
def shown(at_rest):
    """The scene at rest, put back afterwards."""
    yield at_rest
    at_rest.set_layer("pressure")
    at_rest.set_style("surface")
    for part in at_rest.layers:
        at_rest.select(part, [])
    at_rest.set_pose({})
    zeros = {part: np.zeros(len(layer.skin)) for part, layer in at_rest.layers.items()}
    at_rest.show_moment(Moment(0.0, zeros))
    at_rest.update()


@pytest.fixture
def moment(press):
    """A moment of two touches with all that is known of them."""
    one, first = press("torso", 100)
    two, second = press("left_arm", 30, "grab")
    known = {"normal": np.array([0.0, 0.0, 1.0]), "area": 1e-3, "peak": 200.0, "began": 0.5}
    path = first.centre + np.linspace(-0.03, 0.0, 12)[:, None] * [0.0, 1.0, 0.0]
    touches = (replace(first, path=path, identity=1, **known), replace(second, identity=2, **known))
    return Moment(2.0, {"torso": one, "left_arm": two}, touches, rate=50.0, latency=0.004)


def counted(scene):
    return sum(r.GetViewProps().GetNumberOfItems() for r in scene.plotter.renderers)


def test_layers_and_styles_change_the_picture_and_add_no_actor(shown, moment):
    shown.show_moment(moment)
    pictures = {}
    # Labels keep their place where they can, and make room for the longest legend once.
    for style in ("surface", "discs") * 2:
        for name in LAYERS:
            shown.set_style(style)
            shown.set_layer(name)
            pictures[name, style] = shown.frame()
    before = counted(shown)
    for name, style in pictures:
        shown.set_style(style)
        shown.set_layer(name)
        again = shown.frame()
        assert np.array_equal(again, pictures[name, style]), "a layer looks the same each time"
    assert counted(shown) == before
    keys = list(pictures)
    for i, one in enumerate(keys):
        for other in keys[i + 1 :]:
            assert not np.array_equal(pictures[one], pictures[other]), (one, other)


def test_body_and_flat_map_show_a_taxel_in_the_colour_of_its_layer(shown, moment):
    """Discs on the flat map, which nothing shades, have exactly the layer's colour."""
    from viewer.drawing.frame.camera import project

    shown.show_moment(replace(moment, touches=()))
    shown.set_style("discs")
    for name in ("pressure", "structures", "distortion"):
        shown.set_layer(name)
        picture = shown.frame()
        layer = shown.layer
        wanted = layer.colours(layer.values("torso", moment))
        panel = shown.panel
        centres = panel.places("torso").centres
        xy = project(panel.renderer, centres)
        left = shown.plotter.window_size[0] - panel.renderer.GetSize()[0]
        rows = picture.shape[0] - 1 - np.floor(xy[:, 1]).astype(int)
        seen = picture[rows, left + np.floor(xy[:, 0]).astype(int)]
        taxels = panel.places("torso").taxels
        apart = np.abs(seen.astype(int) - wanted[taxels]).max(axis=1)
        mesh = shown.layers["torso"].mesh
        apart = apart[~np.isin(taxels, border_edges(mesh.faces))]  # a line runs through those
        # A map of colours has 256 steps, and a single float of a value may fall into the next.
        step = np.abs(np.diff(layer.table[:, :3].astype(int), axis=0)).max()
        limit = 0 if layer.categories else step
        assert (apart <= limit).mean() > 0.98, name


def test_moment_writes_rate_latency_and_what_is_known_of_touches(shown, moment):
    shown.show_moment(replace(moment, dropped=3))
    shown.update()
    assert shown.canvas.status.texts == ("50 samples/s,  shown after 4 ms,  3 left out",)
    listed = shown.panel.list.texts
    assert listed[0] == "2 touches"
    assert listed[1] == " poke 98 % "
    assert listed[2].startswith("torso   1,000 mm\u00b2")
    shown.show_moment(Moment(2.0, moment.pressures))
    shown.update()
    assert shown.canvas.status.texts == ()
    assert shown.panel.list.texts == ("no touch",)


def test_arrow_and_trail_are_drawn_only_where_they_are_known(shown, moment):
    marks = shown.canvas.touch_view.marks
    shown.show_moment(moment)
    shown.update()
    full = marks.outlines.lines.n_cells
    assert marks.solids.n_cells > 0
    bare = tuple(replace(touch, normal=None, path=None) for touch in moment.touches)
    shown.show_moment(replace(moment, touches=bare))
    shown.update()
    assert marks.solids.n_cells == 0
    assert 0 < marks.outlines.lines.n_cells < full


def test_stale_stream_is_said_and_fades(shown, moment):
    status = shown.canvas.status
    now = [10.0]
    status.clock = lambda: now[0]
    shown.show_moment(moment)
    fresh = shown.frame()
    now[0] = 12.3
    shown.show_moment(replace(moment, stale=True))
    faded = shown.frame()
    assert status.texts == (" no data for 2.3 s ",)
    share = (fresh != faded).any(axis=2).mean()
    assert share > 0.02, "the skin looks different, not only the text"
    now[0] = 13.0
    shown.update()
    assert status.texts == (" no data for 3.0 s ",)
    shown.show_moment(moment)
    assert np.array_equal(shown.frame(), fresh)


def test_selection_is_ringed_on_body_and_map_and_traced(shown, moment):
    for step in range(30):
        felt = {part: p * step / 30 for part, p in moment.pressures.items()}
        shown.show_moment(replace(moment, time=0.02 * step, pressures=felt, touches=()))
    before = shown.frame()
    shown.select("torso", [100, 7, 100])
    after = shown.frame()
    assert shown.selection["torso"].tolist() == [7, 100]
    changed = (before != after).any(axis=2)
    width = shown.plotter.renderers[0].GetSize()[0]
    assert changed[:, :width].any(), "a ring on the body"
    names = shown.panel.plot.texts
    channels = shown.layers["torso"].skin.channels
    assert names[0] == "torso, counts by channel"
    assert names[1:3] == (str(channels[7]), str(channels[100]))
    shown.select("torso", np.arange(50))
    shown.update()
    assert shown.panel.plot.texts[1:3] == ("mean", "largest of 50 taxels")
    shown.select("torso", [])
    assert shown.selection == {}
    assert np.array_equal(shown.frame(), before)


def test_ten_touches_are_counted_and_the_largest_are_labelled(shown, press):
    touches = [press("torso", 14 * k)[1] for k in range(30)]
    shown.set_touches(touches)
    shown.frame()
    assert len(shown.canvas.touch_view.labels.texts) == 8
    texts = shown.panel.list.texts
    fits = shown.panel.list.fits_tight
    assert fits > shown.panel.list.fits, "many touches take one line each"
    assert texts[0] == "30 touches"
    assert texts[-1] == f"+{30 - fits} more"


def test_pose_moves_body_skin_outlines_and_labels(shown, moment):
    shown.show_moment(moment)
    shown.update()
    view = shown.canvas.touch_view
    lines = np.array(view.marks.outlines.lines.points)
    turned = Moment(
        2.0, moment.pressures, moment.touches, angles={"torso_yaw": 0.3, "l_shoulder_roll": 0.9}
    )
    shown.show_moment(turned)
    shown.update()
    chest = shown.poses["chest"]
    assert np.allclose(
        chest, shown.robot.body.poses({**shown.robot.pose, **turned.angles})["chest"]
    )
    moved = np.array(view.marks.outlines.lines.points)
    assert moved.shape == lines.shape
    assert np.linalg.norm(moved - lines, axis=1).max() > 0.01
    for part, skin in shown.canvas.skins.items():
        link = shown.layers[part].skin.link
        for actor in skin.actors:
            np.testing.assert_allclose(actor.user_matrix, shown.poses[link], atol=1e-12)
    shown.set_pose({})
    shown.update()
    # Points are kept as single floats.
    np.testing.assert_allclose(view.marks.outlines.lines.points, lines, atol=1e-6)


def test_pose_beyond_a_limit_names_joint_and_limits(shown):
    with pytest.raises(
        InvalidArrayError,
        match=r"'torso_yaw' cannot be at 515.7 degrees: its limits are -50.0 degrees to 50",
    ):
        shown.set_pose({"torso_yaw": 9.0})
    with pytest.raises(InvalidArrayError, match="'torso_yaw'"):
        shown.show_moment(Moment(0.0, {}, angles={"torso_yaw": float("nan")}))
    with pytest.raises(UnknownNameError, match=r"joint 'torso_jaw'.*torso_yaw"):
        shown.set_pose({"torso_jaw": 0.0})


def test_unknown_values_are_drawn_as_unknown_and_signed(shown, moment):
    pressures = dict(moment.pressures)
    pressures["torso"] = pressures["torso"].copy()
    whole = shown.frame()
    pressures["torso"][50:60] = np.nan, np.inf, -np.inf, *[np.nan] * 7
    shown.show_moment(replace(moment, pressures=pressures, touches=()))
    assert not np.array_equal(shown.frame(), whole)
    assert shown.canvas.skins["torso"].signs[0].tolist() == list(range(50, 60))
    assert "10 stale" in " ".join(shown.canvas.legend.texts)
    shown.show_moment(replace(moment, pressures={"torso": np.full(430, 1e9)}, touches=()))
    shown.frame()
    shown.set_layer("raw")
    shown.frame()
    assert "no raw values in this source" in " ".join(shown.canvas.legend.texts)


def test_legend_has_title_unit_and_limits_or_categories(shown):
    legend = shown.canvas.legend
    for name in LAYERS:
        shown.set_layer(name)
        shown.update()
        layer = shown.layer
        written = " ".join(reversed(legend.texts))  # from the top; long lines are broken
        assert layer.title in written
        if layer.categories:
            assert set(layer.categories) <= set(legend.texts)
        else:
            assert layer.unit in written
            assert any(text.startswith(f"{layer.limits[1]:g}") for text in legend.texts)
        left, bottom, right, top = legend.box
        assert 0 <= left < right < shown.plotter.renderers[0].GetSize()[0]
        assert 0 <= bottom < top < shown.plotter.window_size[1]


def test_moment_of_another_skin_is_refused_and_nothing_of_it_is_shown(shown, moment, press):
    shown.show_moment(moment)
    before = shown.frame()
    with pytest.raises(SkinMismatchError, match=r"3,.*430 taxels of 'torso'"):
        shown.show_moment(replace(moment, pressures={"torso": np.zeros(3)}))
    with pytest.raises(SkinMismatchError, match=r"moment of head for a scene of torso, left_arm"):
        shown.show_moment(Moment(0.0, {"head": np.zeros(3)}))
    far = NamedTouch("torso", np.array([429, 430]), np.zeros(3), "poke", 0.5)
    with pytest.raises(SkinMismatchError, match=r"taxels 429 to 430 for the 430"):
        shown.show_moment(replace(moment, touches=(far,)))
    assert np.array_equal(shown.frame(), before)
    # Parts that are not shown are left out, with their touches.
    other = replace(moment, pressures={**moment.pressures, "right_arm": np.zeros(350)})
    shown.show_moment(replace(other, touches=(*moment.touches, press("right_arm", 3)[1])))
    assert len(shown.touches) == 2


def test_scene_names_what_exists_when_asked_for_something_else(shown):
    with pytest.raises(UnknownNameError, match=r"layer 'pres'.*pressure, raw"):
        shown.set_layer("pres")
    with pytest.raises(UnknownNameError, match=r"style 'disc'.*surface, discs"):
        shown.set_style("disc")
    with pytest.raises(UnknownNameError, match=r"'head'.*torso, left_arm"):
        shown.select("head", [0])
    with pytest.raises(InvalidArrayError, match=r"taxels 0 to 429, not 3 to 430"):
        shown.select("torso", [3, 430])


def test_overlays_follow_the_size_of_the_window(opengl, icub, prepared):
    from viewer import Scene

    part = "left_arm"
    scene = Scene(
        icub, {part: prepared(part).mesh}, {part: prepared(part).flat}, links=(),
        window_size=(640, 480), camera="still",
    )  # fmt: skip
    try:
        scene.frame()
        small = scene.canvas.legend.box
        scene.plotter.window_size = [1280, 960]
        picture = scene.frame()
        assert picture.shape == (960, 1280, 3)
        assert scene.font_px == 18
        assert scene.canvas.legend.box[3] > 1.3 * small[3]
        places = scene.panel.places(part).points
        from viewer.drawing.frame.camera import project

        xy = project(scene.panel.renderer, places)
        assert (xy > 0).all()
        assert (xy < scene.panel.renderer.GetSize()).all()
    finally:
        scene.close()


def test_load_makes_a_picture_in_five_lines(opengl, tmp_path):
    from viewer import Scene

    scene = Scene.load("icub", ["left_hand"], links=["l_hand"], window_size=(320, 240))
    scene.set_pressures("left_hand", np.linspace(0, 255, len(scene.layers["left_hand"].skin)))
    scene.set_layer("binary")
    path = scene.screenshot(tmp_path / "hand.png")
    scene.close()
    assert path.stat().st_size > 2000


def test_a_graphics_card_draws_the_same_without_what_is_kept(shown, moment):
    """The switch for cards, asked for where software draws: the same pictures, changed or not."""
    cache = shown.canvas.cache
    assert cache.cached is not False
    for change in (lambda: None, lambda: shown.set_style("discs"), lambda: shown.look(40.0)):
        change()
        shown.show_moment(moment)
        for _ in range(3):
            shown.frame(360.0)  # until labels and camera have come to rest
        pictures = []
        for cached in (True, False):
            cache.cached = cached
            cache.forget()
            pictures.append(shown.frame(360.0))
        assert np.array_equal(*pictures)
        assert not shown.refresh(), "nothing changed, nothing is drawn"
    cache.cached = True
    cache.forget()
    shown.set_style("surface")


@pytest.mark.parametrize(
    ("name", "software"),
    [("llvmpipe (LLVM 15.0.6, 256 bits)", True), ("NVIDIA H200/PCIe/SSE2", False), ("", False)],
)
def test_what_draws_is_told_by_its_name(name, software):
    from viewer.drawing.frame.render_cache import is_software

    class Window:
        def ReportCapabilities(self) -> str:  # noqa: N802 - VTK's
            return f"OpenGL vendor string:  x\nOpenGL renderer string:  {name}\nOpenGL version"

    assert is_software(Window()) is software


def test_few_absent_parts_are_named_and_many_are_counted():
    from viewer.drawing.frame.canvas import absent

    assert absent([]) == []
    assert absent(["left_arm", "torso"]) == ["grey: not in this source: left arm, torso"]
    assert absent(f"part_{k}" for k in range(11)) == ["grey: not in this source: 11 parts"]


def test_the_panel_of_a_large_skin_has_a_long_scale_bar_and_commas(opengl):
    import pyvista as pv

    from skinmap.skin.skin import skin_from_points
    from skinmap.touch.prepared_skin import PreparedSkin
    from viewer.drawing.panel.flat_panel import FlatPanel
    from viewer.drawing.skin.skin_layer import SkinLayer
    from viewer.drawing.skin.taxel_drawing import ColourTable
    from viewer.drawing.touches.touch_marks import KeptContours

    points = 0.1 * np.column_stack([*np.divmod(np.arange(1200), 30), np.zeros(1200)])
    skin = PreparedSkin(skin_from_points(points, np.tile([0.0, 0.0, 1.0], (1200, 1))))
    plotter = pv.Plotter(off_screen=True, window_size=[400, 700])
    layers, maps = {"hull": SkinLayer(skin.mesh)}, {"hull": skin.flat}
    panel = FlatPanel(plotter, layers, maps, ColourTable(), 14, KeptContours())
    panel.show("hull")
    panel.fit(14)
    assert panel._about.text == "1,200 taxels, 1 patch"
    assert panel._length.text in ("1 m", "2 m")
    plotter.close()
