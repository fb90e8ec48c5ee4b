import numpy as np
import pytest
from numpy.testing import assert_allclose

from viewer.drawing.body.body_view import Surface
from viewer.drawing.frame.camera import (
    Framing,
    Margins,
    Target,
    View,
    best_view,
    fit,
    front_view,
    sees,
    still_view,
)

SIZE = (900, 700)


@pytest.fixture
def ball(opengl):
    import pyvista as pv

    return Surface(pv.Sphere(radius=0.1))


def target(direction):
    way = np.array(direction, float)
    return Target(0.101 * way[None], way[None], 0)


def test_front_view_looks_at_the_side_with_the_skin():
    normals = np.array([[-1.0, 0.1, 0.0], [-1.0, -0.1, 0.0], [0.0, 0.0, 1.0]])
    assert abs(abs(front_view(normals).azimuth) - 180.0) <= 20.0


@pytest.mark.parametrize(
    ("normal", "rise"),
    [((0, 0, 1), 50.0), ((1, 0, 0.5), 26.57), ((0, -1, 0), 12.0), ((0, 0, -1), 12.0)],
)
def test_a_flat_skin_is_looked_at_from_above_it_and_not_along_it(normal, rise):
    normals = np.tile(np.array(normal, float) / np.linalg.norm(normal), (64, 1))
    view = front_view(normals)
    assert view.elevation == pytest.approx(rise, abs=0.01)
    assert normals[0] @ view.direction > 0.5 or normal[2] < 0


def test_sees_tells_front_from_back(ball):
    assert sees(ball, target([1, 0, 0]), np.array([1.0, 0.0, 0.0]))
    assert not sees(ball, target([-1, 0, 0]), np.array([1.0, 0.0, 0.0]))


def test_sees_notices_what_stands_before(opengl):
    import pyvista as pv

    wall = Surface(pv.Plane(center=(0.5, 0, 0), direction=(1, 0, 0)))
    assert not sees(wall, target([1, 0, 0]), np.array([1.0, 0.0, 0.0]))
    assert sees(wall, target([1, 0, 0]), np.array([0.6, 0.0, 0.8]))


@pytest.mark.parametrize("azimuth", [90.0, -90.0, 150.0])
def test_best_view_turns_to_a_touch_behind(ball, azimuth):
    front = View(-30.0, 12.0)
    touched = target(View(azimuth, 12.0).direction)
    view = best_view([touched], ball, front, front)
    assert view.direction @ touched.normals[0] > 0.8


def test_best_view_stays_where_it_is_for_a_touch_in_view(ball):
    front = View(-30.0, 12.0)
    assert best_view([target(front.direction)], ball, front, front) is front
    assert best_view([], ball, front, front) is front


@pytest.mark.parametrize("azimuths", [(60.0, 120.0), (90.0, 180.0, -150.0), (-30.0, 150.0, 170.0)])
def test_still_view_shows_as_many_touches_as_any_view_can(ball, azimuths):
    front = View(-30.0, 12.0)
    touched = [target(View(azimuth, 12.0).direction) for azimuth in azimuths]

    def seen(view):
        return sum(sees(ball, one, view.direction) for one in touched)

    most = max(seen(View(a, e)) for a in range(-180, 180, 5) for e in range(-10, 51, 10))
    found = still_view(touched, ball, front, front)
    assert seen(found) == most > seen(front)  # from the front alone fewer would be seen


@pytest.mark.parametrize("choose", [best_view, still_view])
@pytest.mark.parametrize("now", [12.0, -45.0])
def test_views_stay_at_a_natural_height_while_anything_is_seen_from_there(ball, choose, now):
    front = View(-30.0, 12.0)
    # Straight below a camera sees two of three, but who stands beside the robot one.
    touched = [target(View(a, e).direction) for a, e in ((0, -85), (180, -80), (90, 20))]
    assert sum(sees(ball, one, View(0, -45).direction) for one in touched) == 2
    found = choose(touched, ball, front, View(0.0, now))
    assert -10.0 <= found.elevation <= 50.0
    assert sees(ball, touched[2], found.direction)


@pytest.mark.parametrize("choose", [best_view, still_view])
def test_views_go_below_for_what_is_seen_from_nowhere_else(ball, choose):
    front = View(-30.0, 12.0)
    sole = target([0, 0, -1])
    found = choose([sole], ball, front, front)
    assert sees(ball, sole, found.direction)
    assert found.elevation < -10.0


def test_still_view_keeps_a_view_that_shows_all(ball):
    front = View(-30.0, 12.0)
    assert still_view([target(front.direction)], ball, front, front) is front


def test_view_turns_the_short_way_and_arrives():
    view = View(170.0, 10.0).towards(View(-170.0, 10.0), 5.0)
    assert_allclose(view.azimuth, 175.0)
    for _ in range(10):
        view = view.towards(View(-170.0, 10.0), 5.0)
    assert view == View(-170.0, 10.0)


@pytest.mark.parametrize("view", [View(0, 12), View(130, -20), View(-75, 35)])
def test_fit_fills_the_picture_without_cutting(opengl, view):
    from vtkmodules.vtkRenderingCore import vtkCamera

    points = np.random.default_rng(3).normal(0, [0.2, 0.1, 0.4], (500, 3))
    camera, margins = vtkCamera(), Margins(left=90, right=60, top=40, bottom=20)
    fit(camera, view, points, SIZE, margins)
    matrix = camera.GetCompositeProjectionTransformMatrix(SIZE[0] / SIZE[1], -1, 1)
    T = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    clip = np.column_stack([points, np.ones(500)]) @ T.T
    pixels = (clip[:, :2] / clip[:, 3:] + 1) / 2 * SIZE
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    # Six rounds of a contraction: within two pixels.
    assert (low >= np.array([90, 20]) - 2).all()
    assert (high <= np.array([900 - 60, 700 - 40]) + 2).all()
    room = np.array([750, 640])
    assert ((high - low) / room).max() > 0.98


def test_a_touch_seen_at_a_flat_angle_is_not_hidden(opengl):
    import pyvista as pv
    from vtkmodules.vtkRenderingCore import vtkRenderer

    renderer = vtkRenderer()
    plate = Surface(pv.Cube(center=(0, 0, -0.01), x_length=0.2, y_length=0.1, z_length=0.02))
    framing = Framing(renderer, plate, list, list, View(0, 12), Margins(0, 0, 0, 0), "still")
    touched = Target(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), 0)
    for elevation, hidden in ((8.0, False), (-8.0, True)):
        renderer.GetActiveCamera().SetPosition(*View(20.0, elevation).direction)
        assert framing.hidden(touched) is hidden
