"""`skinmap new`: a manifest for one's own robot, from its URDF or mesh and its taxel tables."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.commands.options import PATH, choice, out_file, prints, words
from skinmap.commands.overwriting import FORCE
from skinmap.errors import SkinError, check_known, warn
from skinmap.io.robots.new_manifest import (
    KNOWN_UNITS,
    NEAR,
    Candidate,
    candidates,
    in_question,
    mesh_units,
    part_names,
    robot_name,
    unclear,
    write_manifest,
)
from skinmap.io.text import UNITS, read_toml
from skinmap.report.present import emit, present, show
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot
    from skinmap.skin.taxels import TaxelTable

TABLES = "--taxels"
SHOWN = 40  # candidates of a table; the JSON has all


@dataclass(frozen=True, kw_only=True, slots=True)
class NewResult:
    """A manifest that was written.

    Attributes
    ----------
    robot
        Name of the robot, as its URDF or its mesh file has it.
    parts
        The unit and the link that were taken for each table.
    taxels
        Number of taxels of each part.
    files
        The manifest, and the copies beside it.
    """

    robot: str
    parts: list[Candidate]
    taxels: dict[str, int]
    files: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class NewQuestions:
    """Open questions about the files; nothing was written.

    Attributes
    ----------
    unclear
        Of each part with an open question: "units", "link" or both.
    candidates
        Units and links for these parts, the nearest of each part first.
    """

    unclear: dict[str, list[str]]
    candidates: list[Candidate]


class SeveralTables(click.Command):
    """All words after `--taxels` up to the next option are tables, as a shell gives `*.csv`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Give each table an option of its own."""
        words, inside, first = [], False, False
        for arg in args:
            if arg.startswith("-") and arg != "-":
                inside, first = arg.partition("=")[0] == TABLES, "=" not in arg
                words.append(arg)
            elif inside and not first:
                words += [TABLES, arg]
            else:
                words.append(arg)
                first = False
        return super().parse_args(ctx, words)


@click.command("new", cls=SeveralTables)
@click.argument("model", metavar="ROBOT.urdf|MESH", type=PATH)
@words(
    TABLES, "tables", "FILE [FILE...]", "Taxel tables, one for each part.", type=PATH, required=True
)
@choice(
    "--units",
    UNITS,
    "Unit of lengths in the tables.  [default: the one in which the skin lies on a link]",
)
@words(
    "--link",
    "links",
    "NAME",
    "Link that carries the skin; of several tables one for all, or one for each in their "
    "order.  [default: the one that the skin lies on]",
)
@out_file("Manifest to write (.toml).", required=True)
@prints(NewResult, NewQuestions)
def command(as_json: bool, **asked: Any) -> None:
    """Write a manifest for your own robot: its URDF or one mesh, and a taxel table for each part.

    The unit of the positions and the link of each table are found by laying the taxels on the
    meshes. A question that the files leave open is asked in a terminal; elsewhere the candidates
    are printed, and nothing is written. Files from other folders are copied beside the manifest.

    \b
    Example:  skinmap new robot.urdf --taxels forearm.csv -o robot.toml
              skinmap new arm.stl --taxels arm.csv -o robot.toml
              skinmap new robot.urdf --taxels *.csv --units mm --link forearm_link -o robot.toml
    """
    ctx = click.get_current_context()
    result = work(**asked, force=ctx.meta.get(FORCE, False))
    if isinstance(result, NewQuestions):
        emit(result) if as_json else show(_questions(result))
        raise click.UsageError(_open(result), ctx)
    present(result, _lines, as_json=as_json)


def work(
    model: Path,
    tables: Sequence[Path],
    units: str | None,
    links: Sequence[str],
    output: Path,
    force: bool,
) -> NewResult | NewQuestions:
    """Read the files, find units and links, ask where a terminal is there, and write."""
    from skinmap.io.robots.mesh_file import MESH_SUFFIXES
    from skinmap.io.robots.urdf import MeshBody, UrdfBody
    from skinmap.io.taxels.taxel_table import read_taxels
    from skinmap.skin.robot import Robot

    units = "in" if units == "inch" else units
    _check(model, tables, links, output)
    read = dict(zip(part_names(tables), map(read_taxels, tables), strict=True))
    scale = ""
    if model.suffix.lower() in MESH_SUFFIXES:
        fits = mesh_units(model, read, units)
        if len(fits) > 1 and not in_terminal():
            alike = [one for found in zip(*fits.values(), strict=True) for one in found]
            return NewQuestions(unclear={part: ["units"] for part in read}, candidates=alike)
        scale = _ask_mesh(fits)
        body: UrdfBody = MeshBody(model, scale=UNITS[scale])
    else:
        body = UrdfBody(model)
    check_known("link", links, body.links)
    robot = Robot(robot_name(body), body, {})
    given: list[str | None] = [*links] or [None]
    given *= len(tables) if len(given) == 1 else 1
    chosen, asked, open_ = [], [], {}
    for (part, table), carrier in zip(read.items(), given, strict=True):
        found, questions = _settle(part, table, robot, units, carrier)
        if questions:
            open_[part] = questions
            asked += found
        chosen.append(found[0])
    if open_:
        return NewQuestions(unclear=open_, candidates=asked)
    for one in chosen:
        _warn(one, read[one.part], robot, units)
    before = _parts_in(output)
    files = write_manifest(output, body, scale, dict(zip(tables, chosen, strict=True)), force=force)
    if not {one.part for one in chosen}.issuperset(before):
        count = f"{len(before)} part{'s'[: len(before) > 1]}"
        text = f"replaced {output} ({count} before: {', '.join(before)})"
        warn(text)
    return NewResult(
        robot=robot.name,
        parts=chosen,
        taxels={part: len(table) for part, table in read.items()},
        files=files,
    )


def _check(model: Path, files: Sequence[Path], links: Sequence[str], output: Path) -> None:
    """Refuse what is another kind of file, before anything is read."""
    if output.suffix.lower() != ".toml":
        raise click.UsageError(f"-o {output}: a manifest ends in .toml")
    if model.suffix.lower() == ".toml":
        raise click.UsageError(f"{model} is a manifest already: skinmap inspect {model}")
    twice = [str(file) for row, file in enumerate(files) if file in files[:row]]
    if twice:
        raise click.UsageError(f"{TABLES} names {', '.join(twice)} twice")
    if len(links) not in (0, 1, len(files)):
        raise click.UsageError(
            f"--link is given {len(links)} times for {len(files)} tables: give it once, or once "
            "for each"
        )


def _settle(
    part: str, table: TaxelTable, robot: Robot, units: str | None, link: str | None
) -> tuple[list[Candidate], list[str]]:
    """Candidates for a table, the choice first, and the open questions."""
    if link is None and table.link in robot.body.links:
        link = table.link
    links = robot.body.visible_links or robot.body.links
    tried: dict[str, Sequence[str]] = {
        "units": KNOWN_UNITS if units is None else (units,),
        "link": links if link is None else (link,),
    }
    while True:
        found = candidates(part, table, robot, tried["units"], tried["link"])
        questions = unclear(found)
        found = in_question(found, questions)
        if not questions or not in_terminal():
            return found, questions
        tried[questions[0]] = (_ask(part, questions, found),)


def _ask_mesh(fits: dict[str, list[Candidate]]) -> str:
    """The unit of a mesh: asked for where several fit alike, as that of the first table."""
    if len(fits) == 1:
        return next(iter(fits))
    firsts = {found[0].units: unit for unit, found in fits.items()}
    found = [own[0] for own in fits.values()]
    return firsts[_ask(found[0].part, ["units"], found)]


def _ask(part: str, questions: Sequence[str], found: Sequence[Candidate]) -> str:
    """The answer to the first question on a table, of those that its candidates give."""
    show([_heading(part, questions), _table(found), *_unread(found)])
    names = list(dict.fromkeys(getattr(one, questions[0]) for one in found))
    answer: str = click.prompt(
        f"{questions[0]} of {part}", type=click.Choice(names), default=names[0]
    )
    return answer


def in_terminal() -> bool:
    """Whether a terminal is there to ask."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _warn(chosen: Candidate, table: TaxelTable, robot: Robot, stated: str | None) -> None:
    """Warn of a stated unit that another one fits better than, and of a skin far off its link."""
    others = candidates(chosen.part, table, robot, KNOWN_UNITS, (chosen.link,))
    better = others[0]
    if stated is not None and better.units != stated and not unclear(others):
        warn(
            f"{chosen.part}: in {stated}, as --units states, {_standing(chosen)}; "
            f"in {better.units} {_standing(better)}"
        )
    elif chosen.most_mm is not None and chosen.off > NEAR:
        warn(
            f"{chosen.part}: taxels are {chosen.pitch_mm:.3g} mm apart, and one in five is over "
            f"{chosen.most_mm:.3g} mm off the mesh of {chosen.link}: check units, link and frame"
        )


def _parts_in(output: Path) -> list[str]:
    """Names of the parts of a manifest that is there."""
    try:
        return [str(one["name"]) for one in read_toml(output)["part"]]
    except (SkinError, LookupError, TypeError):
        return []  # none, or no manifest


def _standing(one: Candidate) -> str:
    text = f"taxels are {one.pitch_mm:.3g} mm apart"
    if one.distance_mm is None:
        return text
    return f"{text} and {one.distance_mm:.3g} mm off the mesh"


def _table(found: Sequence[Candidate], *first: str) -> Table:
    """Candidates, the nearest first; `off` is the median distance from the link's mesh."""
    rows: list[list[Any]] = [
        [
            *(getattr(one, name) for name in first), one.units, one.link, _size(one.skin_mm),
            one.pitch_mm, _size(one.link_mm), one.distance_mm, one.most_mm,
        ]
        for one in found[:SHOWN]
    ]  # fmt: skip
    columns = ["units", "link", "skin mm", "pitch mm", "link mm", "off mm", "80 % mm"]
    return Table([*first, *columns], rows)


def _size(lengths: list[float] | None) -> str:
    if lengths is None:
        return "-"
    return " x ".join(f"{one:,.0f}" if one >= 100 else f"{one:.3g}" for one in lengths)


def _questions(result: NewQuestions) -> Iterator[str | Table]:
    for part, questions in result.unclear.items():
        yield _heading(part, questions)
        found = [one for one in result.candidates if one.part == part]
        yield _table(found)
        yield from _unread(found)


def _unread(found: Sequence[Candidate]) -> list[str]:
    """A line for each link whose mesh cannot be read."""
    missing = {one.link: one.unread for one in found if one.unread}
    return [f"mesh of {link} cannot be read: {why}" for link, why in missing.items()]


def _heading(part: str, questions: Sequence[str]) -> str:
    return (
        f"{part}: {' and '.join(questions)} unclear. Candidates, the nearest first "
        "(off: from the link's mesh, median; 80 %: four of five taxels are nearer):"
    )


def _open(result: NewQuestions) -> str:
    """One line: for which tables what is to be given."""
    told = []
    for question in ("units", "link"):
        parts = [part for part, open_ in result.unclear.items() if question in open_]
        if parts:
            words = [getattr(one, question) for one in result.candidates if one.part in parts]
            names = list(dict.fromkeys(words))
            told.append(
                f"the {question} of {', '.join(parts)}: give --{question} "
                + "|".join(names[:SHOWN] + ["..."] * (len(names) > SHOWN))
            )
    return f"{_misfits(result)}the files leave open {' and '.join(told)}"


def _misfits(result: NewQuestions) -> str:
    """The tables that lie far off every link whose mesh can be read, in the best unit asked for."""
    words = ""
    for part in result.unclear:
        own = [one for one in result.candidates if one.part == part]
        near = min(own, key=lambda one: one.off)
        if near.most_mm is not None and near.off > NEAR:
            words += (
                f"{part} fits no mesh in {near.units}: the nearest, of {near.link}, is "
                f"{near.most_mm:,.3g} mm off; "
            )
    return words


def _lines(result: NewResult) -> Iterator[str | Table]:
    count = len(result.parts)
    yield f"{result.robot}: {count} part{'s' * (count != 1)}, {sum(result.taxels.values())} taxels"
    yield _table(result.parts, "part")
    yield f"next: skinmap inspect {result.files[0]}"
