"""The README's commands run in a fresh folder; so does the way to a picture of one's robot."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.display import require_opengl

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LASTING = re.compile(r"--(?:web|publish)\b")  # run until they are stopped; tests of their own
LINES = [
    line for line in re.findall(r"^    (skinmap .*)$", README, re.M) if not LASTING.search(line)
]
MOST_COMMANDS = 4  # from nothing to a picture
MOST_SECONDS = 60.0  # of CPU


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A folder with what the README's commands read."""
    require_opengl()
    folder = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "docs" / "examples", folder / "docs" / "examples")
    return folder


def run(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    here = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    return subprocess.run(words, cwd=folder, env=here, capture_output=True, text=True, timeout=300)


@pytest.mark.usefixtures("hurried")
def test_commands_of_the_readme_run_one_after_another(clone, monkeypatch):
    assert len(LINES) >= 10
    monkeypatch.chdir(clone)
    for line in LINES:  # in this process; those of the script below have one each
        done = CliRunner().invoke(cli, shlex.split(line)[1:])
        assert done.exit_code == 0, f"{line}\n{done.output}\n{done.exception!r}"
    assert (clone / "mine.png").stat().st_size > 10_000


def test_own_touches_of_the_readme_come_from_two_sessions_and_two_people():
    """So `evaluate --leave-out session` and `person` have something to leave out."""
    recorded = [shlex.split(line) for line in LINES if "--label" in line]
    labels = {words[words.index("--label") + 1] for words in recorded}
    for option in ("--session", "--person"):
        groups = {words[words.index(option) + 1] for words in recorded}
        assert len(groups) >= 2
        assert len(recorded) == len(groups) * len(labels)


def test_own_robot_takes_four_commands_and_a_minute(clone, tmp_path):
    script = clone / "docs" / "examples" / "own_robot.sh"
    assert len(re.findall(r"^skinmap ", script.read_text(), re.M)) <= MOST_COMMANDS
    before = os.times()
    done = run(["bash", str(script), str(tmp_path / "mine")], clone)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine" / "touches.png").stat().st_size > 10_000
    after = os.times()
    spent = after.children_user + after.children_system
    assert spent - before.children_user - before.children_system < MOST_SECONDS
