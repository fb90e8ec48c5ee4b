"""A small scene drawn for real, off screen: the iCub's chest and left upper arm; a browser."""

from __future__ import annotations

import contextlib
import io
import shutil
from collections.abc import Callable, Iterator

import imageio.v3 as iio
import numpy as np
import pytest

from skinmap.errors import MissingLibraryError
from skinmap.live.touches import NamedTouch
from viewer.display import require_opengl

PARTS = ("torso", "left_arm")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--disable-background-networking",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]
DRAWN = "body[data-drawn]:not([data-drawn='0'])"
SMALL = {"width": 640, "height": 480}  # software draws it in a third of the time of 1024x768
PATIENCE = 60_000  # [ms]: a machine may be busy
WIDE = {"width": 800, "height": 600}  # the panel stands beside the body


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


class Tab:
    """One open page and what happened in it."""

    def __init__(self, chromium, url: str, **options) -> None:
        self.context = chromium.new_context(**{"viewport": SMALL, **options})
        self.page = self.context.new_page()
        self.requests: list[str] = []
        self.faults: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on(
            "console",
            lambda message: self.faults.append(message.text) if message.type == "error" else None,
        )
        self.answer = self.page.goto(url)

    def wait(self, selector: str = DRAWN, state: str = "visible") -> None:
        self.page.wait_for_selector(selector, state=state, timeout=PATIENCE)

    def until(self, expression: str) -> None:
        """Wait until an expression holds in the page; not possible where the policy stands."""
        self.page.wait_for_function(expression, timeout=PATIENCE)

    def pixels(self) -> np.ndarray:
        """(h, w, 3) of the robot's picture alone."""
        shot = self.page.locator("#picture").screenshot(type="png")
        return iio.imread(io.BytesIO(shot))[..., :3].astype(int)

    def step(self) -> None:
        self.page.locator("#on").click()

    @contextlib.contextmanager
    def held(self, *keys: str) -> Iterator[None]:
        """While keys are held down."""
        for key in keys:
            self.page.keyboard.down(key)
        yield
        for key in keys:
            self.page.keyboard.up(key)


@pytest.fixture(scope="session")
def chromium() -> Iterator:
    """A real browser without a screen."""
    if CHROMIUM is None:
        pytest.skip("no chromium here: apt-get install chromium to run these tests")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def open_tab(chromium) -> Callable[..., Tab]:
    """Opens an address in a page of its own."""
    return lambda url, **options: Tab(chromium, url, **options)


@pytest.fixture(scope="session")
def open_desk(open_tab) -> Callable[..., Tab]:
    """The same, wide enough for the panel beside the body, and open to questions of the test's."""
    return lambda url, **options: open_tab(url, viewport=WIDE, bypass_csp=True, **options)
