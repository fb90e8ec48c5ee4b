"""The task `classify`: naming simulated touches, by classifier and what it looks at.

The task `flatten`: surface mesh and flat map of the parts, by meshing and method.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from skinmap.errors import InvalidArrayError
from skinmap.flat.flat_map import DEFAULT as DEFAULT_METHOD
from skinmap.flat.flat_map import FlatMap, flatten
from skinmap.profile import Value
from skinmap.recognition.classifier import DEFAULT, TouchClassifier, learnable
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.evaluate import likeliest, score
from skinmap.recognition.training import tuned_classifier
from skinmap.surface.surface_mesh import DEFAULT as DEFAULT_MESHING
from skinmap.surface.surface_mesh import MESHING, build_surface
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.simulator import simulate
from skinmap.trade.measuring import Knob, Outcome, Setting, cpu_seconds

if TYPE_CHECKING:
    from skinmap.geometry.triangles import TriangleMesh
    from skinmap.skin.robot import Robot
    from skinmap.skin.skin import Skin

    Piece = tuple[Skin, TriangleMesh | None]  # a part and, where there is one, its link's mesh

LEARNT = 12  # touches of each gesture that are trained on, and
TESTED = 30  # that are named
TIMED = 32  # of those that are named, so many again for the time
HISTOGRAM = "histogram"
QUICK = (DEFAULT, HISTOGRAM, "paper", "histogram-chi2")
ONE_SKIN = ("raw-intersection",)  # knows taxels by their number
# Knobs of histograms, each varied alone.
VARIED: dict[str, tuple[Value, ...]] = {
    "radius_mm": (6.0, 11.0),
    "words": (4, 16),
    "rotations": (1,),
    "distance": ("geodesic",),
}
SIZES = ("33x50", "66x100")


@dataclass(frozen=True, eq=False, slots=True)
class Touches:
    """Simulated touches of one repetition."""

    learnt: tuple[Touch, ...]
    tested: tuple[Touch, ...]
    several: bool


class ClassifyTask:
    """Naming simulated touches."""

    name = "classify"
    unit = "%"
    work = "naming one touch"
    truth = "simulated touches named wrong, on touches (of several parts: on a part) held out"
    knobs: tuple[Knob, ...] = (
        Knob(
            "classifier", (*QUICK, *ONE_SKIN, "bovw", "cnn"), DEFAULT, "the classifier of a touch"
        ),
        Knob("radius_mm", (6.0, 8.0, 11.0), 8.0, "of a neighbourhood whose shape is a structure"),
        Knob("words", (4, 8, 16), 8, "codewords of a structure"),
        Knob("rotations", (1, 6), 6, "turns that leave a structure the same"),
        Knob("distance", ("euclidean", "geodesic"), "euclidean", "how the radius is measured"),
        Knob("image_size", SIZES, "66x100", "pixels of a contact image"),
    )

    def settings(self) -> Sequence[Setting]:
        """Every classifier that can run here; the knobs of histograms and images one by one."""
        found: list[Setting] = [{"classifier": name} for name in (*QUICK, *ONE_SKIN)]
        for knob, values in VARIED.items():
            found += [{"classifier": HISTOGRAM, knob: value} for value in values]
        if find_spec("mahotas"):
            found += [{"classifier": "bovw", "image_size": size} for size in SIZES]
        if find_spec("torch"):  # the paper's network trains for minutes: `evaluate` has it
            found.append({"classifier": "cnn"})
        return found

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Touches:
        """Touches to learn from and others to name, on skins that are meshed and flattened.

        On one part they are other touches of it; of several parts one is never learnt from,
        another one for another seed.
        """
        held_out = parts[seed % len(parts)]
        learnt: list[Touch] = []
        tested: list[Touch] = []
        for number, name in enumerate(parts):
            skin = PreparedSkin(robot.skin(name))
            rng = np.random.default_rng([seed, number])
            if name != held_out or len(parts) == 1:
                learnt += simulated(skin, LEARNT, rng)
            if name == held_out:
                tested += simulated(skin, TESTED, rng)
        return Touches(tuple(learnt), tuple(tested), len(parts) > 1)

    def run(self, prepared: Touches, setting: Setting, *, seed: int) -> Outcome:
        """Train, name every held-out touch once, and some again for the time."""
        knobs = dict(setting)
        name = str(knobs.pop("classifier", DEFAULT))
        model = tuned_classifier(name, knobs)
        if prepared.several and getattr(model.descriptor, "one_skin", False):
            raise InvalidArrayError(f"{name!r} learns the taxels of one part: needs one --part")
        started = time.process_time()
        model.fit(learnable(prepared.learnt), rng=np.random.default_rng(seed))
        training = time.process_time() - started
        wrong = 1.0 - score(model, prepared.tested).accuracy
        seconds = touch_seconds(model, prepared.tested)
        return Outcome(seconds, 100.0 * wrong, beside={"training_seconds": training})


def simulated(skin: PreparedSkin, per_gesture: int, rng: np.random.Generator) -> list[Touch]:
    """Touches of the four gestures on a skin, each with its label."""
    recording = simulate(skin.skin, rng=rng, per_gesture=per_gesture, gestures=FOUR)
    return recorded_touches(skin, recording)


def touch_seconds(model: TouchClassifier, touches: Sequence[Touch]) -> float:
    """CPU time of naming one touch, what was measured on touches before forgotten."""
    rows = np.linspace(0, len(touches) - 1, min(TIMED, len(touches))).astype(np.int64)

    def work() -> None:
        for row in rows:
            old = touches[row]
            likeliest(model, replace(old))

    seconds, _ = cpu_seconds(work)
    return seconds / len(rows)


classify_task = ClassifyTask()


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
        Knob("method", METHODS, DEFAULT_METHOD, "how the surface mesh is laid flat"),
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
    given = setting.get("iterations", "own")
    iterations = None if given == "own" else int(given)
    return flatten(mesh, method=str(setting.get("method", DEFAULT_METHOD)), iterations=iterations)


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
