"""The window or picture to draw in: one renderer for the body, one for the panel beside it."""

from __future__ import annotations

from typing import Any

import pyvista as pv

from viewer.colours import BACKGROUND, rgb

BODY_SHARE = 0.68  # of the window's width; the rest is the panel
BODY_RISE = 0.62  # of its height, where the panel stands below the body
TALL = 0.95  # windows that are narrower than this, in their heights, have the panel below


def new_plotter(window_size: tuple[int, int], off_screen: bool, *, panel: bool) -> pv.Plotter:
    """A plotter without anything in it; its active renderer is the body's.

    No anti-aliasing and an even background: both cost more than the body in software rendering.
    """
    plotter = pv.Plotter(
        shape=(1, 2) if panel else (1, 1),
        off_screen=off_screen,
        window_size=list(window_size),
        border=False,
        lighting="none",
    )
    window: Any = plotter.render_window
    window.SetMultiSamples(0)
    if panel:
        place_panel(plotter)
        plotter.renderers[1].InteractiveOff()  # the mouse turns the body, not the flat map
    for renderer in plotter.renderers:
        renderer.camera.is_set = True  # we place them: PyVista must not when the window opens
    plotter.subplot(0, 0)
    plotter.renderer.SetBackground(*rgb(BACKGROUND))
    plotter.add_light(pv.Light(light_type="headlight", intensity=0.8))
    fill = pv.Light(light_type="camera light", intensity=0.35)
    fill.position = (-0.6, 1.2, 1.0)  # from above the left shoulder of who looks
    plotter.add_light(fill)
    return plotter


def place_panel(plotter: pv.Plotter) -> None:
    """Put the panel beside the body, or below it in a tall window."""
    width, height = plotter.window_size
    if width < TALL * height:
        body, panel = (0.0, 1.0 - BODY_RISE, 1.0, 1.0), (0.0, 0.0, 1.0, 1.0 - BODY_RISE)
    else:
        body, panel = (0.0, 0.0, BODY_SHARE, 1.0), (BODY_SHARE, 0.0, 1.0, 1.0)
    for renderer, place in zip(plotter.renderers, (body, panel), strict=True):
        if renderer.GetViewport() != place:
            renderer.SetViewport(*place)
