"""`skinmap info` without a recording."""

from __future__ import annotations

import json
import socket
from importlib.metadata import distribution

from click.testing import CliRunner

import skinmap.cli.info
from skinmap.cli.main import cli


def run(*words: str):
    return CliRunner().invoke(cli, ["info", *words])


def test_versions_and_extras_are_those_installed():
    done = run("--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert told["packages"]["numpy"] == distribution("numpy").version
    extras = {one["name"]: one for one in told["extras"]}
    assert {"scan", "mujoco", "torch", "fast"} <= extras.keys()
    for one in extras.values():
        assert one["installed"] == all(one["packages"].values())


def test_missing_extra_and_library_come_with_the_line_that_installs_them(monkeypatch):
    monkeypatch.setattr(skinmap.cli.info, "installed", lambda package: None)
    monkeypatch.setattr(skinmap.cli.info, "loads_library", lambda name: False)
    monkeypatch.setattr(skinmap.cli.info, "has_display", lambda: False)
    output = run().output
    assert "pip install 'skinmap[mujoco]'" in output
    assert "numpy missing" in output
    assert "apt-get install -y libgl1 libegl1" in output


def test_port_that_another_program_holds_is_in_use(monkeypatch):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        monkeypatch.setattr(skinmap.cli.info, "PORTS", {port: "view --web"})
        assert f"{port} (view --web) in use" in run().output
    assert f"{port} (view --web) free" in run().output


def test_robot_without_a_recording_is_refused():
    done = run("--robot", "icub")
    assert done.exit_code == 2
    assert "--robot needs a RECORDING" in done.output
