"""Results as plain data, the schemas of their types, and how they are shown."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import click
import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from skinmap.report.present import present
from skinmap.report.result import MERGED, Verdict, field_texts, plain, result_schema, significant
from skinmap.report.table import Table


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """One of the rows.

    Attributes
    ----------
    with_
        What it is compared with.
    error_mm
        In millimetres;
        null where nothing was found.
    """

    with_: str
    error_mm: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Found:
    """What was found.

    Attributes
    ----------
    rows, more
        In order.
    late
        Only with an option.
    beside
        Figures that a task adds; null where it has none.
    files
        Names.
    """

    rows: list[Row]
    more: list[int]
    late: int | msgspec.UnsetType = msgspec.UNSET
    beside: dict[str, float | None] = field(default_factory=dict, metadata=MERGED)
    files: list[str] = field(default_factory=list)


ROW = Row(with_="bff", error_mm=float("nan"))
FOUND = Found(rows=[ROW], more=[1, 2], beside={"p95_mm": 0.12345678, "worst_mm": float("inf")})


def test_plain_gives_keys_in_order_and_null_for_what_is_not_finite():
    assert plain(FOUND) == {
        "rows": [{"with": "bff", "error_mm": None}],
        "more": [1, 2],
        "p95_mm": 0.123457,
        "worst_mm": None,
        "files": [],
    }
    assert plain({"a": np.array([1.0, np.nan]), "b": Path("x")}) == {"a": [1.0, None], "b": "x"}


def test_plain_rounds_as_told():
    assert plain([5.1234567e-5, 123456789.0], significant) == [5.12346e-5, 123457000.0]


def test_field_texts_join_lines_and_share_words():
    assert field_texts(Row)["error_mm"] == "In millimetres; null where nothing was found."
    assert field_texts(Found)["more"] == field_texts(Found)["rows"] == "In order."


@pytest.fixture(scope="module")
def schema():
    return Draft202012Validator(result_schema("found", [Found]))


def test_schema_takes_what_plain_gives(schema):
    assert list(schema.iter_errors(plain(FOUND))) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"more": ["one"]},
        {"rows": [{"with": "bff"}]},
        {"rows": [{"with": None, "error_mm": 1.0}]},
        {"rows": [{"with": "bff", "error_mm": 1.0, "other": 1}]},
        {"late": None},
        {"worst_mm": "far"},
    ],
)
def test_schema_refuses_types_and_keys_that_are_not_the_results(schema, wrong):
    assert list(schema.iter_errors(plain(FOUND) | wrong))


def test_schema_without_room_for_more_is_closed():
    row = Draft202012Validator(result_schema("row", [Row]))
    assert list(row.iter_errors({"with": "bff", "error_mm": 1.0, "new": 1}))


def test_schema_refuses_a_field_without_words():
    @dataclass(frozen=True, kw_only=True, slots=True)
    class Mute:
        """Nothing is said of its field."""

        size: int

    with pytest.raises(TypeError, match=r"Mute.size is not described"):
        result_schema("mute", [Mute])


@click.command()
@click.option("--out", type=click.Path(path_type=Path))
@click.option("--accept", is_flag=True)
@click.option("--json", "as_json", is_flag=True)
def judge(out, accept, as_json):
    """A command whose result is never good."""

    def write(stage):
        (stage / "table.csv").write_text("1")
        return ["table.csv"]

    present(
        FOUND,
        lambda found: ["look:", Table(["with", "error"], [[row.with_, 1.0] for row in found.rows])],
        as_json=as_json,
        out=out,
        write=write,
        page=lambda stage: f"<p>{sorted(path.name for path in stage.iterdir())}</p>",
        verdict=Verdict("ambiguous", ["one reason"], accept),
    )


def test_present_refuses_with_a_page_alone_and_exit_3(tmp_path):
    result = CliRunner().invoke(judge, ["--out", str(tmp_path / "new"), "--json"])
    assert result.exit_code == 3
    assert json.loads(result.stdout)["files"] == ["refused.html"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["refused.html"]


def test_present_writes_all_of_an_accepted_result(tmp_path):
    result = CliRunner().invoke(judge, ["--out", str(tmp_path), "--accept"])
    assert result.exit_code == 0
    assert (tmp_path / "report.html").read_text() == "<p>['table.csv']</p>"
    lines = [line.strip() for line in result.stdout.splitlines()]
    assert [lines[0], *lines[-2:]] == [
        "look:", str(tmp_path / "table.csv"), str(tmp_path / "report.html"),
    ]  # fmt: skip
    assert any(line.split() == ["bff", "1"] for line in lines)
