"""Hot loops compiled by numba, where it is installed and pays for its import."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from functools import cache, update_wrapper
from typing import Any

from skinmap.imports import import_optional

Loop = Callable[..., Any]


def compile_loop(function: Loop, **options: Any) -> Loop:
    """A function compiled on its first call; the machine code is kept on disk where it may be.

    numba keeps it beside the source, or in the user's cache folder where the source may not be
    written to; with neither, as in a read-only installation or on a full disk, it is compiled in
    each process.

    Raises
    ------
    MissingLibraryError
        Without numba.
    """
    numba = import_optional("numba", "compiled loops need the package numba: pip install numba")
    try:
        loop = numba.njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:  # "no locator available": nowhere to write
        return numba.njit(nogil=True, **options)(function)

    def call(*given: Any) -> Any:
        try:
            return loop(*given)
        except OSError:  # no room for the machine code, which this process has all the same
            return loop(*given)

    return update_wrapper(call, loop)


@cache
def compiled(function: Loop) -> Loop:
    """A function of a module, compiled once in this process (see `compile_loop`)."""
    return compile_loop(function)


def pays(size: float, least: float) -> bool:
    """Whether work of a size is worth compiling: a lot of it, or numba is loaded already."""
    if sys.modules.get("numba") is not None:
        return True
    return size >= least and importlib.util.find_spec("numba") is not None
