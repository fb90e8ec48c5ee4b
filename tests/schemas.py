"""Holds what commands print with --json to docs/schemas, whatever test runs them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from click import Command
from click.testing import CliRunner, Result

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"
GROUPS = ("calibrate",)  # their commands have a word more


@cache
def validator(name: str) -> Any:
    """The check of one command's output; every command has a schema."""
    from jsonschema import Draft202012Validator

    return Draft202012Validator(json.loads((FOLDER / f"{name}.json").read_text()))


def command_name(words: list[str]) -> str:
    """The command that some arguments call: `flatten`, `calibrate-wrap`."""
    plain = [word for word in words if not word.startswith("-")]
    return "-".join(plain[: 2 if plain and plain[0] in GROUPS else 1])


def objects(text: str) -> tuple[list[Any], bool]:
    """What was printed, and whether it is a live source's: one object a line."""
    try:
        printed = json.loads(text)
    except ValueError:
        return [json.loads(line) for line in text.splitlines()], True
    return [printed], "event" in printed


def check(words: list[str], result: Result) -> None:
    """Fail where the output of a command that went well is not what its schema says."""
    if "--json" not in words or result.exit_code not in (0, 3):
        return
    printed, live = objects(result.stdout)
    name = command_name(words) + ("-live" if live else "")
    found = validator(name)
    for one in printed:
        faults = sorted(found.iter_errors(one), key=str)
        assert not faults, f"{name} --json against docs/schemas: {faults[0].message}"
        new = set(one) - top_keys(found.schema)
        assert not new, f"{name} --json has keys that docs/schemas does not: {sorted(new)}"


def top_keys(schema: Any) -> set[str]:
    """All keys that an object may have at its top; a live source prints several kinds of it."""
    return {key for one in schema.get("anyOf", [schema]) for key in one["properties"]}


def ours(cli: Command) -> bool:
    """Whether a command is one of the packages', not one that a test made up."""
    return not getattr(cli.callback, "__module__", "").startswith("tests.")


def watch(monkeypatch: Any) -> None:
    """Look at every command that a test runs in this process."""
    plain = CliRunner.invoke

    def invoke(self: CliRunner, cli: Any, args: Any = None, **options: Any) -> Result:
        result = plain(self, cli, args, **options)
        if isinstance(args, list | tuple) and isinstance(cli, Command) and cli.name and ours(cli):
            above = [] if cli.name == "cli" else [cli.name]  # a command may be called by itself
            check([*above, *map(str, args)], result)
        return result

    monkeypatch.setattr(CliRunner, "invoke", invoke)
