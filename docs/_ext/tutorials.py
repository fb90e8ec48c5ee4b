"""A tutorial is a script that runs; its page is the same file.

Lines that begin with `# ` after a line `# %%` are Markdown, everything else is code. What the
script prints and draws was written by `make tutorials`: pictures beside it as Markdown links.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from docutils import nodes
from myst_parser.sphinx_ import Parser

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def as_markdown(script: str) -> str:
    """The page of a script.

    A cell begins with a line `# %%`. Its leading comment lines are the text.
    """
    blocks = []
    for cell in re.split(r"^# %%.*\n", script, flags=re.MULTILINE):
        lines = cell.rstrip().split("\n")
        head = 0
        while head < len(lines) and (lines[head] == "#" or lines[head].startswith("# ")):
            head += 1
        text = "\n".join(line[2:] for line in lines[:head])
        code = "\n".join(lines[head:]).strip("\n")
        if code.startswith('"""'):  # the docstring of the script is its title
            title, _, code = code.removeprefix('"""').partition('"""')
            text = f"# {title.strip()}"
            code = code.strip("\n")
        blocks += [text, ""]
        if code:
            blocks += ["```python", code, "```", ""]
    return "\n".join(blocks)


class TutorialParser(Parser):
    """Markdown out of a script, then as any page."""

    supported = ("tutorial",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a script."""
        super().parse(as_markdown(inputstring), document)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_source_suffix(".py", "tutorial")
    app.add_source_parser(TutorialParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
