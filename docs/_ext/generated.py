"""Text that is made and not written: a comment in a page names it, the build fills it in.

`<!-- generated: modules skinmap.flat -->` stands for the interface of every module of a package,
`public` for what `import skinmap` offers, `commands` for all commands and their options, and
`contents name ...` for a table of contents of the pages that exist (a page that another command
has yet to write leaves no hole); `contents rest` for the pages that no other one lists.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from api_pages import drop_guesses, escape_docstring, modules_text, public_text
from command_pages import commands_text

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MARK = re.compile(r"^<!-- generated: (\w+) ?(.*?) -->$", flags=re.MULTILINE)


def contents(folder: Path, names: list[str]) -> str:
    """A table of contents of those pages that exist."""
    if names == ["rest"]:
        listed = set(re.findall(r"[\w/-]+", " ".join(_lists(folder))))
        names = sorted({page.stem for page in folder.glob("*.md")} - listed - {"index", "rest"})
    found = [name for name in names if any(folder.glob(f"{name}.*"))]
    lines = "\n".join(found)
    return f"```{{toctree}}\n:maxdepth: 1\n\n{lines}\n```" if found else ""


def _lists(folder: Path) -> list[str]:
    """What the pages list by hand and by our comments."""
    texts = [page.read_text() for page in folder.glob("*.md")]
    found = [names for text in texts for kind, names in MARK.findall(text) if kind == "contents"]
    for text in texts:
        found += re.findall(r"```\{toctree\}\n(.*?)```", text, flags=re.DOTALL)
    return found


def fill_in(app: Sphinx, docname: str, source: list[str]) -> None:
    """Replace the comments of one page."""
    folder = (Path(app.srcdir) / docname).parent
    makers = {
        "commands": lambda _: commands_text(),
        "contents": lambda words: contents(folder, words),
        "modules": lambda words: modules_text(*words),
        "public": lambda _: public_text(),
    }
    source[0] = MARK.sub(lambda mark: makers[mark[1]](mark[2].split()), source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", fill_in)
    app.connect("autodoc-process-docstring", escape_docstring)
    app.connect("doctree-read", drop_guesses)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
