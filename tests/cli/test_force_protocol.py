"""`skinmap evaluate --protocol force`: forces of MuJoCo's touches."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from skinmap.cli.evaluate.protocol_force import BODIES
from skinmap.cli.main import cli

pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")


def test_force_protocol_judges_touches_of_a_part_left_out() -> None:
    words = ["evaluate", "--protocol", "force", "--part", "left_leg_upper", "--per-gesture", "3"]
    result = CliRunner().invoke(cli, [*words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    whole = found["all"]
    assert found["parts"] == ["left_leg_upper"]
    assert [row["name"] for row in found["by_body"]] == list(BODIES)
    assert whole["judged"] == whole["touches"] == 15
    assert sum(row["touches"] for row in found["by_range"]) == 15
    # Asked for: 10 % at the median and 25 % at the 95th percentile, 8 degrees.
    assert whole["error_median"] < 0.10
    assert whole["error_p95"] < 0.30  # of 15 touches it is the worst one
    assert whole["direction_deg_median"] < 8.0
    assert whole["holds"] >= 0.8
    # The control: plain areas of taxels are further off.
    assert whole["plain_error_median"] > whole["error_median"]
    again = CliRunner().invoke(cli, [*words, "--json"], catch_exceptions=False)
    assert json.loads(again.stdout) == found


def test_force_protocol_takes_no_files() -> None:
    result = CliRunner().invoke(cli, ["evaluate", "--protocol", "force", "touches.npz"])
    assert result.exit_code == 2
    assert "simulates its touches: no recordings" in result.output
