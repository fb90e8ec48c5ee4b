"""`skinmap list`: the names that other commands take."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import click

from skinmap.commands.options import open_robot, prints, robot_argument
from skinmap.errors import UnknownNameError
from skinmap.registry import Registry
from skinmap.report.present import present
from skinmap.summary import listed

GROUP = "skinmap.listings"  # names that packages above the core have: layers of the viewer


@dataclass(frozen=True, kw_only=True, slots=True)
class Listing:
    """Names of one kind.

    Attributes
    ----------
    kind
        Kind of the listed names.
    names
        All there are, those of plug-ins too.
    about
        A line on each; empty of a plug-in's.
    """

    kind: str
    names: list[str]
    about: list[str]


# A line on each name of the core; of robots and parts it is made.
ABOUT = {
    "contact-geometry": "lengths, areas and counts of contacts, RBF machine (the default)",
    "histogram": "histograms of structures, as in the first paper, made to carry over",
    "paper": "the first paper to the letter",
    "raw-rbf": "bare values of one part, RBF machine (for comparison)",
    "raw-intersection": "bare values of one part, intersection kernel (for comparison)",
    "histogram-chi2": "histograms, additive chi2 map",
    "histogram-sqrt": "histograms, square roots",
    "bovw": "bags of visual words on contact images, as in the second paper",
    "cnn": "a network on contact images, as in the second paper",
    "tutte": "each vertex in the middle of its neighbours",
    "harmonic": "least Dirichlet energy; may flip",
    "lscm": "conformal, least squares",
    "bff": "conformal, the border keeps its lengths",
    "arap": "as rigid as possible",
    "slim": "least symmetric Dirichlet energy, by libigl",
    "dirichlet": "least symmetric Dirichlet energy from the best start",
    "bijective": "no two places of the skin on one place of the map",
    "fast": "bff",
    "balanced": "arap (the default)",
    "accurate": "least symmetric Dirichlet energy, by size of the patch",
    "auto": "chosen within a budget of time or error",
    "poke": "one fingertip",
    "full_finger": "a finger lying flat",
    "three_finger": "three fingertips",
    "whole_hand": "a palm with its fingers",
    "elbow": "a person's elbow",
    "forearm": "a person's forearm",
    "ball": "a soft ball",
    "edge": "the edge of a hand",
    "cylinder": "a round bar, lying",
    "several_fingers": "two, four or five fingertips",
    "grasp": "three or four fingers and the thumb against them",
    "hard_ball": "a hard ball",
    "rod": "a thin bar, lying",
    "ring": "the rim of a cup",
    "corner": "a corner",
    "table_edge": "the edge of a table",
    "plate": "a flat plate",
    "gripper": "two jaws of a gripper",
    "link": "another link of a robot",
    "shoulder": "a person's shoulder",
    "stroke": "a hand that moves one way",
    "pat": "a flat hand, again and again",
    "tap": "a fingertip, again and again",
    "rub": "to and fro",
    "slide": "a contact pushed along",
    "twist": "a contact that turns",
    "squeeze": "pressed harder and softer",
    "hold": "still for seconds",
    "four": "a set: those of the first paper (the default)",
    "eight": "a set: those of both papers",
    "all": "a set: eight and cylinder",
    "hand": "a set: by a hand",
    "other": "a set: by anything else",
    "time": "a set: those in time, stroke to hold",
    "sim": "simulated touches; sim:GESTURE, sim:raw",
    "lsl": "a stream of LabStreamingLayer, lsl:NAME",
    "mujoco": "a robot with its skin in MuJoCo, mujoco:FILE",
    "zenoh": "zenoh:[PORT][/TOPIC]",
    "zmq": "zmq:PORT or zmq:HOST:PORT",
    "pressure": "counts, 0 at rest to 255",
    "raw": "values as the sensors send them",
    "binary": "touched or not",
    "structures": "neighbourhoods that repeat",
    "uncertainty": "error of calibrated places",
    "distortion": "strain of the flat map",
    "health": "stuck, noisy, dead or mute taxels",
    "patches": "connected pieces of skin",
    "touched": "how often each taxel was touched, in a recording",
    "changed": "changes of each taxel between check-ups",
    "difference": "right less left of two that stand side by side (--beside)",
}


def _robots(_: str) -> dict[str, str]:
    from skinmap.io.robots.manifest import builtin_robots, load_robot

    return {name: f"parts {listed(load_robot(name).parts)}" for name in builtin_robots()}


def _parts(robot: str) -> dict[str, str]:
    found, names = open_robot(robot, ())
    return {name: f"on link {found.part(name).link} of {found.name}" for name in names}


def _kinds(_: str) -> dict[str, str]:
    from skinmap.recognition.answering import shipped_answers

    return {name: ABOUT.get(name, "") for name in shipped_answers().machines["kind"].labels}


def _described(place: str) -> Callable[[str], dict[str, str]]:
    """Names at "module:attribute", a registry or a sequence of names, each with its line."""

    def names(_: str) -> dict[str, str]:
        found: Any = EntryPoint(place, place, GROUP).load()
        every = found.names() if isinstance(found, Registry) else found
        return {name: ABOUT.get(name, "") for name in every}

    return names


KINDS: dict[str, Callable[[str], dict[str, str]]] = {
    "robots": _robots,
    "parts": _parts,
    "classifiers": _described("skinmap.recognition.catalogue:classifiers"),
    "methods": _described("skinmap.flat.methods:flatteners"),
    "kinds": _kinds,
    "gestures": _described("skinmap.touch.simulation.hands:NAMES"),
    "sources": _described("skinmap.live.sources.open_source:sources"),
}


@click.command("list")
@click.argument("kind")
@robot_argument
@prints(Listing)
def command(kind: str, robot: str, as_json: bool) -> None:
    """List names that commands take, with a line on each.

    KIND is robots, parts (of ROBOT), classifiers, methods (of flattening), kinds (of touch that
    the shipped model names), gestures (of the simulator), sources or layers (of the viewer).

    \b
    Example:  skinmap list parts kaspar
    """
    present(work(kind, robot), _lines, as_json=as_json)


def work(kind: str, robot: str) -> Listing:
    """All names of a kind.

    Raises
    ------
    UnknownNameError
        A kind that nothing lists, or no such robot.
    """
    above = {point.name: point for point in entry_points(group=GROUP)}
    if kind not in KINDS and kind not in above:
        raise UnknownNameError("kind of names", kind, [*KINDS, *above])
    read = KINDS[kind] if kind in KINDS else _described(above[kind].value)
    found = read(robot)
    return Listing(kind=kind, names=list(found), about=list(found.values()))


def _lines(result: Listing) -> Iterator[str]:
    width = max(map(len, result.names), default=0)
    for name, line in zip(result.names, result.about, strict=True):
        yield f"{name:{width}}  {line}".rstrip()
