"""Flat maps, made when they are first shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from skinmap.flat.flat_map import FlatMap
from skinmap.touch.prepared_skin import PreparedSkin


class LazyMaps(Mapping[str, FlatMap]):
    """Flat maps of prepared skins, or of another such mapping, each made when first looked at."""

    def __init__(
        self,
        skins: Mapping[str, PreparedSkin] | Mapping[str, FlatMap],
        parts: Iterable[str] | None = None,
    ) -> None:
        self._skins = skins
        self._parts = [part for part in (skins if parts is None else parts) if part in skins]

    def __getitem__(self, part: str) -> FlatMap:
        if part not in self._parts:
            raise KeyError(part)
        found = self._skins[part]
        return found if isinstance(found, FlatMap) else found.flat

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __contains__(self, part: object) -> bool:
        return part in self._parts  # without making it

    def __len__(self) -> int:
        return len(self._parts)
