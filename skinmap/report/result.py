"""A result as plain data: a frozen dataclass with units in its names, ready for JSON.

A field that exists only with some option has the default `msgspec.UNSET`, and is then no key. A
field whose name Python keeps for itself ends in an underscore (`with_`), its key does not. The
items of a field with the metadata `MERGED` become keys of the object itself.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from inspect import cleandoc
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
from msgspec import UNSET, UnsetType

OK = "ok"
REFUSED_CODE = 3  # 0 done, 1 internal error, 2 bad input


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a result was judged.

    Attributes
    ----------
    status : str
        `ok`, or in a word why not.
    reasons : sequence of str
        Whole sentences, the most telling first.
    accepted : bool
        Use it whatever the status.
    """

    status: str = OK
    reasons: Sequence[str] = ()
    accepted: bool = False

    @property
    def refused(self) -> bool:
        """Whether results are not to be used."""
        return self.status != OK and not self.accepted


T = TypeVar("T")

# Metadata of a field that holds further keys of the object itself: a mapping, or a result whose
# keys all are there or none.
MERGED = {"merged": True}


def decimals(value: float) -> float:
    """A number to six decimals: below a micrometre, a microsecond, a thousandth of a percent."""
    return round(value, 6)


def significant(value: float) -> float:
    """A number to six digits, for results that span decades."""
    return float(f"{value:.6g}")


def key_of(field: dataclasses.Field[Any]) -> str:
    """The key of a field."""
    return field.name.rstrip("_")


def given(value: T | UnsetType) -> T | None:
    """A field that may be absent, with None for that."""
    return None if isinstance(value, UnsetType) else value


def plain(value: Any, number: Callable[[float], float] = decimals) -> Any:
    """Nested data with Python numbers only, None for NaN and infinity.

    Parameters
    ----------
    value : object
        A result, or whatever its fields hold: mappings, sequences, arrays, paths, numbers.
    number : callable
        How floats are rounded.

    Returns
    -------
    object
        Of dictionaries, lists, texts and numbers, as JSON takes it.

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.report import plain
    >>> plain({"error": np.array([0.12345678, np.nan])})
    {'error': [0.123457, None]}
    """
    if dataclasses.is_dataclass(value):
        return _fields(value, number)
    if isinstance(value, Mapping):
        return {str(key): plain(item, number) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, number) for item in value]
    if isinstance(value, Enum):
        return value.value
    if hasattr(value, "tolist"):
        return plain(value.tolist(), number)
    if isinstance(value, float):
        return number(value) if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def _fields(value: Any, number: Callable[[float], float]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for field in dataclasses.fields(value):
        item = getattr(value, field.name)
        if item is UNSET:
            continue
        if field.metadata == MERGED:
            found |= plain(item, number)
        else:
            found[key_of(field)] = plain(item, number)
    return found


# JSON schemas out of result types: types from the fields, words from the docstrings.

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def result_schema(title: str, types: Sequence[type], extra: type | None = None) -> dict[str, Any]:
    """The schema of what a command prints: an object of one of some result types.

    Parameters
    ----------
    title : str
    types : sequence of type
        Dataclasses; several where what is printed depends on the options.
    extra : type
        A dataclass whose fields the object may have besides.

    Raises
    ------
    TypeError
        A field without words in its docstring, or two types of one name.
    """
    everything = [*types, *([] if extra is None else [extra])]
    classes = _classes(everything)
    _, made = msgspec.json.schema_components(
        everything, schema_hook=_hook, ref_template="#/$defs/{name}"
    )
    objects = {name: _closed(name, made, classes) for name in made}
    tops = [objects.pop(one.__name__) for one in types]
    if extra is not None:
        more = objects.pop(extra.__name__)["properties"]
        for top in tops:
            top["properties"] |= more
    head: dict[str, Any] = {"$schema": DIALECT, "title": title}
    if len(tops) > 1:
        named = zip(types, tops, strict=True)
        head |= {"anyOf": [{"title": kind.__name__, **top} for kind, top in named]}
    else:
        head |= tops[0]
    printed = json.dumps([head, objects])  # what was merged into others is not referred to
    objects = {name: one for name, one in objects.items() if f'"#/$defs/{name}"' in printed}
    return head | ({"$defs": objects} if objects else {})


def field_texts(kind: type) -> dict[str, str]:
    """What the Attributes sections of a dataclass and its bases say of each field, in one line."""
    texts: dict[str, str] = {}
    for one in reversed(kind.__mro__):
        _, _, section = cleandoc(one.__doc__ or "").partition("Attributes\n----------\n")
        names: list[str] = []
        for line in section.splitlines():
            if line and not line.startswith(" "):
                names = [name.strip() for name in line.partition(" : ")[0].split(",")]
                texts |= dict.fromkeys(names, "")
            else:
                texts |= {name: f"{texts[name]} {line.strip()}".strip() for name in names}
    return texts


def _closed(name: str, made: dict[str, Any], classes: dict[str, type]) -> dict[str, Any]:
    """The schema of one dataclass with its words, and without room for other keys."""
    schema, kind = made[name], classes[name]
    texts = field_texts(kind)
    properties: dict[str, Any] = {}
    rest: Any = False
    for field in dataclasses.fields(kind):
        found = schema["properties"][field.name]
        text = field.metadata.get("text") or texts.get(field.name)
        if not text:
            raise TypeError(f"{kind.__name__}.{field.name} is not described in its docstring")
        found.pop("default", None)
        if field.metadata == MERGED and "$ref" in found:
            inner = _closed(found["$ref"].rpartition("/")[2], made, classes)
            properties = inner["properties"] | properties
        elif field.metadata == MERGED:
            rest = {**found["additionalProperties"], "description": text}
        else:
            properties[key_of(field)] = {**found, "description": text}
    return {
        "type": "object",
        "description": re.split(r"\n\s*\n", cleandoc(kind.__doc__ or ""))[0].replace("\n", " "),
        "properties": properties,
        "required": [
            key_of(field)
            for field in dataclasses.fields(kind)
            if field.name in schema["required"] and field.metadata != MERGED
        ],
        "additionalProperties": rest,
    }


def _classes(types: Sequence[type]) -> dict[str, type]:
    """All dataclasses that some types are made of, by name."""
    found: dict[str, type] = {}
    for one in types:
        for kind in _parts(one, set()):
            if found.setdefault(kind.__name__, kind) is not kind:
                raise TypeError(f"two result types are called {kind.__name__}")
    return found


def _parts(kind: Any, seen: set[Any]) -> Iterator[type]:
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        if kind in seen:
            return
        seen.add(kind)
        yield kind
        for hint in get_type_hints(kind).values():
            yield from _parts(hint, seen)
    for argument in get_args(kind):
        yield from _parts(argument, seen)


def _hook(kind: type) -> dict[str, Any]:
    """What msgspec has no schema of."""
    if kind is Path:
        return {"type": "string"}
    raise NotImplementedError(kind)
