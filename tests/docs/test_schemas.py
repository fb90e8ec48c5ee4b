"""Schemas and tables of --json are what the types of result say."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from tests.docs.test_prose import findings

ROOT = Path(__file__).parents[2]


def load_script():
    spec = importlib.util.spec_from_file_location("schemas_script", ROOT / "scripts" / "schemas.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


script = load_script()
FOUND = script.schemas()


@pytest.mark.parametrize("name", FOUND)
def test_schema_is_that_of_the_result(name):
    kept = (ROOT / "docs" / "schemas" / f"{name}.json").read_text()
    assert kept == script.text_of(FOUND[name]), "run `make schemas`"


def test_page_is_that_of_the_results():
    assert script.PAGE.read_text() == script.page(FOUND), "run `make schemas`"


def test_every_schema_is_of_a_result():
    assert {file.stem for file in script.SCHEMAS.glob("*.json")} == FOUND.keys()


def test_every_command_says_what_it_prints():
    assert {
        words for words, command in script.commands(script.cli) if not script.results_of(command)
    } == set()


def objects(schema):
    for one in (*schema.get("anyOf", [schema]), *schema.get("$defs", {}).values()):
        yield one["properties"]


def nullable(schema):
    """Whether null is among what a key may hold, in arrays and objects too."""
    if isinstance(schema, dict):
        return schema.get("type") == "null" or any(nullable(one) for one in schema.values())
    return isinstance(schema, list) and any(nullable(one) for one in schema)


def descriptions(schema):
    if isinstance(schema, dict):
        if isinstance(text := schema.get("description"), str):
            yield text
        schema = schema.values()
    if not isinstance(schema, str | int | float | bool | None):
        for one in schema:
            yield from descriptions(one)


@pytest.mark.parametrize("name", FOUND)
def test_description_can_be_read_alone(name):
    texts = [*descriptions(FOUND[name])]
    assert [text for text in texts if len(text.split()) <= 3 or findings(text)] == []


@pytest.mark.parametrize("name", FOUND)
def test_key_that_may_be_null_says_when(name):
    for properties in objects(FOUND[name]):
        for key, value in properties.items():
            assert not nullable(value) or "null" in value["description"].lower(), key
