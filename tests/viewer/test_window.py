import numpy as np
import pytest

from viewer.display import has_display


@pytest.fixture
def controls(at_rest):
    from viewer.window import Controls

    made = Controls(at_rest)
    yield made
    at_rest.plotter.renderers[0].RemoveViewProp(made._help.actor)


def test_keys_pause_help_and_close(controls):
    controls.press("space")
    assert controls.paused
    controls.press("space")
    assert not controls.paused
    controls.press("h")
    assert controls.help_shown
    controls.press("h")
    assert not controls.help_shown
    controls.press("w")
    assert not controls.closed
    controls.press("q")
    assert controls.closed


def test_help_overlay_changes_the_picture_and_goes_away(controls, at_rest):
    before = at_rest.frame()
    controls.press("h")
    assert (at_rest.frame() != before).any()
    controls.press("h")
    assert np.array_equal(at_rest.frame(), before)


def test_mouse_takes_the_camera_and_keys_give_it_back(controls, at_rest):
    at_rest.frame()
    camera = at_rest.plotter.renderers[0].GetActiveCamera()
    controls.lead()
    camera.Azimuth(40)
    led = camera.GetPosition()
    at_rest.frame()
    assert camera.GetPosition() == led
    controls.press("r")
    at_rest.frame()
    assert camera.GetPosition() != led
    controls.press("a")
    assert at_rest.framing.mode == "auto"


@pytest.mark.skipif(not has_display(), reason="no display: a window cannot be opened")
def test_play_shows_moments_until_closed(icub, prepared, press):
    from viewer.scene import Scene
    from viewer.window import play

    prepared_torso = prepared("torso")
    scene = Scene(
        icub,
        {"torso": prepared_torso.mesh},
        {"torso": prepared_torso.flat},
        links=["chest"],
        window_size=(400, 300),
        off_screen=False,
    )

    def moments():
        for step in range(6):
            pressures, touch = press("torso", 20 * step)
            yield {"torso": pressures}, [touch], "torso"
        scene.plotter.iren.interactor.ExitCallback()  # as the window's own close button does
        while True:
            yield {}, [], None

    assert play(scene, moments()) >= 1
