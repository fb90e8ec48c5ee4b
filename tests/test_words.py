"""Plain technical English in what users read: messages, and the first line of each docstring."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from skinmap.errors import UnknownNameError

ROOT = Path(__file__).parents[1]
FILES = [
    path for top in ("skinmap", "calibration", "viewer") for path in (ROOT / top).rglob("*.py")
]
# What is refused, and what is written instead.
PHRASES = {
    r"fault of ours": "internal error",
    r"\b(recording|model|network|table|format|file|error|writer)s? of ours": "a Skinmap recording",
    r"\bthere is: ": "the parts are: a, b",
    r"\bwhat came\b": "a noun first",
    r"\b(no|some|every|any)body\b": "a passive, or who it is: a user, a publisher",
    r"\bwhoever\b": "the noun: the reader, the next worker",
    r"\bwish(es|ed)?\b": "request",
    r"\bhow sure\b": "with what confidence",
    r"\ba (sample|clock offset|covariance|value) that is none": "not a valid sample",
    r"code points that are no letters": "invalid Unicode",
}
WORST = re.compile("|".join(PHRASES), flags=re.IGNORECASE)


def read_by_users(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and text of each literal; of docstrings only their first line."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
            yield node.lineno, text.partition("\n")[0] if id(node) in docstrings else text


def found(source: str) -> list[str]:
    return [
        f"{line}: {text}" for line, text in read_by_users(ast.parse(source)) if WORST.search(text)
    ]


def test_no_file_holds_a_refused_phrase():
    bad = [f"{path.relative_to(ROOT)}:{one}" for path in FILES for one in found(path.read_text())]
    assert not bad, "\n".join(bad)


@pytest.mark.parametrize(
    "source",
    [
        'raise SkinError(f"a fault of ours: {x}")',
        'raise DataFormatError("not a recording of ours", path)',
        'def f():\n    """What came."""',
        'print("nobody answers")',
    ],
)
def test_a_refused_phrase_is_found(source):
    assert found(source)


@pytest.mark.parametrize(
    ("kind", "name", "known", "said"),
    [
        ("part", "torsoo", ["torso", "hand"], "did you mean 'torso'? The parts are: torso, hand"),
        ("part", "tail", ["torso", "hand"], "no part 'tail'; the parts are: torso, hand"),
        ("part", "tail", ["torso"], "no part 'tail'; the only part is torso"),
        ("part", "tail", [], "no part 'tail'; there are not any parts"),
        ("part in 'x.mcap'", "tail", ["a", "b"], "the parts are: a, b"),
        (
            "recording format for files ending in",
            ".wav",
            [".npz", ".mcap"],
            "the recording formats are",
        ),
        ("part or probe", "tail", ["a", "b"], "the parts and probes are: a, b"),
        ("patch", "TORSO", ["torso"], "did you mean 'torso'? The only patch is torso"),
        ("loss", "x", ["linear", "cauchy"], "the losses are: linear, cauchy"),
    ],
)
def test_an_unknown_name_is_answered_in_a_sentence(kind, name, known, said):
    message = str(UnknownNameError(kind, name, known))
    assert message.startswith(f"no {kind} {name!r}; ")
    assert said in message
