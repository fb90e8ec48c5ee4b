"""The page's own files, and its scripts joined into one."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources

TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
START = "main"  # the script that brings all others
IMPORT = re.compile(r'^import \{([^}]*)\} from "\./(\w+)\.js";\n', re.M)
EXPORT = re.compile(r"^export (?=(?:async )?(?:const|function|class) ([\w$]+))", re.M)


@cache
def page_files(place: str = "web/page") -> dict[str, tuple[str, bytes]]:
    """Type and content of each of a page's files by name; "" is the page itself."""
    folder = resources.files("viewer") / place
    files = {entry.name: entry for entry in folder.iterdir() if entry.is_file()}
    found = {
        name: (f"{TYPES[suffix]}; charset=utf-8", entry.read_bytes())
        for name, entry in sorted(files.items())
        if (suffix := name.rpartition(".")[2]) in TYPES
    }
    found[""] = found.pop("index.html")
    return found


@cache
def served_files() -> dict[str, tuple[str, bytes]]:
    """What is served, by name: the same with all scripts as one, for one answer to bring them."""
    served = {n: file for n, file in page_files().items() if not n.endswith(".js")}
    kind = page_files()[f"{START}.js"][0]
    return served | {f"{START}.js": (kind, joined_scripts().encode())}


def page_text(name: str) -> str:
    """One of the page's files; "" is the page itself."""
    return page_files()[name][1].decode()


def joined_scripts() -> str:
    """All scripts as one that imports nothing: each a function that gives what it exports.

    A page that is opened from a file may not load modules, not even those beside it.
    """
    written: dict[str, str] = {}
    _write(START, written)
    return '"use strict";\n' + "\n".join(written.values())


def _write(name: str, written: dict[str, str]) -> None:
    """Add a script behind those that it imports."""
    text = page_text(f"{name}.js")
    for _, other in IMPORT.findall(text):
        if other not in written:
            _write(other, written)
    body = IMPORT.sub(lambda found: f"const {{{found[1]}}} = ${found[2]};\n", text)
    given = ", ".join(EXPORT.findall(text))
    body = EXPORT.sub("", body)
    written[name] = f"const ${name} = (() => {{\n{body}return {{ {given} }};\n}})();"
