"""Many updates of one scene: what memory grows by, and how old is what is shown."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

PERIOD = 1.0 / 50.0  # of the samples [s]
WARM = 2_000  # updates until caches are filled
SIZE = (320, 240)


def moments(skins: dict[str, Any], seed: int = 0) -> Iterator[Any]:
    """Touches that wander over the parts, appear and go, without end."""
    from skinmap.live.moment import Moment
    from skinmap.live.touches import NamedTouch

    rng = np.random.default_rng(seed)
    number, parts = 0, list(skins)
    while True:
        part = parts[number // 60 % len(parts)]
        skin = skins[part]
        taxel = int(rng.integers(len(skin)))
        distance = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
        load = 200.0 * np.clip(1.0 - (distance / 0.02) ** 2, 0.0, None)
        pressures = {name: np.zeros(len(one)) for name, one in skins.items()}
        pressures[part] = load
        touched = np.flatnonzero(load > 12.0)
        touches = (NamedTouch(part, touched, skin.positions[taxel], "poke", 0.9),)
        yield Moment(number * PERIOD, pressures, touches if number % 60 < 50 else ())
        number += 1


def memory_mb() -> float:
    """Memory of this process that is in use now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def soak(
    scene: Any, updates: int, report: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Show so many updates, as fast as they can be drawn."""
    skins = {part: layer.skin for part, layer in scene.layers.items()}
    source = moments(skins)
    before, started = 0.0, time.process_time()
    warm = min(WARM, updates // 4)
    for number in range(updates):
        if number == warm:
            before = memory_mb()
        scene.show_moment(next(source))
        scene.refresh()
        if number % 20_000 == 0:
            report(f"{number:,} updates, {memory_mb():.1f} MB")
    return {
        "updates": updates,
        "cpu_ms_per_update": (time.process_time() - started) / updates * 1e3,
        "grown_mb": memory_mb() - before,
    }


def ages(scene: Any, seconds: float = 6.0, turn: float = 0.0) -> dict[str, float]:
    """Age of what is shown when a source sends at 50 Hz: newest sample drawn, others left out.

    The camera turns by `turn` [deg] with each picture.
    """
    skins = {part: layer.skin for part, layer in scene.layers.items()}
    source = moments(skins, seed=1)
    scene.show_moment(next(source))
    scene.refresh(360.0)
    scene.refresh()
    start, sent, shown = time.perf_counter(), 0, []
    while (now := time.perf_counter() - start) < seconds:
        due = int(now / PERIOD)
        if due <= sent:
            time.sleep((sent + 1) * PERIOD - now)
            continue
        sent = due
        scene.show_moment(next(source))
        if turn:
            scene.look(20.0 + turn * len(shown))
        scene.refresh()
        shown.append(time.perf_counter() - start - due * PERIOD)
    return {
        "drawn_per_s": len(shown) / seconds,
        "median_ms": median(shown) * 1e3,
        "worst_ms": max(shown) * 1e3,
    }


if __name__ == "__main__":
    import json
    import sys

    from viewer.scene import Scene

    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200_000
    shown = Scene.load("icub", ["torso"], links="skin", window_size=SIZE)
    print(json.dumps(soak(shown, count, lambda line: print(line, file=sys.stderr, flush=True))))
