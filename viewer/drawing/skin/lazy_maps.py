"""Flat maps, made when they are first shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from skinmap.flat.flat_map import FlatMap
from skinmap.touch.prepared_skin import PreparedSkin


class LazyMaps(Mapping[str, FlatMap]):
    """Flat maps of prepared skins, each made when first looked at."""

    def __init__(self, skins: Mapping[str, PreparedSkin]) -> None:
        self._skins = skins

    def __getitem__(self, part: str) -> FlatMap:
        return self._skins[part].flat

    def __iter__(self) -> Iterator[str]:
        return iter(self._skins)

    def __contains__(self, part: object) -> bool:
        return part in self._skins  # without making it

    def __len__(self) -> int:
        return len(self._skins)


class SomeMaps(Mapping[str, FlatMap]):
    """Those flat maps of some parts that there are; none is looked at here."""

    def __init__(self, maps: Mapping[str, FlatMap], parts: Iterable[str]) -> None:
        self._maps = maps
        self._parts = tuple(part for part in parts if part in maps)

    def __getitem__(self, part: str) -> FlatMap:
        if part not in self._parts:
            raise KeyError(part)
        return self._maps[part]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __contains__(self, part: object) -> bool:
        return part in self._parts

    def __len__(self) -> int:
        return len(self._parts)
