"""The page in headless Chromium: `python benchmarks/viewer_web.py`.

The whole iCub with three moving touches at 50 samples a second, software rendering, 1024x768.
Time until the page is complete (body, skin and first sample drawn), bytes of a sample, the
server's CPU time for it, and drawn updates a second, counted by the page when a sample is drawn;
CPU times of Chromium are those of all its processes. Without Chromium there is nothing to measure.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from viewer_web_peer import Viser

import skinmap
from skinmap.live.moment import Moment
from skinmap.live.touches import NamedTouch
from skinmap.touch.prepared import PreparedSkin
from viewer.playing.player import Player
from viewer.web.server import serve

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic",
    "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip
SIZE = {"width": 1024, "height": 768}
DRAWN = "body[data-drawn]:not([data-drawn='0'])"
RATE = 50.0  # samples a second
WAYS = ("meshes", "instances")  # of viser
OPENINGS = 3
SECONDS = 5.0  # of counting
TICKS = os.sysconf("SC_CLK_TCK")


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


def browser_seconds(root: int) -> float:
    """CPU time of a process and of all that it started [s]."""
    parents, spent = {}, {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended meanwhile
            parents[int(folder.name)] = int(fields[1])
            spent[int(folder.name)] = (int(fields[11]) + int(fields[12])) / TICKS
    ours, new = {root}, {root}
    while new:
        new = {pid for pid, parent in parents.items() if parent in new} - ours
        ours |= new
    return sum(spent.get(pid, 0.0) for pid in ours - {root})


def watch(browser: Any, url: str) -> dict[str, float]:
    """Figures of one page."""
    page = browser.new_page(viewport=SIZE)
    started = time.perf_counter()
    page.goto(url)
    page.wait_for_selector(DRAWN, timeout=30_000)
    complete = time.perf_counter() - started
    page.wait_for_timeout(1000)
    now = "[performance.now(), skinmap.stats.drawn, skinmap.stats.bytes, skinmap.stats.samples]"
    cpu, before = browser_seconds(os.getpid()), page.evaluate(now)
    page.wait_for_timeout(1000 * SECONDS)
    after, spent = page.evaluate(now), browser_seconds(os.getpid()) - cpu
    ms, drawn, size, samples = (b - a for a, b in zip(before, after, strict=True))
    page.close()
    return {
        "complete_s": complete,
        "drawn_per_s": 1e3 * drawn / ms,
        "bytes_per_sample": size / max(samples, 1),
        "chromium_cpu_ms_per_update": 1e3 * spent / max(drawn, 1),
    }


HEARD = """
window.peer = { bytes: 0, waiting: 0, drawn: 0 };
const Old = window.WebSocket;
const hear = (socket) => socket.addEventListener("message", ({ data }) => {
  peer.bytes += data.byteLength ?? data.size ?? data.length;
});
window.WebSocket = class extends Old { constructor(...all) { super(...all); hear(this); } };
const OldWorker = window.Worker;
window.Worker = class extends OldWorker {
  constructor(...all) {
    super(...all);
    this.addEventListener("message", () => (peer.waiting += 1));
  }
};
for (const name of ["drawElements", "drawElementsInstanced", "drawArrays"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...all) {
    if (peer.waiting) { peer.waiting = 0; peer.drawn += 1; }
    peer.calls = (peer.calls || 0) + 1;
    return draw.apply(this, all);
  };
}
"""


def watch_peer(browser: Any, peer: Any) -> dict[str, float]:
    """Figures of viser's page: a picture counts as an update if messages came since the last."""
    page = browser.new_page(viewport=SIZE)
    page.add_init_script(HEARD)
    started = time.perf_counter()
    page.goto(peer.url)
    # The body's links and ten parts are drawn, each by a call of its own.
    page.wait_for_function("peer.calls > 40", timeout=60_000)
    complete = time.perf_counter() - started
    page.wait_for_timeout(1000)
    now = "[performance.now(), peer.drawn]"
    cpu, before = browser_seconds(os.getpid()), page.evaluate(now)
    page.wait_for_timeout(1000 * SECONDS)
    after, spent = page.evaluate(now), browser_seconds(os.getpid()) - cpu
    ms, drawn = (b - a for a, b in zip(before, after, strict=True))
    page.close()
    return {
        "complete_s": complete,
        "drawn_per_s": 1e3 * drawn / ms,
        "chromium_cpu_ms_per_update": 1e3 * spent / max(drawn, 1),
    }


def has_viser() -> bool:
    """Whether the peer is installed."""
    return importlib.util.find_spec("viser") is not None


def ours(
    browser: Any, robot: Any, skins: dict[str, PreparedSkin], moments: Any
) -> dict[str, float]:
    """Our page, opened once."""
    with Player(moments(skins)) as player, serve(robot, skins, player, port=0) as server:
        row = watch(browser, server.url)
        hub = server.hub
        row["server_cpu_ms_per_sample"] = 1e3 * hub.seconds / max(hub.samples_written, 1)
        row["scene_mb"] = len(hub.scene.packed) / 1e6
    return row


def theirs(
    browser: Any, robot: Any, skins: dict[str, PreparedSkin], moments: Any, way: str
) -> dict[str, float]:
    """Viser's page, opened once."""
    with Viser(robot, skins, moments(skins), RATE, way) as peer:
        row = watch_peer(browser, peer)
        row["server_cpu_ms_per_sample"] = 1e3 * peer.seconds / max(peer.samples, 1)
        row["bytes_per_sample"] = peer.size / max(peer.samples, 1)
    return row


def measure() -> dict[str, Any]:
    """All figures; `chromium` is None where there is none."""
    if CHROMIUM is None:
        return {"chromium": None}
    from playwright.sync_api import sync_playwright

    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    result: dict[str, Any] = {"taxels": sum(map(len, skins.values())), "size": list(SIZE.values())}
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        result["chromium"] = browser.version
        for name, moments in (("three touches", touched), ("all taxels change", noisy)):
            rows: dict[str, list[dict[str, float]]] = {}
            for _ in range(OPENINGS):  # each in turn, as the machine is not the same all the time
                rows.setdefault("ours", []).append(ours(browser, robot, skins, moments))
                for way in WAYS if has_viser() else ():
                    row = theirs(browser, robot, skins, moments, way)
                    rows.setdefault(f"viser {way}", []).append(row)
            result[name] = {
                who: {key: median(one[key] for one in all_of) for key in all_of[0]}
                for who, all_of in rows.items()
            }
        browser.close()
    result["load_average"] = os.getloadavg()[0]
    return result


def main() -> None:
    """Measure, print and write."""
    result = measure()
    text = json.dumps(result, indent=2)
    print(text)
    target = Path(__file__).parent / "results" / "viewer_web.json"
    target.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
