"""JSON schemas out of result types: types from the fields, words from the docstrings."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec

from skinmap.report.result import MERGED, key_of

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
