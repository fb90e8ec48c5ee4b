"""Three pictures as they were when somebody looked at them and found them good.

`python tests/viewer/test_images.py` makes them anew; look at each before you commit it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment, NamedTouch

GOLDEN = Path(__file__).parent / "golden"
SIZE = (480, 360)
CELL = 6  # pixels: pictures are compared by the means of such squares, so that edges may move a bit
BOUND = 24.0  # of 255: what Mesa's versions make of lines, letters and shading stays below it
SHARE = 0.005  # of all squares that may differ by more: a missing label is more than that


def press(skin, taxel, label, identity, counts):
    """Pressures of a pad of 25 mm, and a touch of which everything is known."""
    distance = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
    pressures = counts * np.clip(1.0 - (distance / 0.025) ** 2, 0.0, None)
    active = np.flatnonzero(pressures > 12)
    normal = skin.normals[active].mean(axis=0)
    centre = skin.positions[taxel]
    across = np.cross(normal, [0.0, 0.0, 1.0])
    path = centre + np.linspace(-0.03, 0.0, 10)[:, None] * across / np.linalg.norm(across)
    return pressures, NamedTouch(
        skin.part, active, centre, label, 0.93, identity=identity, began=0.2,
        normal=normal / np.linalg.norm(normal), area=len(active) * 3e-5, peak=counts, path=path,
    )  # fmt: skip


def moment(scene):
    """Two touches that the camera sees."""
    pressures, touches = {}, []
    taxels = {"torso": (100, "poke", 210.0), "left_arm": (30, "grab", 140.0)}
    for number, (part, (taxel, label, counts)) in enumerate(taxels.items()):
        felt, touch = press(scene.layers[part].skin, taxel, label, number, counts)
        pressures[part] = felt
        touches.append(touch)
    return Moment(1.5, pressures, tuple(touches), rate=50.0, latency=0.004)


def touches(scene):
    """Two touches on the surface, two taxels selected and traced."""
    whole = moment(scene)
    for step in range(100):
        felt = {part: p * step / 100 for part, p in whole.pressures.items()}
        scene.show_moment(Moment(0.015 * step, felt))
    scene.show_moment(whole)
    scene.select("torso", [100, 104])


def health(scene):
    """Discs coloured by health, with signs."""
    scene.show_moment(Moment(0.0, {p: np.zeros(len(one.skin)) for p, one in scene.layers.items()}))
    scene.set_style("discs")
    scene.set_layer("health")


def structures(scene):
    """A surface coloured by structure, where the stream has fallen silent."""
    scene.canvas.status.clock = lambda: scene.canvas.status._fresh + 2.3
    scene.show_moment(Moment(0.0, moment(scene).pressures, stale=True))
    scene.set_layer("structures")


PICTURES = {"touches": touches, "health": health, "structures": structures}


def draw(name, robot, skins):
    """One of the pictures (h, w, 3)."""
    from viewer import Layers, Scene

    states = np.full(len(skins["torso"]), "never touched", dtype=object)
    for k, state in enumerate(("dead", "stuck", "saturated", "noisy", "ok")):
        states[20 + 40 * k : 50 + 40 * k] = state
    scene = Scene(
        robot,
        {part: skin.mesh for part, skin in skins.items()},
        {part: skin.flat for part, skin in skins.items()},
        links=("chest", "l_upper_arm"),
        window_size=SIZE,
        camera="still",
        data=Layers(skins, healths={"torso": states} if name == "health" else None),
    )
    try:
        PICTURES[name](scene)
        return scene.frame()
    finally:
        scene.close()


def cells(picture):
    """Mean colours of squares of a picture, 0 to 255."""
    height, width = (side // CELL * CELL for side in picture.shape[:2])
    squares = picture[:height, :width].reshape(height // CELL, CELL, width // CELL, CELL, 3)
    return squares.astype(float).mean(axis=(1, 3))


def differing(picture, golden):
    """Share of squares whose mean colours differ by more than the bound."""
    return (np.abs(cells(picture) - cells(golden)).max(axis=2) > BOUND).mean()


@pytest.mark.parametrize("name", PICTURES)
def test_picture_looks_as_it_did(opengl, icub, prepared, tmp_path, name):
    import imageio.v3 as iio

    picture = draw(name, icub, {part: prepared(part) for part in ("torso", "left_arm")})
    golden = iio.imread(GOLDEN / f"{name}.png")
    assert picture.shape == golden.shape
    share = differing(picture, golden)
    if share > SHARE:
        iio.imwrite(tmp_path / f"{name}.png", picture)
    assert share <= SHARE, f"look at {tmp_path / name}.png beside {GOLDEN / name}.png"


def test_comparison_sees_a_missing_label_but_not_noise():
    import imageio.v3 as iio

    golden = iio.imread(GOLDEN / "touches.png")
    noisy = golden + np.random.default_rng(0).normal(0, 6, golden.shape)
    assert differing(np.clip(noisy, 0, 255), golden) == 0.0
    without = golden.copy()
    without[250:275, 108:186] = golden[2, 2]
    assert differing(without, golden) > SHARE
    assert differing(iio.imread(GOLDEN / "health.png"), golden) > 5 * SHARE


if __name__ == "__main__":
    import imageio.v3 as iio

    import skinmap
    from skinmap.touch.prepared_skin import PreparedSkin

    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in ("torso", "left_arm")}
    GOLDEN.mkdir(exist_ok=True)
    for name in PICTURES:
        iio.imwrite(GOLDEN / f"{name}.png", draw(name, robot, skins), optimize=True)
