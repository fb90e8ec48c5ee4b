"""`skinmap cache`: what is kept between runs, and dropping it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field

import click

from skinmap.commands.options import prints
from skinmap.commands.retired import NO_PROFILE, NamedGroup, retired
from skinmap.errors import OutputError
from skinmap.report.present import present
from skinmap.report.table import Cell, Table


@dataclass(frozen=True, kw_only=True, slots=True)
class KindRow:
    """Cache entries of one kind.

    Attributes
    ----------
    entries
        Number of cache entries.
    used_mb
        Size of the entries.
    """

    entries: int
    used_mb: float


@dataclass(frozen=True, kw_only=True, slots=True)
class CacheInfo:
    """Results kept between runs.

    Attributes
    ----------
    folder
        Where; null where the cache is off.
    state
        "ready", "empty", "read-only", "off", or why it cannot be used.
    limit_mb, used_mb
        The most that is kept, and what is.
    entries
        Number of cache entries.
    kinds
        By the kind of what is kept.
    """

    folder: str | None
    state: str
    limit_mb: float = 0.0
    used_mb: float = 0.0
    entries: int = 0
    kinds: dict[str, KindRow] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, slots=True)
class CacheCleared:
    """Entries dropped from the cache.

    Attributes
    ----------
    folder
        Where; null where the cache is off.
    dropped, freed_mb
        Entries, and how much they were.
    """

    folder: str | None
    dropped: int
    freed_mb: float


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
@retired(profile=NO_PROFILE)
@prints(CacheInfo)
def info(as_json: bool) -> None:
    """Show the folder, size and content of the cache.

    Example:  skinmap cache info --json
    """
    present(cache_info(), _info_lines, as_json=as_json)


@command.command()
@retired(profile=NO_PROFILE, kind="leave it out: all is dropped, and made anew where it is needed")
@prints(CacheCleared)
def clear(as_json: bool) -> None:
    """Empty the cache; other files in the folder stay.

    Example:  skinmap cache clear
    """
    present(clear_cache(), _clear_lines, as_json=as_json)


def cache_info() -> CacheInfo:
    """Look into the cache."""
    from skinmap.disk_cache import open_cache

    cache = open_cache()
    if cache is None:
        return CacheInfo(folder=None, state="off")
    entries = cache.entries()
    sizes: dict[str, list[int]] = {}
    for entry in entries:
        sizes.setdefault(entry.kind, []).append(entry.size)
    state = "ready"
    if not cache.folder.exists():
        state = "empty"
    elif not cache.folder.is_dir():
        state = "unusable: not a folder"
    elif not os.access(cache.folder, os.W_OK):
        state = "read-only"
    return CacheInfo(
        folder=str(cache.folder),
        state=state,
        limit_mb=cache.limit / 1e6,
        used_mb=sum(entry.size for entry in entries) / 1e6,
        entries=len(entries),
        kinds={
            kind: KindRow(entries=len(own), used_mb=sum(own) / 1e6)
            for kind, own in sorted(sizes.items())
        },
    )


def clear_cache() -> CacheCleared:
    """Drop everything.

    Raises
    ------
    OutputError
        Something cannot be dropped.
    """
    from skinmap.disk_cache import open_cache

    cache = open_cache()
    asked = [] if cache is None else cache.entries()
    if cache is not None:
        cache.clear()
    stuck = [entry for entry in asked if entry.path.exists()]
    if stuck:
        raise OutputError(
            f"{len(stuck)} of {len(asked)} entries cannot be dropped from "
            f"{str(stuck[0].path.parent)!r}: no right to write there?"
        )
    folder = None if cache is None else str(cache.folder)
    freed = sum(entry.size for entry in asked) / 1e6
    return CacheCleared(folder=folder, dropped=len(asked), freed_mb=freed)


def _info_lines(result: CacheInfo) -> Iterator[str | Table]:
    if result.folder is None:
        yield "Nothing is kept: the cache is off."
        return
    yield f"{result.folder}: {result.state}"
    yield f"{result.entries} entries, {result.used_mb:.1f} of {result.limit_mb:.0f} MB"
    if result.kinds:
        rows: list[list[Cell]] = [
            [kind, row.entries, row.used_mb] for kind, row in result.kinds.items()
        ]
        yield Table(["kind", "entries", "MB"], rows)


def _clear_lines(result: CacheCleared) -> Iterator[str]:
    entries = f"{result.dropped} entr{'y' if result.dropped == 1 else 'ies'}"
    yield f"{entries} dropped, {result.freed_mb:.1f} MB freed."
