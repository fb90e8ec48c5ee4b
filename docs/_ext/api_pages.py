"""The interface of a package, module by module, out of its docstrings."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from typing import TYPE_CHECKING

from sphinx import addnodes

import skinmap

if TYPE_CHECKING:
    from docutils import nodes

CODE = re.compile(r"(``.*?``|`.*?`)")
SPECIAL = re.compile(r"(\*|\||(?<=\w)_(?!\w))")  # emphasis, substitution, a link


def modules_text(package: str, *only: str) -> str:
    """Headings and autodoc directives, one module each; `only` names those that are wanted."""
    root = importlib.import_module(package)
    names = [f"{package}.{name}" for name in only]
    if not only:
        names = [
            info.name
            for info in pkgutil.iter_modules(root.__path__, f"{package}.")
            if not info.ispkg
        ]
    blocks = []
    for name in names:
        blocks += [f"## {name}", "", "```{eval-rst}", f".. automodule:: {name}"]
        blocks += ["   :members:", "   :show-inheritance:", "```", ""]
    return "\n".join(blocks)


def public_text() -> str:
    """What `import skinmap` offers: the names themselves, then what they return and raise."""
    errors, blocks = [], []
    public = set(skinmap.__all__) - {"__version__", "errors"}
    names = [*sorted(public, key=str.lower), *sorted(set(dir(skinmap)) - public, key=str.lower)]
    for name in names:
        thing = getattr(skinmap, name)
        if isinstance(thing, type) and issubclass(thing, (Exception, Warning)):
            errors.append(f"`{name}`")
        elif callable(thing):
            kind = "class" if inspect.isclass(thing) else "function"
            place = f"{thing.__module__}.{thing.__qualname__}"
            blocks += [f"## {name}", "", "```{eval-rst}", f".. auto{kind}:: {place}"]
            blocks += ["   :members:"] if kind == "class" else []
            blocks += ["   :no-index:", "```", ""]
    listed = ", ".join(errors)
    return "\n".join([*blocks, "## Errors", "", f"All derive from `SkinError`: {listed}."])


def escape_docstring(
    app: object, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Keep formulas as they are typed: our docstrings have no markup but backticks."""
    for place, line in enumerate(lines):
        if line.lstrip().startswith((":", "..")):  # what napoleon made of a section
            head, _, rest = line.partition(": ")
            lines[place] = f"{head}: {_escape(rest)}" if rest else line
        else:
            lines[place] = _escape(line)


def drop_guesses(app: object, doctree: nodes.document) -> None:
    """Words of a type (`faces`, `Scene`) are no names: Sphinx would link them to some namesake."""
    for guess in list(doctree.findall(addnodes.pending_xref)):
        if guess.get("refdomain") == "py" and "." not in guess.get("reftarget", ""):
            guess.replace_self(guess.children)


def _escape(text: str) -> str:
    pieces = CODE.split(text)
    return "".join(
        piece if k % 2 else SPECIAL.sub(r"\\\1", piece) for k, piece in enumerate(pieces)
    )
