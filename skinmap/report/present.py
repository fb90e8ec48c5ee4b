"""The one way in which a command shows its result: JSON or words, files, page, exit code."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Container, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from skinmap.commands.options import profile_used
from skinmap.report.result import REFUSED_CODE, Verdict, decimals, plain
from skinmap.report.table import Table, visible

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

R = TypeVar("R", bound="DataclassInstance")
PAGE, REFUSED_PAGE = "report.html", "refused.html"
Number = Callable[[float], float]
Write = Callable[[Path], Iterable[str]]
Page = Callable[[Path], str]


def present(
    result: R,
    lines: Callable[[R], Iterable[str | Table]],
    *,
    as_json: bool,
    out: Path | None = None,
    write: Write | None = None,
    page: Page | None = None,
    verdict: Verdict | None = None,
    number: Number = decimals,
    inside: Path | None = None,
) -> None:
    """Show a result, and write what belongs to it into a folder: all of it or nothing.

    Parameters
    ----------
    result : dataclass
        With a field `files` where `out` is given; it gets the names of what was written.
    lines : callable
        Words and tables for people.
    as_json : bool
        Print one JSON object instead.
    out : Path, optional
        Folder for files.
    write : callable
        Given the folder, writes files and gives their names; not called for a refused result.
    page : callable
        Given the folder with those files, the HTML of `report.html`, or of `refused.html`.
    verdict : Verdict
        Of a result that may be refused.
    number : callable
        How floats of the JSON object are rounded.
    inside : Path, optional
        Folder that files lie in which were written before.

    Raises
    ------
    SystemExit
        With code 3 where the result was refused.
    """
    refused = verdict is not None and verdict.refused
    if out is not None:
        from skinmap.io.output import staged_folder

        with staged_folder(out) as stage:
            files = write_files(stage, refused, write, page)
        drop_refusal(out, files)
        result = dataclasses.replace(result, files=files)
    if as_json:
        emit(result, number)
    else:
        show(lines(result))
        for file in getattr(result, "files", ()):
            click.echo(str((out or inside or Path()) / file))
    if refused:
        raise SystemExit(REFUSED_CODE)


def write_files(stage: Path, refused: bool, write: Write | None, page: Page | None) -> list[str]:
    """Write into a folder what belongs to a result, of a refused one its page alone; the names."""
    files = [] if refused or write is None else list(write(stage))
    if page is not None:
        files.append(REFUSED_PAGE if refused else PAGE)
        (stage / files[-1]).write_text(page(stage), encoding="utf-8")
    return files


def drop_refusal(out: Path, files: Container[str]) -> None:
    """Remove the `refused.html` of an earlier run from a folder whose result was now written."""
    if PAGE in files:
        (out / REFUSED_PAGE).unlink(missing_ok=True)


MANY = "touches|structures|samples|taxels|channels|recordings|modules|skins|parts|anchors|people"
ONE = {"touches": "touch", "people": "person"}


def singular(line: str) -> str:
    """A line in which one thing is in the singular: "1 touch", not "1 touches"."""
    rule = rf"(?<![\d.,])1 ({MANY})\b"
    return re.sub(rule, lambda found: f"1 {ONE.get(found[1], found[1].rstrip('s'))}", line)


def show(lines: Iterable[str | Table]) -> None:
    """Print words and tables for people."""
    for line in lines:
        if isinstance(line, Table):
            line.print()
        else:
            click.echo(singular(visible(line)))


def emit(result: Any, number: Number = decimals) -> None:
    """Print a result as one JSON object on standard output, over several lines."""
    click.echo(json.dumps(object_of(result, number), indent=2, allow_nan=False))


def emit_line(result: Any) -> None:
    """Print a result as one line, for what has no end; without what was taken from a profile."""
    click.echo(json.dumps(plain(result), allow_nan=False))


def object_of(result: Any, number: Number = decimals) -> dict[str, Any]:
    """The JSON object of a result, with what was taken from a profile if one was given."""
    used = profile_used()
    plainly: dict[str, Any] = plain(result, number)
    return plainly if used is None else plainly | {"profile": plain(used, number)}
