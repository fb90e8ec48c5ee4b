"""`skinmap list`: the names that other commands take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points

import click

from skinmap.commands.options import open_robot, prints, robot_argument
from skinmap.errors import UnknownNameError
from skinmap.report.present import present

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
    """

    kind: str
    names: list[str]


def _robots(_: str) -> tuple[str, ...]:
    from skinmap.io.robots.manifest import builtin_robots

    return builtin_robots()


def _classifiers(_: str) -> tuple[str, ...]:
    from skinmap.recognition.catalogue import classifiers

    return classifiers.names()


KINDS: dict[str, Callable[[str], tuple[str, ...]]] = {
    "robots": _robots,
    "parts": lambda robot: open_robot(robot, ())[0].parts,
    "classifiers": _classifiers,
}


@click.command("list")
@click.argument("kind")
@robot_argument
@prints(Listing)
def command(kind: str, robot: str, as_json: bool) -> None:
    """List the names of a KIND: robots, parts (of ROBOT), classifiers or layers.

    \b
    Example:  skinmap list parts kaspar
    """
    present(work(kind, robot), lambda result: result.names, as_json=as_json)


def work(kind: str, robot: str) -> Listing:
    """All names of a kind.

    Raises
    ------
    UnknownNameError
        A kind that nothing lists, or no such robot.
    """
    above = {point.name: point for point in entry_points(group=GROUP)}
    if kind in KINDS:
        return Listing(kind=kind, names=list(KINDS[kind](robot)))
    if kind in above:
        return Listing(kind=kind, names=list(above[kind].load()))
    raise UnknownNameError("kind of names", kind, [*KINDS, *above])
