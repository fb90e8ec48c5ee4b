"""The task `flatten`: surface mesh and flat map of the parts, by meshing and method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from skinmap.flat.flat_map import DEFAULT, FlatMap, flatten
from skinmap.surface.surface_mesh import DEFAULT as DEFAULT_MESHING
from skinmap.surface.surface_mesh import MESHING, build_surface
from skinmap.trade.measuring import cpu_seconds
from skinmap.trade.task import Knob, Outcome, Setting

if TYPE_CHECKING:
    from skinmap.geometry.triangles import TriangleMesh
    from skinmap.skin.robot import Robot
    from skinmap.skin.skin import Skin

    Piece = tuple[Skin, TriangleMesh | None]  # a part and, where there is one, its link's mesh

METHODS = ("lscm", "fast", "balanced", "slim", "dirichlet")
# Beside what the methods take by themselves: 5, 5 and at most 200.
ITERATIONS = {"balanced": (1, 20), "slim": (1,), "dirichlet": (5,)}
# Maps on the other kinds of mesh: a few show what those bring.
ON_OTHERS = ("fast", "balanced", "dirichlet")


class FlattenTask:
    """Surface mesh and flat map of the parts."""

    name = "flatten"
    unit = "%"
    work = "surface mesh and flat map of the parts"
    truth = "lengths on the skin: rms strain of the edges, weighted by length"
    knobs: tuple[Knob, ...] = (
        Knob("meshing", MESHING, DEFAULT_MESHING, "how taxels become a surface mesh"),
        Knob("method", METHODS, DEFAULT, "how the surface mesh is laid flat"),
        Knob("iterations", ("own", 1, 5, 20), "own", "of balanced, slim, dirichlet"),
    )

    def settings(self) -> Sequence[Setting]:
        """Each method on the default mesh, a few on the others; the other knobs one by one."""
        found: list[Setting] = [
            {"meshing": meshing, "method": method}
            for meshing in MESHING
            for method in (METHODS if meshing == DEFAULT_MESHING else ON_OTHERS)
        ]
        mesh = {"meshing": DEFAULT_MESHING}
        for method, numbers in ITERATIONS.items():
            found += [{**mesh, "method": method, "iterations": n} for n in numbers]
        return found

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> list[Piece]:
        """Skins and meshes of their links; nothing is drawn by chance."""
        pieces: list[Piece] = []
        for name in parts:
            link = robot.part(name).link
            pieces.append((robot.skin(name), robot.mesh(link) if link else None))
        return pieces

    def run(self, prepared: list[Piece], setting: Setting, *, seed: int) -> Outcome:
        """Mesh and flatten all parts, timed together."""

        def work() -> list[FlatMap]:
            return [_map(piece, setting) for piece in prepared]

        seconds, maps = cpu_seconds(work)
        return Outcome(seconds, 100.0 * edge_rms(maps), beside={"unmeshed": unmeshed(maps)})


def _map(piece: Piece, setting: Setting) -> FlatMap:
    meshing = str(setting.get("meshing", DEFAULT_MESHING))
    skin, body = piece
    mesh = build_surface(skin, method=meshing, body=body if meshing == "accurate" else None)
    iterations = setting.get("iterations", "own")
    return flatten(
        mesh,
        method=str(setting.get("method", DEFAULT)),
        iterations=None if iterations == "own" else int(iterations),
    )


def edge_rms(maps: Sequence[FlatMap]) -> float:
    """Root mean square of the strain of all edges of some maps, weighted by length."""
    charts = [chart.distortion for flat in maps for chart in flat.charts]
    strain = np.concatenate([one.edge_strain for one in charts])
    length = np.concatenate([one.edge_lengths for one in charts])
    return float(np.sqrt(np.average(strain**2, weights=length)))


def unmeshed(maps: Sequence[FlatMap]) -> int:
    """Taxels that no triangle uses."""
    return sum(int((flat.mesh.taxel_patches < 0).sum()) for flat in maps)


flatten_task = FlattenTask()
