"""The trade task `calibrate`: one patch laid on its link, by starts, steps and detail of the wrap.

The truth is planted: the taxels of the user's own part. The board is the flat map of a patch, of
at most `MAX_MODULES` neighbouring modules as boards are sold; anchors are its taxels with noise
of a known spread. So the errors are simulated, and those of a real board also hold what its
layout and its cover add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.patch.solver_budget import DETAIL, STARTS, STEPS, Effort
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidMeshError
from skinmap.trade.measuring import cpu_seconds
from skinmap.trade.task import Knob, Outcome, Setting, around, defaults

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

MAX_MODULES = 16
PATCHES = 2  # of the parts: more only cost time, the seeds vary the anchors
ANCHORS, NOISE = 5, 1e-3  # how many, and standard deviation of each coordinate [m]
FEWEST = 12  # taxels that make a patch
MM = 1e3


@dataclass(frozen=True, eq=False, slots=True)
class Planted:
    """A board whose places are known, and anchors as they would be measured.

    Attributes
    ----------
    layout : (n, 2) float
        [m].
    truth : (n, 3) float
        [m].
    vertices, faces : (v, 3) float, (f, 3) int
        Of the link's mesh [m].
    taxels, points : (k,) int, (k, 3) float
        Anchors [m].
    """

    layout: FloatArray
    truth: FloatArray
    vertices: FloatArray
    faces: IntArray
    taxels: IntArray
    points: FloatArray


class CalibrateTask:
    """Patches of the parts, calibrated by a few anchors."""

    name = "calibrate"
    unit = "mm"
    work = f"the largest patch by {ANCHORS} anchors, its link wrapped before"
    truth = "planted places of the part's taxels (simulated): median error, anchors off by 1 mm"
    knobs = (
        Knob("starts", (1, STARTS), STARTS, "places that the patch is laid from"),
        Knob("steps", (3, 6, STEPS), STEPS, "steps in each stage, at most"),
        Knob(
            "wrap_detail_mm",
            (MM * DETAIL, 8.0),
            MM * DETAIL,
            "longest edge of the wrap round the link",
        ),
    )

    def settings(self) -> Sequence[Setting]:
        """Each knob alone, and all of them quick."""
        base = defaults(self.knobs)
        quick = {"starts": 1, "steps": 6, "wrap_detail_mm": 8.0}
        return [*around(self.knobs), {**base, "starts": 1, "steps": 6}, quick]

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> list[Planted]:
        """The largest patches of the parts, with anchors drawn by the seed."""
        rng = np.random.default_rng([seed, 5])
        found = sorted(_patches(robot, parts), key=lambda one: -len(one.layout))[:PATCHES]
        if not found:
            raise InvalidMeshError(f"no patch of {FEWEST} taxels on {', '.join(parts)}")
        return [_with_anchors(one, rng) for one in found]

    def run(self, prepared: list[Planted], setting: Setting, *, seed: int) -> Outcome:
        """Calibrate the patches; seconds of the largest, and the median error of all taxels."""
        from calibration.patch.link_surface import make_target
        from calibration.patch.wrap import wrap_layout

        used = {**defaults(self.knobs), **setting}
        detail = float(used["wrap_detail_mm"]) / MM
        effort = Effort(int(used["starts"]), int(used["steps"]), detail)
        seconds, errors = 0.0, []
        for row, one in enumerate(prepared):
            # Kept between runs, so it is no part of what a patch costs.
            make_target(one.vertices, one.faces, detail=detail)

            def work(one: Planted = one) -> FloatArray:
                return wrap_layout(
                    one.layout, one.vertices, one.faces, one.taxels, one.points,
                    anchor_sigma=NOISE, effort=effort, rng=np.random.default_rng(seed),
                ).positions  # fmt: skip

            if row == 0:
                seconds, places = cpu_seconds(work)
            else:
                places = work()
            errors.append(np.linalg.norm(places - one.truth, axis=1))
        away = MM * np.concatenate(errors)
        beside = {"worst_mm": float(away.max()), "p95_mm": float(np.percentile(away, 95))}
        return Outcome(seconds, float(np.median(away)), beside=beside)


def _patches(robot: Robot, parts: tuple[str, ...]) -> list[Planted]:
    """A board of each patch, without anchors yet."""
    from skinmap.flat.flat_map import flatten
    from skinmap.surface.surface_mesh import build_surface

    found = []
    nothing = np.zeros(0, np.int64), np.zeros((0, 3))
    for part in parts:
        skin = robot.skin(part)
        if not skin.link:
            continue
        link = robot.mesh(skin.link)
        for chart in flatten(build_surface(skin)).charts:
            keep = _together(skin.modules[chart.taxels], chart.uv)
            taxels = chart.taxels[keep]
            if len(taxels) >= FEWEST:
                truth = skin.positions[taxels]
                found.append(Planted(chart.uv[keep], truth, link.vertices, link.faces, *nothing))
    return found


def _together(modules: IntArray, uv: FloatArray) -> IntArray:
    """Taxels of the modules (n,) that lie nearest to the middle of a board (n, 2) [m]."""
    names = np.unique(modules)
    middle = np.array([uv[modules == name].mean(axis=0) for name in names])
    order = np.argsort(np.linalg.norm(middle - np.median(uv, axis=0), axis=1), kind="stable")
    return np.flatnonzero(np.isin(modules, names[order[:MAX_MODULES]]))


def _with_anchors(one: Planted, rng: np.random.Generator) -> Planted:
    """Anchors far apart: the first by chance, each other the furthest from those before."""
    start = one.layout[rng.integers(len(one.layout))]
    chosen = [int(np.argmax(np.linalg.norm(one.layout - start, axis=1)))]
    while len(chosen) < ANCHORS:
        gap = np.linalg.norm(one.layout[:, None] - one.layout[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(gap)))
    taxels = np.array(chosen)
    points = one.truth[taxels] + rng.normal(0.0, NOISE, (ANCHORS, 3))
    return Planted(one.layout, one.truth, one.vertices, one.faces, taxels, points)


calibrate_task = CalibrateTask()
