"""Opens pages in headless Chromium and counts what they draw: ours and viser's, the same way.

An update is a picture begun after a message came. Counters are checked a second time: in each frame
of the browser the canvas is read, and pictures that differ from the one before are counted beside
the updates of the same seconds.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic",
    "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip
SIZE = {"width": 1024, "height": 768}
DRAWN = "body[data-drawn]:not([data-drawn='0'])"
PATIENCE = 90_000  # [ms]
TICKS = os.sysconf("SC_CLK_TCK")

# Canvases are looked at in half their size, without the labels, which stand in front of them.
PROBE = """
window.probe = { frames: 0, pictures: 0, canvases: () => [...document.querySelectorAll("canvas")] };
window.startProbe = () => {
  const paper = new OffscreenCanvas(512, 384);
  const pen = paper.getContext("2d", { willReadFrequently: true });
  let last = 0;
  const look = () => {
    const seen = probe.canvases().filter((one) => one.width > 200 && !one.hidden).at(-1);
    if (seen) {
      pen.drawImage(seen, 0, 0, 512, 384);
      const data = new Uint32Array(pen.getImageData(0, 0, 512, 384).data.buffer);
      let sum = 0;
      for (let k = 0; k < data.length; k++) sum = (Math.imul(sum, 31) + data[k]) | 0;
      probe.frames += 1;
      probe.pictures += sum !== last;
      last = sum;
    }
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
};
"""
# Our picture while the camera rests.
OURS = "probe.canvases = () => [document.getElementById('rest')]"
# A picture of viser's counts as an update where its worker has handed messages on since the last.
HEARD = """
window.peer = { waiting: 0, drawn: 0, calls: 0 };
const Old = window.Worker;
window.Worker = class extends Old {
  constructor(...all) {
    super(...all);
    this.addEventListener("message", () => (peer.waiting += 1));
  }
};
for (const name of ["drawElements", "drawElementsInstanced", "drawArrays"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...all) {
    if (peer.waiting) { peer.waiting = 0; peer.drawn += 1; }
    peer.calls += 1;
    return draw.apply(this, all);
  };
}
"""


def watch(browser: Any, url: str, seconds: float) -> dict[str, float]:
    """Figures of our page, which counts its updates and bytes itself."""
    page = browser.new_page(viewport=SIZE)
    page.add_init_script(PROBE)
    found = _opened(page, url, lambda: page.wait_for_selector(DRAWN, timeout=PATIENCE))
    found["complete_by_its_clock_s"] = page.evaluate("skinmap.stats.complete") / 1e3
    found |= _counted(page, "skinmap.stats.drawn", seconds)
    bytes_, samples = page.evaluate("[skinmap.stats.bytes, skinmap.stats.samples]")
    page.evaluate(OURS)
    found |= _verified(page, "skinmap.stats.drawn", seconds)
    page.close()
    return {"bytes_per_sample": bytes_ / max(samples, 1), **found}


def watch_peer(browser: Any, url: str, seconds: float) -> dict[str, float]:
    """Figures of viser's page."""
    page = browser.new_page(viewport=SIZE)
    page.add_init_script(HEARD + PROBE)
    # The body's links and ten parts are drawn, each by a call of its own.
    found = _opened(page, url, lambda: page.wait_for_function("peer.calls > 40", timeout=PATIENCE))
    found |= _counted(page, "peer.drawn", seconds)
    found |= _verified(page, "peer.drawn", seconds)
    page.close()
    return found


def _opened(page: Any, url: str, wait: Callable[[], Any]) -> dict[str, float]:
    """Seconds until a page shows all, and CPU time of Chromium and of this process meanwhile."""
    started, browser, own = time.perf_counter(), browser_seconds(os.getpid()), time.process_time()
    page.goto(url)
    wait()
    found = {
        "complete_s": time.perf_counter() - started,
        "complete_chromium_cpu_s": browser_seconds(os.getpid()) - browser,
        "complete_server_cpu_s": time.process_time() - own,
    }
    page.wait_for_timeout(1000)
    return found


def _counted(page: Any, counter: str, seconds: float) -> dict[str, float]:
    """Updates a second, and Chromium's CPU time for one."""
    cpu, (began, before) = browser_seconds(os.getpid()), _now(page, counter)
    page.wait_for_timeout(1000 * seconds)
    (ended, after), spent = _now(page, counter), browser_seconds(os.getpid()) - cpu
    return {
        "drawn_per_s": 1e3 * (after - before) / (ended - began),
        "chromium_cpu_ms_per_update": 1e3 * spent / max(after - before, 1),
    }


def _verified(page: Any, counter: str, seconds: float) -> dict[str, float]:
    """Pictures that differ from the one before, for each update of the same seconds."""
    page.evaluate("startProbe()")
    before, (_, drawn) = page.evaluate("[probe.frames, probe.pictures]"), _now(page, counter)
    page.wait_for_timeout(1000 * seconds)
    after, (_, all_drawn) = page.evaluate("[probe.frames, probe.pictures]"), _now(page, counter)
    frames, pictures = (b - a for a, b in zip(before, after, strict=True))
    return {
        "frames_looked_at": frames,
        "pictures_seen": pictures,
        "updates_meanwhile": all_drawn - drawn,
        "pictures_per_update": pictures / max(all_drawn - drawn, 1),
    }


def _now(page: Any, counter: str) -> tuple[float, float]:
    """The page's clock [ms] and a counter of it."""
    ms, count = page.evaluate(f"[performance.now(), {counter}]")
    return ms, count


def browser_seconds(root: int) -> float:
    """CPU time of all that a process started [s]."""
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
