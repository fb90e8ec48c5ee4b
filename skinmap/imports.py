"""How packages are imported that are not always needed, or not everywhere installed.

Optional ones where they are used, with one line on how to get them. Modules that libraries import
on the way and a command hardly uses run at their first use: scikit-learn imports all of
`scipy.stats` for a few of its estimators, PyVista `matplotlib.pyplot` for one function, 0.3 and
0.4 s of CPU time of every command that only wanted the rest of them.
"""

from __future__ import annotations

import importlib
import sys
import threading
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

from skinmap.errors import MissingLibraryError

LATE = ("scipy.stats", "matplotlib.pyplot", "numpy.f2py", "numpy.testing", "pooch")
_LOADER, _PATH = "_late_loader", "_late_path"  # kept in the module until it runs
_running = threading.RLock()


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


class _LateModule(ModuleType):
    """A module whose code runs when something in it is asked for.

    `importlib.util.LazyLoader` is meant for this, but in Python 3.11 a second import of the
    module already counts as a use.
    """

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__path__":  # what importing itself looks at
            raise AttributeError(name)
        with _running:
            loader = vars(self).pop(_LOADER, None)
            if loader is not None:
                loader.run(self)
                self.__class__ = ModuleType  # type: ignore[assignment]
        try:
            return vars(self)[name]
        except KeyError:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}") from None


class _LateLoader(Loader):
    def __init__(self, real: Loader) -> None:
        self.real = real

    def exec_module(self, module: ModuleType) -> None:
        # Without its path, so that a module inside it is only imported once this one has run.
        vars(module).update({_LOADER: self, _PATH: vars(module).pop("__path__", None)})
        module.__class__ = _LateModule

    def run(self, module: ModuleType) -> None:
        path = vars(module).pop(_PATH)
        if path is not None:
            vars(module)["__path__"] = path
        self.real.exec_module(module)


class _LateFinder(MetaPathFinder):
    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target) if name in LATE else None
        if spec is not None and spec.loader is not None:
            spec.loader = _LateLoader(spec.loader)
        return spec


def run_late() -> None:
    """Have the modules of `LATE` run at their first use in this process, not when imported."""
    if not any(isinstance(finder, _LateFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _LateFinder())
