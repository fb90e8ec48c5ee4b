"""Optional packages, imported where they are used, with one line on how to get them."""

from __future__ import annotations

import importlib
from functools import cache
from importlib import metadata
from typing import Any

from skinmap.errors import MissingLibraryError


def import_meshlab() -> Any:
    """The package, or one line on what needs it.

    Raises
    ------
    MissingLibraryError
        It is not installed.
    """
    return import_optional(
        "pymeshlab",
        "wrapping a body and `--meshing accurate` need pymeshlab (GPL-3): pip install pymeshlab",
    )


@cache
def installed(package: str) -> str | None:
    """The version of a distribution, read once in a process; None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def import_optional(module: str, need: str) -> Any:
    """A module of an optional package.

    Parameters
    ----------
    module : str
    need : str
        The message where it is not installed: what needs the package, and how to install it.

    Raises
    ------
    MissingLibraryError
        It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingLibraryError(need) from error
