"""Check built pages: local links and pictures lead somewhere, nothing is fetched from elsewhere.

python scripts/check_links.py build/docs
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# What a browser fetches by itself; a link that a person may follow (<a>) is no such thing.
FETCHED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src")}
NAMED_ONLY = {"canonical", "search", "index", "next", "prev", "author", "copyright"}


class Page(HTMLParser):
    """The links and the named places of one page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[tuple[str, bool]] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what one tag links to or names."""
        values = dict(attrs)
        self.places |= {value for key in ("id", "name") if (value := values.get(key))}
        for key in ("href", "src"):
            if (link := values.get(key)) is not None:
                fetched = (tag, key) in FETCHED and values.get("rel") not in NAMED_ONLY
                self.links.append((link, fetched))


def faults(folder: Path) -> list[str]:
    """A line for each link that leads nowhere and each file that is fetched from elsewhere."""
    pages = {
        path.resolve(): Page(path.read_text(encoding="utf-8")) for path in folder.rglob("*.html")
    }
    found = []
    for path, page in pages.items():
        for link, fetched in page.links:
            parts = urlsplit(link)
            where = f"{path.relative_to(folder.resolve())}: {link}"
            if parts.scheme or parts.netloc:
                if fetched and parts.scheme != "data":
                    found.append(f"{where} is fetched from elsewhere")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file():
                found.append(f"{where} leads nowhere")
                continue
            places = pages[target].places if target in pages else set()
            if parts.fragment and places and unquote(parts.fragment) not in places:
                found.append(f"{where} names no place there")
    return found


def main() -> int:
    """Print the faults; 1 where there are any."""
    folder = Path(sys.argv[1])
    if not any(folder.rglob("*.html")):
        print(f"no pages in {folder}", file=sys.stderr)
        return 1
    found = faults(folder)
    for line in found:
        print(line, file=sys.stderr)
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
