"""A small scene drawn for real, off screen: the iCub's chest and left upper arm; a browser."""

from __future__ import annotations

import contextlib
import io
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pytest

from skinmap.display import require_opengl
from skinmap.errors import MissingLibraryError
from skinmap.live.contacts.named_touch import Moment, NamedTouch

PARTS = ("torso", "left_arm")
RATE, COUNT = 50.0, 200  # of the samples of a wandering press
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
    from viewer import Scene

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
    scene.set_layer("pressure")
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


class Hands:
    """Somebody at a window: mouse and keys go through VTK's interactor. Places are pixels."""

    def __init__(self, window) -> None:
        self.window = window

    def wait_until(self, condition) -> None:
        for _ in range(2000):
            if condition():
                return
            self.window.player.wait(self.window.player.number, 0.01)
        raise AssertionError("nothing happened")

    def mouse(self, event, x, y, *, shift=False, control=False) -> None:
        self.window.interactor.SetEventInformation(round(x), round(y), int(control), int(shift))
        self.window.interactor.InvokeEvent(event)

    def key(self, name) -> None:
        self.window.interactor.SetKeySym(name)
        self.window.interactor.InvokeEvent("KeyPressEvent")
        self.window.turn()

    def hover(self, x, y) -> None:
        self.mouse("MouseMoveEvent", x, y)
        self.window.controls.pointing.hurry()
        self.window.turn()

    def drag(self, places, **keys) -> None:
        self.mouse("MouseMoveEvent", *places[0])
        self.mouse("LeftButtonPressEvent", *places[0], **keys)
        for place in places[1:]:
            self.mouse("MouseMoveEvent", *place, **keys)
        self.mouse("LeftButtonReleaseEvent", *places[-1], **keys)
        self.window.turn()

    def click(self, x, y, **keys) -> None:
        self.drag([(x, y)], **keys)

    def seen_taxels(self, part="torso"):
        """Taxels in full view of the camera, and where they are in the window (n, 2) [px]."""
        from viewer.drawing.frame.camera import project

        scene = self.window.scene
        target = self.window.controls.pointing._target(part)
        renderer = scene.plotter.renderers[0]
        places = project(renderer, target.points)
        way = np.array(renderer.GetActiveCamera().GetPosition()) - target.points
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        facing = np.einsum("ij,ij->i", target.normals, way) > 0.6
        open_ = [
            not scene.framing.hidden(replace(target, middle=k)) for k in range(len(target.points))
        ]
        return np.flatnonzero(facing & np.array(open_)), places

    def map_places(self):
        """Taxel of each vertex of the flat map shown, and its place in the window (k, 2) [px]."""
        from viewer.drawing.frame.camera import project

        panel = self.window.scene.panel
        targets = self.window.controls.pointing._map_targets(panel.part)
        uv = np.column_stack([targets.uv, np.zeros(len(targets.uv))])
        return targets.taxels, project(panel.renderer, uv) + np.array(panel.renderer.GetOrigin())

    def picture(self):
        self.window.scene.canvas.cache.forget()
        return self.window.scene.frame()


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


@pytest.fixture(scope="package")
def wandering(icub) -> list[Moment]:
    """Four seconds on the chest: a press that wanders, one taxel further with each sample."""
    n = {part: len(icub.skin(part)) for part in PARTS}
    made = []
    for k in range(COUNT):
        pressures = {part: np.zeros(count) for part, count in n.items()}
        pressures["torso"][k] = 200.0
        made.append(Moment(k / RATE, pressures))
    return made


@pytest.fixture(scope="package")
def drawn(opengl, icub, prepared) -> Iterator:
    """One scene for all windows; each window lets go of it again."""
    from viewer import Layers, Scene
    from viewer.scene import LazyMaps

    skins = {part: prepared(part) for part in PARTS}
    made = Scene(
        icub,
        {part: skin.mesh for part, skin in skins.items()},
        LazyMaps(skins),
        links=("chest", "l_upper_arm"),
        window_size=(800, 600),
        data=Layers(skins),
    )
    yield made
    made.close()


@pytest.fixture
def window(drawn, wandering, tmp_path) -> Iterator:
    """A window on the wandering press, halted at its first sample."""
    from viewer import Player
    from viewer.window import Window

    player = Player(wandering, paused=True)
    made = Window(drawn, player, folder=tmp_path)
    drawn.set_layer("pressure")
    drawn.set_style("surface")
    drawn.show_flat_map("torso")
    drawn.look(drawn.front.azimuth)
    made.controls.pointing.clear()
    player.start()
    Hands(made).wait_until(lambda: player.moment is not None)
    made.turn()
    yield made
    made.controls.pointing.leave()
    made.controls.pointing.clear()
    made.events.close()
    made.controls.remove()
    player.close()


@pytest.fixture
def hands(window) -> Hands:
    """Somebody at that window."""
    return Hands(window)
