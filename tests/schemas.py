"""Holds what commands print with --json to docs/schemas, whatever test runs them."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"


@cache
def validator(name: str) -> Any:
    """The check of one command's output; None where there is no schema yet."""
    from jsonschema import Draft202012Validator

    path = FOLDER / f"{name}.json"
    return Draft202012Validator(json.loads(path.read_text())) if path.is_file() else None


def command_name(words: list[str]) -> str:
    """The command that some arguments call: `flatten`, `calibrate-wrap`."""
    plain = [word for word in words if not word.startswith("-")]
    return "-".join(plain[: 2 if plain and plain[0] == "calibrate" else 1])


def check(words: list[str], result: Result) -> None:
    """Fail where the output of a command that went well is not what its schema says."""
    if "--json" not in words or result.exit_code != 0:
        return
    name = command_name(words)
    try:
        printed = json.loads(result.stdout)
    except ValueError:
        return  # a live source: one object a line
    if "event" in printed:
        return  # the same, with one line only
    if folder := os.environ.get("SKINMAP_JSON_SAMPLES"):
        with (Path(folder) / f"{name}.jsonl").open("a") as file:
            file.write(json.dumps(printed) + "\n")
        return
    found = validator(name)
    if found is not None:
        faults = sorted(found.iter_errors(printed), key=str)
        assert not faults, f"{name} --json against docs/schemas/{name}.json: {faults[0].message}"


def watch(monkeypatch: Any) -> None:
    """Look at every command that a test runs in this process."""
    plain = CliRunner.invoke

    def invoke(self: CliRunner, cli: Any, args: Any = None, **options: Any) -> Result:
        result = plain(self, cli, args, **options)
        if isinstance(args, list | tuple) and getattr(cli, "name", "") == "cli":
            check([str(word) for word in args], result)
        return result

    monkeypatch.setattr(CliRunner, "invoke", invoke)
