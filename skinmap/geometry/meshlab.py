"""The package pymeshlab where it is there: GPL-3, so that some leave it out."""

from __future__ import annotations

from typing import Any

from skinmap.imports import import_optional


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
