"""Laws of classifiers, the simulator and the viewer's colours."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.recognition.check import planted_touches
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.histograms.intersection import IntersectionSVC, intersection_kernel
from skinmap.touch.simulation.simulator import simulate
from viewer.layers import Layers, check_values

from .law import Law, Outside
from .shapes import bent_skin, prepared, press


def pressures(**at: float) -> np.ndarray:
    """A press with some taxels set to other values."""
    values = press()
    for row, value in at.items():
        values[int(row[1:])] = value
    return values


@cache
def counts() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    low, high = rng.poisson([9, 1, 5, 2], (40, 4)), rng.poisson([2, 6, 1, 5], (40, 4))
    return np.concatenate([low, high]).astype(float), np.repeat([0, 1], 40)


def kernel_off(scale: float) -> float:
    """Against sums of the smaller bins, written out."""
    X = counts()[0]
    slow = np.minimum(X[:, None], X[None]).sum(axis=2)
    return float(np.abs(intersection_kernel(scale * X, scale * X) / scale - slow).max())


def labels_change(scale: float) -> float:
    X, y = counts()
    one, other = IntersectionSVC().fit(X, y), IntersectionSVC().fit(scale * X, y)
    return float((one.predict(X) != other.predict(scale * X)).mean())


@cache
def trained(name: str) -> Any:
    rng = np.random.default_rng(0)
    return classifiers.get(name)().fit(planted_touches(12, rng=rng), rng=rng)


def misnamed(name: str, change: Any) -> float:
    """Share of planted touches that get another name."""
    rng = np.random.default_rng(1)
    tested = [
        replace(one, samples=change(one.samples, rng)) for one in planted_touches(12, rng=rng)
    ]
    return float(np.mean([trained(name).predict(one).label != one.label for one in tested]))


def noisy(sd: float) -> Any:
    return lambda x, rng: np.clip(x + rng.normal(0, sd, x.shape), 0, 255).astype(np.uint8)


def dead(share: float) -> Any:
    return lambda x, rng: np.where(rng.random(x.shape[1]) < share, 0, x).astype(np.uint8)


def unplugged(modules: float) -> Any:
    """So many boards of seven taxels that read nothing, anywhere on the planted lattice."""
    row, column = np.divmod(np.arange(120), 12)
    places = np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)])

    def change(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        middles = places[rng.choice(120, int(modules), replace=False)]
        away = np.linalg.norm(places[:, None] - middles[None], axis=2)
        return np.where((away < 1.1).any(axis=1), 0, x).astype(np.uint8)

    return change


def gained(gain: float) -> Any:
    return lambda x, rng: np.clip(gain * x.astype(float), 0, 255).astype(np.uint8)


def simulated(n: int) -> float:
    """Samples out of the range of counts, and events without a label."""
    found = simulate(bent_skin(n, n), rng=np.random.default_rng(0), per_gesture=1)
    return float(found.events.max(initial=-1) + 1 - len(found.labels))


@cache
def layers() -> Layers:
    return Layers({"bent": prepared()})


def coloured(value: float) -> float:
    """Taxels of one value that are not all of one colour of the table, or of "nothing known"."""
    colours = layers().get("pressure").colours(np.full(144, value))
    return float(len(np.unique(colours, axis=0)) - 1)


def untouched(change: Any) -> float:
    """Colours that change where another taxel's value is wild."""
    values = pressures()
    wild = values.copy()
    wild[3] = change
    one, other = (layers().get("pressure").colours(v) for v in (values, wild))
    return float((np.delete(one, 3, axis=0) != np.delete(other, 3, axis=0)).sum())


CLASSIFY = [
    Law(
        "intersection_kernel",
        "scale",
        "sums of the smaller bins",
        kernel_off,
        1e-9,
        "rounding",
        (1e-30, 1.0, 1e6, 1e30),
    ),
    Law(
        "IntersectionSVC",
        "scale",
        "the same labels",
        labels_change,
        0.0,
        "counted",
        (2.0**-20, 1.0, 2.0**20),
        (
            Outside(
                "a negative count",
                InvalidArrayError,
                lambda: IntersectionSVC().fit(-counts()[0], counts()[1]),
            ),
            Outside(
                "one class",
                "ValueError",
                lambda: IntersectionSVC().fit(counts()[0], 0 * counts()[1]),
            ),
        ),
    ),
    *(
        Law(
            f"classifier {name}",
            axis,
            "share of planted touches misnamed",
            lambda v, name=name, make=make: misnamed(name, make(v)),
            0.1,
            "two of 24 at most",
            inside,
            outside,
            unit,
        )
        for name in ("contact-geometry", "histogram", "paper", "raw-rbf", "bovw")
        for axis, make, inside, outside, unit in (
            ("noise", noisy, (0.0, 2.0, 4.0), (), "counts"),
            ("dead taxels", dead, (0.0, 0.02, 0.05), (), "of the taxels"),
            ("missing modules", unplugged, (0, 1, 3), (), "of seven taxels of 120"),
            (
                "saturation",
                gained,
                (0.9, 1.0, 1.2),
                (
                    Outside(
                        "4 touches a label",
                        InvalidArrayError,
                        lambda name=name: classifiers.get(name)().fit(
                            planted_touches(4, rng=np.random.default_rng(0)),
                            rng=np.random.default_rng(0),
                        ),
                        "5 touches",
                    ),
                ),
                "times the gain",
            ),
        )
    ),
    Law(
        "simulate",
        "size",
        "each event has its label",
        simulated,
        0.0,
        "counted",
        (2, 4, 12, 20),
        unit="rows and columns",
    ),
]

VIEWER = [
    Law(
        "Layer.colours",
        "scale",
        "one value, one colour",
        coloured,
        0.0,
        "counted",
        (-1e300, 0.0, 1e-300, 255.0, 1e300),
    ),
    Law(
        "Layer.colours",
        "input",
        "a wild value changes its own taxel only",
        lambda name: untouched(float(name)),
        0.0,
        "counted",
        ("nan", "inf", "-inf"),
    ),
    Law(
        "check_values",
        "size",
        "as many values as taxels are taken",
        lambda n: float(len(check_values(np.zeros(n), n, "p")) - n),
        0.0,
        "counted",
        (0, 1, 100000),
        (
            Outside("one too few", SkinMismatchError, lambda: check_values(np.zeros(3), 4, "p")),
            Outside(
                "infinity",
                "shown as unknown",
                lambda: (
                    "shown as unknown" if np.isnan(check_values([np.inf], 1, "p")).all() else "kept"
                ),
            ),
        ),
        unit="taxels",
    ),
]
