"""`skinmap cache`: what is kept between runs, and dropping it."""

from __future__ import annotations

import os
from typing import Any

import click

from skinmap.commands.groups import NamedGroup
from skinmap.commands.options import json_option
from skinmap.commands.profiles import profile_option
from skinmap.errors import OutputError, UnknownNameError
from skinmap.report.present import emit
from skinmap.report.table import table


@click.group("cache", cls=NamedGroup)
def command() -> None:
    """What is kept on disk between runs, and dropping it.

    Kept are results that are slow to make, under the content they were made from: link meshes as
    read, and wraps of links for calibrations. Nothing there is ever out of date, and nothing is
    lost by dropping it. SKINMAP_CACHE names another folder, or `off`; SKINMAP_CACHE_MB the most
    that is kept (1000).

    Example:  skinmap cache info
    """


@command.command()
@profile_option()
@json_option
def info(as_json: bool) -> None:
    """Where it is, how full, and what of.

    Example:  skinmap cache info --json
    """
    result = _facts()
    if as_json:
        emit(result)
        return
    if result["folder"] is None:
        click.echo("Nothing is kept: the cache is off.")
        return
    click.echo(f"{result['folder']}: {result['state']}")
    click.echo(
        f"{result['entries']} entries, {result['used_mb']:.1f} of {result['limit_mb']:.0f} MB"
    )
    if result["kinds"]:
        rows = [[kind, row["entries"], row["used_mb"]] for kind, row in result["kinds"].items()]
        table(["kind", "entries", "MB"], rows)


@command.command()
@click.option("--kind", help="Only what is of this kind; `skinmap cache info` lists them.")
@profile_option()
@json_option
def clear(kind: str | None, as_json: bool) -> None:
    """Drop what is kept; other files in the folder stay.

    Example:  skinmap cache clear --kind target
    """
    from skinmap.cache import open_cache

    cache = open_cache()
    before = [] if cache is None else cache.entries()
    kinds = sorted({entry.kind for entry in before})
    if kind is not None and kind not in kinds:
        raise UnknownNameError("kind of entry in the cache", kind, kinds)
    asked = [entry for entry in before if kind in (None, entry.kind)]
    if cache is not None:
        cache.clear(kind)
    stuck = [entry for entry in asked if entry.path.exists()]
    if stuck:
        raise OutputError(
            f"{len(stuck)} of {len(asked)} entries cannot be dropped from "
            f"{str(stuck[0].path.parent)!r}: no right to write there?"
        )
    freed = sum(entry.size for entry in asked) / 1e6
    if as_json:
        folder = None if cache is None else str(cache.folder)
        emit({"folder": folder, "dropped": len(asked), "freed_mb": freed})
    else:
        click.echo(
            f"{len(asked)} entr{'y' if len(asked) == 1 else 'ies'} dropped, {freed:.1f} MB freed."
        )


def _facts() -> dict[str, Any]:
    from skinmap.cache import open_cache

    cache = open_cache()
    if cache is None:
        nothing = {"limit_mb": 0.0, "used_mb": 0.0, "entries": 0, "kinds": {}}
        return {"folder": None, "state": "off", **nothing}
    entries = cache.entries()
    kinds: dict[str, dict[str, float]] = {}
    for entry in entries:
        row = kinds.setdefault(entry.kind, {"entries": 0, "used_mb": 0.0})
        row["entries"] += 1
        row["used_mb"] += entry.size / 1e6
    state = "ready"
    if not cache.folder.exists():
        state = "empty"
    elif not cache.folder.is_dir():
        state = "unusable: not a folder"
    elif not os.access(cache.folder, os.W_OK):
        state = "read-only"
    return {
        "folder": str(cache.folder),
        "state": state,
        "limit_mb": cache.limit / 1e6,
        "used_mb": sum(entry.size for entry in entries) / 1e6,
        "entries": len(entries),
        "kinds": dict(sorted(kinds.items())),
    }
