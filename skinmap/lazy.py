"""Names of a package that are loaded on first use; the package's stub is their only list."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
from collections.abc import Callable
from typing import Any


def attach(
    package: str, file: str, adapt: str = ""
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """What a package needs to load the names of its stub on first use.

    Parameters
    ----------
    package : str
        `__name__` of the package.
    file : str
        Its `__file__`; beside it lies `__init__.pyi`, which imports every name from where it is
        defined and lists the public ones in `__all__`. Type checkers read the same file.
    adapt : str
        "module:function" that every function passes through when it is first used.

    Returns
    -------
    __getattr__, __dir__ : callable
        Of the package.
    __all__ : list of str
        The public names.

    Examples
    --------
    >>> import skinmap
    >>> load, names, public = attach("skinmap", skinmap.__file__)
    >>> load("Skin").__module__, "Skin" in public
    ('skinmap.skin.skin', True)
    """
    with open(file + "i", encoding="utf-8") as stub:
        tree = ast.parse(stub.read())
    places = {
        alias.asname or alias.name: (node.module or package, alias.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    (public,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )

    @functools.cache
    def load(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, attribute = places[name]
        if module == package:  # a module of the package itself
            return importlib.import_module(f"{package}.{attribute}")
        found = getattr(importlib.import_module(module), attribute)
        if adapt and inspect.isfunction(found):
            home, _, adapter = adapt.partition(":")
            return getattr(importlib.import_module(home), adapter)(found)
        return found

    return load, lambda: sorted({*places, *public}), list(public)
