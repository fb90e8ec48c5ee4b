"""Classifiers of touches: contact geometry (the default), histograms, and how well they do.

`skinmap.classify` is this package and, called, the function of the same name: Python binds a
package's name in its parent as soon as any of its modules is imported, whatever stood there.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


def __getattr__(name: str) -> Any:
    if name == "check_classifier":  # on first use: importing this package costs nothing
        from skinmap.classify.check import check_classifier

        return check_classifier
    raise AttributeError(f"module 'skinmap.classify' has no attribute {name!r}")


class _CallablePackage(ModuleType):
    """The package, which answers a call, `help` and `inspect` as the function does."""

    @property
    def _function(self) -> Any:
        from skinmap.classify.naming import classify

        return classify

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        return str(self._function.__doc__)

    @property
    def __signature__(self) -> Any:
        import inspect

        return inspect.signature(self._function)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._function(*arguments, **options)


sys.modules[__name__].__class__ = _CallablePackage
