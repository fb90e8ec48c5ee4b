"""How a user wants the scene to look, and the scene that looks so."""

from __future__ import annotations

from dataclasses import dataclass

from skinmap.errors import SkinMismatchError
from skinmap.skin.robot import Robot
from viewer.drawing.body.bare_body import check_links
from viewer.drawing.body.body_view import GOOD_PX
from viewer.drawing.skin.lazy_maps import LazyMaps
from viewer.drawing.touches.contour_cache import EVERY
from viewer.interaction.saving import apply_view
from viewer.interaction.selection import Selection
from viewer.interaction.view_file import SavedView
from viewer.layers import Layers
from viewer.scene import Scene
from viewer.session import Session


@dataclass(frozen=True, slots=True)
class Look:
    """How the scene is shown.

    Attributes
    ----------
    layer, style : str or None
        None for what the view says, or the scene's own.
    angles : mapping of str to float
        Joint angles [rad].
    links : {"all", "skin", "none"}
        What is drawn of the body.
    view : SavedView or None
    follow : bool
        Whether a movie's camera turns to the touches; otherwise it keeps its view.
    detail, contour_rate : float
        As `viewer.scene.Scene` takes them.
    """

    layer: str | None = None
    style: str | None = None
    angles: dict[str, float] | None = None
    links: str = "all"
    view: SavedView | None = None
    follow: bool = False
    detail: float = GOOD_PX
    contour_rate: float = EVERY


def new_scene(session: Session, look: Look, *, size: tuple[int, int], off_screen: bool) -> Scene:
    """The scene that a user asked for.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A layer that does not exist, or a view of another robot.
    """
    if look.view is not None:
        check_view(look.view, session.robot)
    data = Layers(session.skins, covariances=session.covariances, healths=session.healths)
    scene = Scene(
        session.robot,
        {part: skin.mesh for part, skin in session.skins.items()},
        LazyMaps(session.skins),
        data=data,
        angles=look.angles or None,
        links=drawn_links(session, look),
        window_size=size,
        off_screen=off_screen,
        detail=look.detail,
        contour_rate=look.contour_rate,
    )
    if look.view is not None:
        selection = Selection()
        apply_view(scene, look.view, selection)
        for part, taxels in selection.items():
            scene.select(part, taxels)
    if look.layer is not None:
        scene.set_layer(look.layer)
    if look.style is not None:
        scene.set_style(look.style)
    return scene


def check_view(view: SavedView, robot: Robot) -> None:
    """Raise SkinMismatchError for a view of another robot."""
    if view.robot != robot.name:
        raise SkinMismatchError(
            f"the view was saved of {view.robot!r}, this robot is {robot.name!r}"
        )


def drawn_links(session: Session, look: Look) -> tuple[str, ...] | None:
    """Links to draw; None for all."""
    if look.links == "all":
        return None
    return check_links(session.robot, "skin", session.parts) if look.links == "skin" else ()
