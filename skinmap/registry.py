"""Plug-ins by name: what we ship and what entry points add, loaded on first look-up only."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar, cast

from skinmap.errors import BrokenPluginError, UnknownNameError

T = TypeVar("T")
logger = logging.getLogger(__name__)


class Registry(Generic[T]):
    """Things of one kind under their names.

    Parameters
    ----------
    kind : str
        What the things are, in the singular, for messages.
    group : str
        Entry-point group that other distributions add to.
    built_in : mapping of str to str, optional
        Built-in things, imported when first looked up: name and "module:attribute".
    adapt : callable or str, optional
        `adapt(name, thing)` adapts what a plug-in's entry point gave; as
        "module:attribute" it is imported with the first plug-in.
    """

    def __init__(
        self,
        kind: str,
        group: str,
        *,
        built_in: Mapping[str, str] | None = None,
        adapt: Callable[[str, object], T] | str | None = None,
    ) -> None:
        self.kind, self.group = kind, group
        self._built_in = dict(built_in or {})
        self._adapt = adapt
        self._own: dict[str, T] = {}
        self._plugins: dict[str, T] | None = None
        self._broken: dict[str, str] = {}  # why those plug-ins do not load

    def register(self, name: str) -> Callable[[T], T]:
        """Decorator that registers a built-in thing under a name."""

        def add(thing: T) -> T:
            self._own[name] = thing
            return thing

        return add

    def names(self) -> tuple[str, ...]:
        """All names, ours first."""
        return tuple(dict.fromkeys([*self._built_in, *self._own, *self._loaded()]))

    def get(self, name: str) -> T:
        """Look a name up.

        Raises
        ------
        UnknownNameError
            If nothing has that name (lists the names).
        BrokenPluginError
            A plug-in that does not load, and why.
        """
        if name in self._own:
            return self._own[name]
        if name in self._built_in:
            thing = _load(self._built_in[name], self.group)
            return self._own.setdefault(name, cast("T", thing))
        if name in self._loaded():
            return self._loaded()[name]
        if name in self._broken:
            raise BrokenPluginError(f"plug-in {name!r} does not load: {self._broken[name]}")
        raise UnknownNameError(self.kind, name, self.names())

    def _loaded(self) -> dict[str, T]:
        if self._plugins is None:
            self._plugins = {}
            for point in entry_points(group=self.group):
                try:
                    thing = point.load()
                    self._plugins[point.name] = self._adapted(point.name, thing)
                # Another distribution's fault must not take ours down, nor end the program.
                except (Exception, SystemExit) as error:  # noqa: BLE001 - named in a line
                    self._broken[point.name] = f"{type(error).__name__}: {error}"
                    logger.error(
                        "plug-in %s of %s does not load (%s)",
                        point.name, self.group, self._broken[point.name],
                    )  # fmt: skip
        return self._plugins

    def _adapted(self, name: str, thing: object) -> T:
        adapt = self._adapt
        if isinstance(adapt, str):
            adapt = self._adapt = cast("Callable[[str, object], T]", _load(adapt, self.group))
        return cast("T", thing) if adapt is None else adapt(name, thing)


def _load(place: str, group: str) -> object:
    """What stands at "module:attribute": an entry point is written so, too, and loads itself."""
    return EntryPoint(place, place, group).load()
