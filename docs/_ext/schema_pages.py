"""What `--json` prints, out of the schemas that the tests hold the commands to."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def schemas_text(folder: Path) -> str:
    """One heading and one table for each schema."""
    texts = []
    for file in sorted(folder.glob("*.json")):
        schema = json.loads(file.read_text())
        texts += [f"## `{schema['title']}`", "", schema.get("description", ""), ""]
        texts += [f"Schema: {{download}}`{file.name} <../schemas/{file.name}>`", ""]
        for one in schema.get("anyOf", [schema]):  # a line of a live source is one of several
            texts += ["| key | type | |", "|---|---|---|"]
            texts += [f"| `{key}` | {kind} | {text} |" for key, kind, text in rows(one, schema)]
            texts += [""]
    return "\n".join(texts)


def rows(schema: Any, root: Any, above: str = "") -> Iterator[tuple[str, str, str]]:
    """Every key with its type and meaning, those of nested objects after a dot."""
    always = set(schema.get("required", ()))
    for key, raw in schema.get("properties", {}).items():
        value = resolved(raw, root)
        text = raw.get("description", value.get("description", ""))
        when = "" if key in always else " (not always)"
        yield f"{above}{key}", kind(value, root), text + when
        inner = resolved(value.get("items", value), root)
        mark = "[]" if "items" in value else ""
        yield from rows(inner, root, f"{above}{key}{mark}.")


def resolved(schema: Any, root: Any) -> Any:
    """The schema itself, or what its reference inside the same file names."""
    while "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    return schema


def kind(schema: Any, root: Any) -> str:
    """The type for people."""
    found = schema.get("type", "")
    types = [found] if isinstance(found, str) else list(found)
    if "array" in types and "items" in schema:
        inner = kind(resolved(schema["items"], root), root)
        types[types.index("array")] = f"array of {inner}" if inner else "array"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    return " or ".join(types)
