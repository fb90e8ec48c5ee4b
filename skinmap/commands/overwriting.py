"""No file of a user is overwritten by accident: one rule for all commands that write.

A command replaces a file only where the same option of the same command made it and nobody has
changed it since. Anything else that is there is refused before any work is done, and `--force`
replaces it. Which command made a file is not in the file (few formats have a place for that) but
in a note of its size and time of change, in the user's folder for states: a file without a note is
somebody else's.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from hashlib import blake2b
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import click

from skinmap.errors import OutputError

F = TypeVar("F", bound=Callable[..., Any])
Made = dict[str, list[int]]  # file's name below the output ("" for the output): size, change [ns]
FORCE = "skinmap.force"
NOTES = 2000  # outputs that are remembered, the oldest leaving
MOST = 20_000  # files of a folder that are looked at


def _note_force(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    ctx.meta[FORCE] = value


def force_option(command: F) -> F:
    """`--force`, once for each command, however many outputs it has."""
    if any(one.name == "force" for one in getattr(command, "__click_params__", ())):
        return command
    return click.option(
        "--force",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_note_force,
        help="Replace files that are there.",
    )(command)


def guard(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    """A callback of an option that names an output; see `protect`."""
    if value is not None:
        protect(value, option=param.opts[-1], ctx=ctx)
    return value


def protect(
    output: Path, *, data: bool = False, option: str = "--out", ctx: click.Context | None = None
) -> None:
    """Refuse an output that is there, unless this command made it or `--force` is given.

    Parameters
    ----------
    output : Path
        A file or a folder. A folder is refused for any file in it that this command did not make;
        hidden ones do not count.
    data : bool
        Recorded or made by hand: even the command that wrote it does not replace it.
    option : str
        That named the output: a picture by `view --screenshot` is not a movie of `view --movie`.
    ctx : click.Context, optional
        Of the command; the current one by default.

    Raises
    ------
    OutputError
        In one line, with what replaces it.
    """
    ctx = ctx or click.get_current_context()
    maker = f"{_name(ctx)} {option}"
    before = dict(_files(output))
    if not ctx.meta.get(FORCE):
        made = {} if data else _noted(output, maker)
        for name, state in before.items():
            if made.get(name) == state:
                continue
            if not name:
                raise OutputError(f"{str(output)!r} is there already; --force replaces it")
            raise OutputError(
                f"the folder {str(output)!r} holds {name!r}, which this command did not make; "
                "name another folder, or write into this one with --force"
            )
    if not data:
        ctx.call_on_close(lambda: _note(output, maker, before))


def _name(ctx: click.Context) -> str:
    """Of a command below `skinmap`, as "calibrate wrap"."""
    root = ctx.find_root().info_name or ""
    return ctx.command_path.removeprefix(root).strip() or root


def _files(output: Path) -> Iterator[tuple[str, list[int]]]:
    """Size and time of change of each file of an output."""
    if not output.is_dir():
        paths = iter([output])
    else:
        paths = islice((one for one in output.rglob("*") if one.is_file()), MOST)
    for path in paths:
        name = path.relative_to(output)
        if not any(one.startswith(".") for one in name.parts):
            with suppress(OSError):  # it is not there, or has just gone
                facts = path.stat()
                yield name.as_posix().removeprefix("."), [facts.st_size, facts.st_mtime_ns]


def _noted(output: Path, maker: str) -> Made:
    """What a command is known to have made of an output."""
    with suppress(OSError, RuntimeError, ValueError, TypeError, KeyError):
        note = json.loads(_place(output).read_text(encoding="utf-8"))
        if note["maker"] == maker:
            return dict(note["files"])
    return {}


def _note(output: Path, maker: str, before: Made) -> None:
    """Remember what a command made; where that cannot be kept, the files count as another's."""
    known = _noted(output, maker)
    now = dict(_files(output))
    made = {
        name: state
        for name, state in now.items()
        if state == known.get(name) or state != before.get(name)
    }
    if made == known:
        return
    with suppress(OSError, RuntimeError):
        place = _place(output)
        place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        note = {"output": str(output.absolute()), "maker": maker, "files": made}
        part = place.with_suffix(f".{os.getpid()}")
        part.write_text(json.dumps(note) + "\n", encoding="utf-8")
        os.replace(part, place)
        notes = sorted(place.parent.iterdir(), key=lambda one: one.stat().st_mtime_ns)
        for old in notes[:-NOTES]:
            old.unlink(missing_ok=True)


def _place(output: Path) -> Path:
    """Of the note about an output; RuntimeError for a user without a home."""
    base = Path(os.environ.get("XDG_STATE_HOME", ""))
    states = base if base.is_absolute() else Path.home() / ".local" / "state"
    key = blake2b(os.fsencode(output.resolve()), digest_size=16).hexdigest()
    return states / "skinmap" / "made" / f"{key}.json"
