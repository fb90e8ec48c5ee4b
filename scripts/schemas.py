"""Write docs/schemas and the tables of docs/json.md out of the types of result of all commands."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from skinmap.cli.main import cli
from skinmap.commands.options import Profiled, ProfileUsed, results_of
from skinmap.report.result import result_schema

ROOT = Path(__file__).resolve().parents[1]
SCHEMAS, PAGE = ROOT / "docs" / "schemas", ROOT / "docs" / "json.md"
PROFILE = f"#/$defs/{ProfileUsed.__name__}"
MARK = "<!-- From here on made by `make schemas` out of the types of result. -->\n"


def commands(
    group: click.Group, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """All commands by the words that call them."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands(command, (*above, name))
        elif command is not None and not command.hidden:
            yield (*above, name), command


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each mode of each command, by the name of its file."""
    found = {}
    for words, command in commands(cli):
        options = [one for one in command.params if isinstance(one, click.Option)]
        extra = (
            Profiled if any(one.name == "profile" and not one.hidden for one in options) else None
        )
        for mode, types in results_of(command).items():
            name = "-".join([*words, *([mode] if mode else [])])
            title = f"skinmap {' '.join(words)} --json" + (f" ({mode})" if mode else "")
            found[name] = result_schema(title, types, extra)
    return found


def page(found: Mapping[str, dict[str, Any]]) -> str:
    """The page: what was written by hand, then the tables."""
    by_hand = PAGE.read_text(encoding="utf-8").partition(MARK)[0]
    return by_hand + MARK + "".join(f"\n{_section(*item)}" for item in found.items())


def _section(name: str, schema: Mapping[str, Any]) -> str:
    """The tables of one schema, those of what is inside it after it."""
    parts = [f"## `{schema['title']}`", f"[Schema](schemas/{name}.json)."]
    for one in schema.get("anyOf", [schema]):
        parts += [one["description"], _table(one)]
    for title, one in schema.get("$defs", {}).items():
        if title == ProfileUsed.__name__:
            continue  # the same for all commands, said once above
        parts += [f"`{title}`: {one['description']}", _table(one)]
    return "\n\n".join(parts) + "\n"


def _table(schema: Mapping[str, Any]) -> str:
    always = set(schema["required"])
    lines = ["| key | type | |", "|---|---|---|"]
    for key, value in schema["properties"].items():
        if value.get("$ref") == PROFILE:
            continue
        when = "" if key in always else " Not always there."
        lines.append(f"| `{key}` | {_kind(value)} | {value['description']}{when} |")
    rest = schema["additionalProperties"]
    if rest:
        lines.append(f"| ... | {_kind(rest)} | {rest['description']} |")
    return "\n".join(lines)


def _kind(schema: Mapping[str, Any]) -> str:
    """A type for people."""
    if "$ref" in schema:
        return f"`{schema['$ref'].rpartition('/')[2]}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if "anyOf" in schema:
        return " or ".join(_kind(one) for one in schema["anyOf"])
    if schema.get("type") == "array":
        inner = schema.get("items")
        return f"array of {_kind(inner)}" if inner else "array"
    if isinstance(schema.get("additionalProperties"), Mapping):
        return f"object of {_kind(schema['additionalProperties'])}"
    return str(schema.get("type", "any"))


def text_of(schema: Mapping[str, Any]) -> str:
    """What stands in a file of docs/schemas."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def main() -> int:
    """Write the page and the schemas, and nothing else into their folder."""
    found = schemas()
    for file in SCHEMAS.glob("*.json"):
        if file.stem not in found:
            file.unlink()
    for name, schema in found.items():
        (SCHEMAS / f"{name}.json").write_text(text_of(schema), encoding="utf-8")
    PAGE.write_text(page(found), encoding="utf-8")
    print(f"docs/schemas: {len(found)} written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
