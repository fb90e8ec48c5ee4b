"""Laws of calibrations."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from calibration import wrap_layout
from calibration.patch.placing import Touch, locate_by_touch
from calibration.response import ResponseCalibration
from calibration.scan.registration import _check_scan
from skinmap.errors import InvalidArrayError, SkinMismatchError

from .law import Law, Outside
from .shapes import PITCH, lattice

RADIUS = 45e-3


def rest(sd: float = 1.2, taxels: int = 40, samples: int = 500) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.rint(60 + rng.normal(0, sd, (samples, taxels)))


def baseline_off(sd: float) -> float:
    """Error of the baselines [counts]."""
    return float(np.abs(ResponseCalibration.fit(rest(sd)).baseline - 60).max())


def unnamed(share: float) -> float:
    """Taxels at the end of the range that are not called saturated, and others that are."""
    samples = rest()
    full = np.arange(40) < share * 40
    samples[:, full] = 255.0
    return float(((ResponseCalibration.fit(samples).health == "saturated") != full).sum())


def stuck(share: float) -> float:
    samples = rest()
    still = np.arange(40) < share * 40
    samples[:, still] = 77.0
    return float(((ResponseCalibration.fit(samples).health == "stuck") != still).sum())


def fitted(samples: np.ndarray) -> ResponseCalibration:
    return ResponseCalibration.fit(samples)


@cache
def link() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Layout, its places on a cylinder, and the cylinder 0.3 mm below."""
    import trimesh

    row, column = np.divmod(np.arange(72), 8)
    layout = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)])
    layout -= layout.mean(axis=0)
    angle = layout[:, 0] / RADIUS
    places = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), layout[:, 1]])
    body = trimesh.creation.cylinder(radius=RADIUS - 0.3e-3, height=0.14, sections=96)
    return layout, places, np.asarray(body.vertices, float), np.asarray(body.faces, np.int64)


ANCHORS = np.array([0, 7, 64, 71, 35, 39])


def wrapped(sigma: float = 0.1e-3, offset: float = 0.0, count: int = 6, scale: float = 1.0) -> Any:
    layout, places, vertices, faces = link()
    points = places[ANCHORS[:count]] + np.random.default_rng(2).normal(0, sigma, (count, 3))
    return wrap_layout(layout, scale * vertices + offset, faces, ANCHORS[:count],
                       scale * points + offset, anchor_sigma=sigma,
                       rng=np.random.default_rng(5))  # fmt: skip


def wrap_off(found: Any, offset: float = 0.0) -> float:
    """Median error of the taxels [mm]."""
    return float(1e3 * np.median(np.linalg.norm(found.positions - offset - link()[1], axis=1)))


def felt(count: int, dead: float = 0.0) -> list[Touch]:
    layout, _, _, _ = link()
    rng, touches = np.random.default_rng(20), []
    alive = rng.random(len(layout)) >= dead
    while len(touches) < count:
        place = rng.uniform(layout.min(axis=0), layout.max(axis=0))
        value = alive * np.exp(-np.sum((layout - place) ** 2, axis=1) / (2 * 4e-3**2))
        rows = np.flatnonzero(value > 0.08)
        if len(rows):
            angle = place[0] / RADIUS
            point = np.array([RADIUS * np.cos(angle), RADIUS * np.sin(angle), place[1]])
            touches.append(Touch(point + rng.normal(0, 1e-3, 3), 1e-3, rows, value[rows]))
    return touches


def located(count: int, dead: float = 0.0) -> Any:
    layout, _, vertices, faces = link()
    return locate_by_touch(layout, vertices, faces, felt(count, dead), rng=np.random.default_rng(1))


def scanned(scale: float) -> float:
    _check_scan(scale * lattice()[:100], lattice())
    return 0.0


def few_points() -> object:
    return _check_scan(lattice()[:99], lattice())


LAWS = [
    Law(
        "ResponseCalibration.fit",
        "noise",
        "error of baselines in counts",
        baseline_off,
        3.0,
        "a median's error, 1.25 sd / sqrt(500), 3.6 of them, in whole counts",
        (0.0, 1.2, 5.0, 15.0),
        (
            Outside("49 samples", InvalidArrayError, lambda: fitted(rest(samples=49)), "at least"),
            Outside("NaN", InvalidArrayError, lambda: fitted(rest() * np.nan)),
        ),
        "counts",
    ),
    Law(
        "ResponseCalibration.fit",
        "saturation",
        "taxels called saturated wrongly or not",
        unnamed,
        0.0,
        "counted",
        (0.0, 0.1, 0.5, 1.0),
        unit="of the taxels",
    ),
    Law(
        "ResponseCalibration.fit",
        "dead taxels",
        "taxels called stuck wrongly or not",
        stuck,
        0.0,
        "counted",
        (0.0, 0.1, 0.4),
        (
            Outside(
                "all",
                "none called stuck",
                lambda: (
                    "none called stuck"
                    if not (fitted(np.full((500, 8), 77.0)).health == "stuck").any()
                    else "stuck"
                ),
            ),
        ),
        "of the taxels",
    ),
    Law(
        "ResponseCalibration.apply",
        "size",
        "untouched is 0",
        lambda n: float(fitted(rest(taxels=n)).apply(np.full((3, n), 60.0)).sum()),
        0.0,
        "below the threshold",
        (1, 12, 4000),
        (
            Outside(
                "another number", SkinMismatchError, lambda: fitted(rest()).apply(np.zeros((3, 39)))
            ),
        ),
        "taxels",
    ),
    Law(
        "wrap_layout",
        "noise",
        "median error in mm",
        lambda s: wrap_off(wrapped(1e-3 * s)),
        3.0,
        "six anchors of 3 mm leave their own noise",
        (0.1, 1.0, 3.0),
        (
            Outside("2 anchors", InvalidArrayError, lambda: wrapped(count=2)),
            Outside("a mesh in mm", InvalidArrayError, lambda: wrapped(scale=1e3)),
        ),
        "mm of anchors",
    ),
    Law(
        "wrap_layout",
        "offset",
        "median error in mm",
        lambda s: wrap_off(wrapped(offset=s), s),
        0.3,
        "facets of the link",
        (0.0, 1.0, 100.0),
        unit="m",
    ),
    Law(
        "locate_by_touch",
        "size",
        "median error in mm",
        lambda n: wrap_off(located(n)),
        2.0,
        "touches of 1 mm",
        (16, 48),
        (Outside("2 touches", InvalidArrayError, lambda: located(2)),),
        "touches",
    ),
    Law(
        "locate_by_touch",
        "dead taxels",
        "median error in mm",
        lambda s: wrap_off(located(32, s)),
        2.0,
        "touches of 1 mm",
        (0.0, 0.2),
        unit="of the taxels",
    ),
    Law(
        "register_scan",
        "scale",
        "a scan of this size is begun with",
        scanned,
        0.0,
        "yes or no",
        (0.5, 1.0),
        (
            Outside("1000 (mm)", InvalidArrayError, lambda: scanned(1e3), "is the scan in"),
            Outside("1e6", InvalidArrayError, lambda: scanned(1e6), "another link"),
        ),
        "of the mesh",
    ),
    Law(
        "register_scan",
        "noise",
        "planted poses come back (tests/calibration, where Open3D is installed)",
        abs,
        0.0,
        "",
        (),
        (Outside("99 points", InvalidArrayError, few_points, "at least 100"),),
    ),
]
