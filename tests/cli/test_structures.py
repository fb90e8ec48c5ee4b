"""`skinmap structures`: options, pictures, one JSON object, one line for bad input."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli


def run(*arguments: str):
    return CliRunner().invoke(cli, ["structures", *arguments])


def test_kaspar_has_the_four_structures_of_its_modules():
    result = run("kaspar", "--part", "right_hand", "--radius-mm", "auto", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["structures"] == 4
    assert found["taxels"] == 144
    assert found["radius_is"] == "auto"
    assert 7.64 < found["radius_mm"] < 10.0  # between the rings of a 12-pad sheet
    assert sum(row["taxels"] for row in found["table"]) == 144
    assert found["without_structure"] == 0


def test_pictures_are_written_beside_the_numbers(tmp_path):
    result = run(
        "kaspar", "--part", "left_hand", "--out", str(tmp_path / "out"), "--distance", "geodesic"
    )
    assert result.exit_code == 0, result.output
    files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert files == ["structures.png", "structures_body.png"]
    for path in (tmp_path / "out").iterdir():
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.name in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--radius-mm", "wide"), "must lie in 0.1..1000, or auto, got 'wide'"),
        (("--radius-mm", "-3"), "must lie in 0.1..1000, or auto"),
        (("--radius-mm", "nan"), "must lie in 0.1..1000, or auto"),
        (("--tolerance-mm", "0"), "0.0 is not in the range 0<x<="),
        (("--rotations", "5"), "'5' is not one of '1', '4', '6'"),
        (("--distance", "taxi"), "'taxi' is not one of"),
    ],
)
def test_nonsense_is_refused(arguments, message):
    result = run("kaspar", "--part", "left_foot", *arguments)
    assert result.exit_code == 2
    assert message in result.output
