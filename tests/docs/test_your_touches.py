"""The page that goes from a stream to a judged classifier does what it says, line by line."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import SkinError

PAGE = Path(__file__).parents[2] / "docs" / "your_touches.md"
LINES = re.findall(r"^    skinmap (.+)$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)


def run(line: str, keys: str | None = None) -> str:
    result = CliRunner().invoke(cli, shlex.split(line), input=keys)
    assert result.exit_code == 0, (line, result.output, result.exception)
    return result.output


@pytest.fixture(scope="module")
def said(tmp_path_factory, hurried_module):
    """What each line of the page prints, in the order of the page; pictures are drawn elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("own"))
        found = {}
        for line in LINES:
            if line.startswith("view"):
                continue
            keys = "n rub\nd\nw\n" if line == "label a.mcap -o a2.mcap" else None
            found[line] = run(line, keys)
        found["names"] = sorted(path.name for path in Path.cwd().iterdir())
        message = CliRunner().invoke(cli, ["label", "a.mcap", "-o", "a.mcap", "--force"])
        assert isinstance(message.exception, SkinError)
        found["over"] = str(message.exception)
    return found


def one(said, start):
    return next(text for line, text in said.items() if line.startswith(start))


def test_page_shows_what_it_promises():
    shown = " ".join(LINES)
    for words in ("--label poke", "--label edge", "train a.mcap b.mcap",
                  "evaluate a.mcap b.mcap --leave-out session", "view "):  # fmt: skip
        assert words in shown


def test_record_counts_touches_and_labels(said):
    assert re.search(r"1[0-9]|2[0-9] touches: \d+ poke", one(said, "record sim:poke"))
    assert "edge" in one(said, "record sim:edge")


def test_label_writes_new_files_only(said):
    assert {"a2.mcap", "a3.mcap", "all.mcap", "mine.skinmodel", "touches.csv"} <= set(said["names"])
    assert "1 rub" in one(said, "label a.mcap -o a2.mcap")
    assert "it is the recording" in said["over"]


def test_train_warns_of_labels_of_one_session(said):
    first = one(said, "train a.mcap b.mcap -o")
    assert "warning: recorded in one session only: poke (monday), edge (monday)" in first
    last = one(said, "train a.mcap b.mcap c.mcap")
    assert "sessions:" in last
    assert "people:" in last
    assert "warning" not in last


def test_evaluate_finds_that_one_session_means_nothing_and_two_do(said):
    alone = one(said, "evaluate a.mcap b.mcap --leave-out")
    assert "all touches are of one session (monday): none can be left out" in alone
    assert "with touches dealt out means nothing" in alone
    both = one(said, "evaluate a.mcap b.mcap c.mcap")
    assert re.search(r"session: \d+\.\d % with a session left out means something", both)
    assert "with touches dealt out is doubtful: raw values before the touches name" in both
