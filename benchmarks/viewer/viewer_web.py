"""The page in headless Chromium beside viser: `python -m benchmarks.viewer.viewer_web`.

The whole iCub with three moving touches at 50 samples a second, software rendering, 1024x768; and
the same with every taxel changing. Time until the page is complete (body, skin and first sample
drawn), drawn updates a second, bytes of a sample, and CPU times: of the server for a sample, of
all of Chromium's processes for an update. The pages are opened in turn, as the machine is not the
same all the time; `viewer_web_watch.py` says how updates are counted and the counters verified.
Without Chromium there is nothing to measure.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from statistics import median
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.asked import judge, table_text
from benchmarks.harness.record import command
from benchmarks.viewer.viewer_web_peer import Viser
from benchmarks.viewer.viewer_web_watch import ARGUMENTS, CHROMIUM, SIZE, watch, watch_peer
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.playing.player import Player
from viewer.web.server import serve

RATE = 50.0  # samples a second
WAYS = ("meshes", "instances")  # of viser
OPENINGS = 3
SECONDS = 5.0  # of counting


def touched(skins: dict[str, PreparedSkin]) -> Iterator[Moment]:
    """Three soft pads that wander over the skin for ever, each for two seconds on a part."""
    names = list(skins)
    places = {part: skin.skin.positions for part, skin in skins.items()}
    step = 0
    while True:
        pressures = {part: np.zeros(len(points)) for part, points in places.items()}
        touches = []
        for pad in range(3):
            part = names[(step // 100 + 4 * pad) % len(names)]
            centre = (37 * pad + step // 3) % len(places[part])
            gap = np.linalg.norm(places[part] - places[part][centre], axis=1)
            pressures[part] = 220.0 * np.exp(-((gap / 0.018) ** 2))
            taxels = np.flatnonzero(pressures[part] > 12)
            touches.append(
                NamedTouch(part, taxels, places[part][centre], "poke", 0.9, identity=pad)
            )
        yield Moment(step / RATE, pressures, tuple(touches), rate=RATE)
        step += 1


def noisy(skins: dict[str, PreparedSkin]) -> Iterator[Moment]:
    """Every taxel changes in every sample: what costs most."""
    rng = np.random.default_rng(0)
    for step, moment in enumerate(touched(skins)):
        pressures = {p: rng.integers(0, 255, len(s)).astype(float) for p, s in skins.items()}
        yield Moment(step / RATE, pressures, moment.touches, rate=RATE)


def measure(quick: bool = False, *, openings: int | None = None) -> dict[str, Any]:
    """Figures of both pages, and what was asked for beside what ours reached.

    Parameters
    ----------
    quick : bool
        Each page once, for two seconds.
    openings : int, optional
        How often each is opened; the medians are told.

    Returns
    -------
    dict
        `chromium` (its version, None where there is none), a row for each page and scene, `asked`.
    """
    if CHROMIUM is None:
        return {"chromium": None}
    from playwright.sync_api import sync_playwright

    times = (1 if quick else OPENINGS) if openings is None else openings
    seconds = 2.0 if quick else SECONDS
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    result: dict[str, Any] = {"taxels": sum(map(len, skins.values())), "size": list(SIZE.values())}
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        result["chromium"] = browser.version
        result["openings"] = times
        for name, moments in (("three touches", touched), ("all taxels change", noisy)):
            rows: dict[str, list[dict[str, float]]] = {}
            for _ in range(times):
                rows.setdefault("ours", []).append(ours(browser, robot, skins, moments, seconds))
                for way in WAYS if has_viser() else ():
                    row = theirs(browser, robot, skins, moments, way, seconds)
                    rows.setdefault(f"viser {way}", []).append(row)
            result[name] = {
                who: {key: median(one[key] for one in all_of) for key in all_of[0]}
                for who, all_of in rows.items()
            }
        browser.close()
    result["load_average"] = os.getloadavg()[0]
    judged = judge({"areas": {"page": {"rows": result, "form": "quick" if quick else "full"}}})
    result["asked"] = [row for row in judged if row["area"] == "page"]
    return result


def ours(
    browser: Any, robot: Any, skins: dict[str, PreparedSkin], moments: Any, seconds: float
) -> dict[str, float]:
    """Our page, opened once."""
    with Player(moments(skins)) as player, serve(robot, skins, player, port=0) as server:
        row = watch(browser, server.url, seconds)
        hub = server.hub
        row["server_cpu_ms_per_sample"] = 1e3 * hub.seconds / max(hub.samples_written, 1)
        row["scene_mb"] = len(hub.scene.packed) / 1e6
    return row | {"load_average": os.getloadavg()[0]}


def theirs(
    browser: Any, robot: Any, skins: dict[str, PreparedSkin], moments: Any, way: str, seconds: float
) -> dict[str, float]:
    """Viser's page, opened once."""
    with Viser(robot, skins, moments(skins), RATE, way) as peer:
        row = watch_peer(browser, peer.url, seconds)
        row["server_cpu_ms_per_sample"] = 1e3 * peer.seconds / max(peer.samples, 1)
        row["bytes_per_sample"] = peer.size / max(peer.samples, 1)
    return row | {"load_average": os.getloadavg()[0]}


def has_viser() -> bool:
    """Whether the peer is installed."""
    return importlib.util.find_spec("viser") is not None


def main() -> None:
    """Measure, write, and print what was asked for beside what came out."""
    import json

    target = command(measure, __doc__, "viewer_web")
    if target is not None:
        print(table_text(json.loads(target.read_text(encoding="utf-8"))["asked"]))


if __name__ == "__main__":
    main()
