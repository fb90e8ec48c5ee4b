"""The page in headless Chromium: `python -m benchmarks.viewer.viewer_web`.

The whole iCub with three moving touches at 50 samples a second, software rendering, 1024x768; and
the same with every taxel changing. Time until the page is complete (body, skin and first sample
drawn), drawn updates a second, bytes of a sample, and CPU times: of the server for a sample, of
all of Chromium's processes for an update.
Without Chromium there is nothing to measure.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from statistics import median
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.record import command
from benchmarks.harness.timing import process_table
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.playing.player import Player
from viewer.web.server import serve

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic",
    "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip
SIZE = {"width": 1024, "height": 768}
DRAWN = "body[data-drawn]:not([data-drawn='0'])"
NOW = "[performance.now(), skinmap.stats.drawn]"
PATIENCE = 90_000  # [ms]
TICKS = os.sysconf("SC_CLK_TCK")
RATE = 50.0  # samples a second
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
    """Figures of the page.

    Parameters
    ----------
    quick : bool
        Opened once, for two seconds.
    openings : int, optional
        How often it is opened; the medians are told.

    Returns
    -------
    dict
        `chromium` (its version), `flags` it was started with, a row for each scene.

    Raises
    ------
    RuntimeError
        There is no Chromium.
    """
    if CHROMIUM is None:
        raise RuntimeError("there is no Chromium to open the page in")
    from playwright.sync_api import sync_playwright

    times = (1 if quick else OPENINGS) if openings is None else openings
    seconds = 2.0 if quick else SECONDS
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    result: dict[str, Any] = {"taxels": sum(map(len, skins.values())), "size": list(SIZE.values())}
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        result |= {"chromium": browser.version, "flags": list(ARGUMENTS)}
        result["openings"] = times
        for name, moments in (("three touches", touched), ("all taxels change", noisy)):
            rows = [ours(browser, robot, skins, moments, seconds) for _ in range(times)]
            result[name] = {"ours": {key: median(one[key] for one in rows) for key in rows[0]}}
        browser.close()
    return result


def ours(
    browser: Any, robot: Any, skins: dict[str, PreparedSkin], moments: Any, seconds: float
) -> dict[str, float]:
    """The page, opened once."""
    with Player(moments(skins)) as player, serve(robot, skins, player, port=0) as server:
        row = watch(browser, server.url, seconds)
        hub = server.hub
        row["server_cpu_ms_per_sample"] = 1e3 * hub.seconds / max(hub.samples_written, 1)
    return row | {"load_average": os.getloadavg()[0]}


def watch(chromium: Any, url: str, seconds: float) -> dict[str, float]:
    """Figures of the page, which counts its updates and bytes itself."""
    page = chromium.new_page(viewport=SIZE)
    started = time.perf_counter()
    page.goto(url)
    page.wait_for_selector(DRAWN, timeout=PATIENCE)
    complete = time.perf_counter() - started
    page.wait_for_timeout(1000)
    # Updates a second by the page's own clock, and Chromium's CPU time for one.
    cpu, (began, before) = browser_seconds(), page.evaluate(NOW)
    page.wait_for_timeout(1000 * seconds)
    (ended, after), spent = page.evaluate(NOW), browser_seconds() - cpu
    bytes_, samples = page.evaluate("[skinmap.stats.bytes, skinmap.stats.samples]")
    page.close()
    return {
        "complete_s": complete,
        "bytes_per_sample": bytes_ / max(samples, 1),
        "drawn_per_s": 1e3 * (after - before) / (ended - began),
        "chromium_cpu_ms_per_update": 1e3 * spent / max(after - before, 1),
    }


def browser_seconds() -> float:
    """CPU time of all that this process started [s]."""
    table = process_table()
    ours = new = {os.getpid()}
    while new:
        new = {pid for pid, fields in table.items() if int(fields[1]) in new} - ours
        ours = ours | new
    return sum(int(table[pid][k]) for pid in ours - {os.getpid()} for k in (11, 12)) / TICKS


if __name__ == "__main__":
    command(measure, __doc__, "viewer_web")
