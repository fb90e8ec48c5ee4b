"""Pages are plain English: no program speaks, no clause with "what" or "who" is a subject."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Pages that are exempt; none is added.
OLDER = {"reliability"}  # written by `make reliability`, with a column "said"
PAGES = [
    ROOT / "README.md",
    *(p for p in sorted((ROOT / "docs").glob("*.md")) if p.stem not in OLDER | {"writing"}),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
IDIOMS = {
    "a program speaks": r"\b(?:says|tells|said|told)\b",
    "a negated noun": r"\b(?:is|are) no\b",
    "a clause as the subject": r"(?:^|\. |\| )(?:What|Who) (?![^.|]*\?)[a-z]",
}


def findings(text: str) -> list[str]:
    """Idioms of a page outside its code, each with its line."""
    prose = re.sub(r"```.*?```|`[^`\n]*`|^    .*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    return [
        f"{name}: {line.strip()}"
        for line in prose.splitlines()
        for name, idiom in IDIOMS.items()
        if re.search(idiom, line)
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_is_plain_english(page):
    assert findings(page.read_text(encoding="utf-8")) == []


def test_idioms_are_found():
    page = "It says so.\n\nWhat is left joins one.\n\nThat is no touch.\n\n    a command says\n"
    assert len(findings(page)) == 3
    assert findings("**What happens?** They are left out. `says`\n") == []


def test_older_pages_exist():
    assert all((ROOT / "docs" / f"{page}.md").is_file() for page in OLDER)
