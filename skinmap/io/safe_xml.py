"""XML that comes from anywhere, without entities, document types, inclusions or a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skinmap.errors import DataFormatError
from skinmap.io.text import MAX_BYTES, check_file

FORBIDDEN = (b"<!DOCTYPE", b"<!ENTITY")  # the door of entity bombs and of external references
MAX_TAGS = 200_000  # the parsed tree takes some 500 bytes for each
INCLUDE = "{http://www.w3.org/2001/XInclude}"


def read_xml(path: Path, expected: str, most_bytes: int = MAX_BYTES) -> Any:
    """The root element (lxml) of an XML file, comments left out.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not XML (names the line), or one with a document type, entities or
        inclusions: those can make a small file huge, or read other files.
    """
    from lxml import etree

    check_file(path, expected, most_bytes)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataFormatError(f"cannot be read: {error.strerror}", path) from None
    if b"\0" in data:
        raise DataFormatError(f"not {expected}: holds NUL bytes; expected UTF-8", path)
    for word in FORBIDDEN:
        if word in data:
            line = data[: data.index(word)].count(b"\n") + 1
            raise DataFormatError(f"{word.decode()} is not allowed (entities)", path, line)
    if data.count(b"<") > MAX_TAGS:
        raise DataFormatError(f"more than {MAX_TAGS} tags", path)
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        where = getattr(error, "lineno", None) or None
        raise DataFormatError(f"not {expected}: {error}", path, where) from None
    # An encoding can hide the words above from a search in bytes, not from the parser.
    if root.getroottree().docinfo.doctype or root.getroottree().docinfo.internalDTD is not None:
        raise DataFormatError("a document type is not allowed (entities)", path)
    for element in root.iter(f"{INCLUDE}*"):
        raise DataFormatError("XInclude is not allowed", path, element.sourceline)
    return root


def local_name(element: Any) -> str:
    """Name of an element without its namespace; "" for what is no element (an entity)."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def children(element: Any, name: str) -> list[Any]:
    """Child elements of a name, whatever their namespace."""
    return [child for child in element if local_name(child) == name]


def attribute(element: Any, name: str, path: Path) -> str:
    """An attribute that must be there and not be empty.

    Raises
    ------
    DataFormatError
        It is not (names the line).
    """
    value = element.get(name)
    if not value:
        raise DataFormatError(f"<{local_name(element)}> lacks {name!r}", path, element.sourceline)
    return str(value)
