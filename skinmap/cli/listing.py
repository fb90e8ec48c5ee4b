"""`skinmap list`: the names that other commands take."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
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
ABOUT: dict[str, str] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)


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
