"""A small scene drawn for real, off screen: the iCub's chest and left upper arm."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from skinmap.errors import MissingLibraryError
from skinmap.live.touches import NamedTouch
from viewer.display import require_opengl

PARTS = ("torso", "left_arm")


@pytest.fixture(scope="session")
def opengl() -> None:
    """Skips where nothing can draw; set-up installs what is needed, so only elsewhere."""
    try:
        require_opengl()
    except MissingLibraryError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def scene(opengl, icub, prepared) -> Iterator:
    from viewer.scene import Scene

    made = Scene(
        icub,
        {part: prepared(part).mesh for part in PARTS},
        {part: prepared(part).flat for part in PARTS},
        links=("chest", "l_upper_arm"),
        window_size=(640, 480),
        camera="still",
    )
    yield made
    made.close()


@pytest.fixture
def at_rest(scene):
    """The scene without pressures and touches, seen from the front."""
    for part in PARTS:
        scene.set_pressures(part, np.zeros(len(scene.layers[part].skin)))
    scene.set_touches([])
    scene.set_title(None)
    scene.show_flat_map("torso")
    scene.look(scene.front.azimuth)
    return scene


@pytest.fixture
def press(icub) -> Callable[..., tuple[np.ndarray, NamedTouch]]:
    """Pressures and touch of a round pad of 20 mm around a taxel."""

    def make(part: str, taxel: int, label: str = "poke", counts: float = 200.0):
        skin = icub.skin(part)
        distance = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
        pressures = counts * np.clip(1.0 - (distance / 0.02) ** 2, 0.0, None)
        active = np.flatnonzero(pressures > 12)
        return pressures, NamedTouch(part, active, skin.positions[taxel], label, 0.98)

    return make
