"""What a URDF must be before a library walks it: one tree of links, and numbers that are numbers.

A circle of joints makes a walk to the root endless, a second parent is silently dropped by some
readers, and a wrong count of numbers fails long after the line that is wrong.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skinmap.errors import DataFormatError
from skinmap.io.safe_xml import attribute, children, local_name, read_xml
from skinmap.io.text import parse_floats

# A humanoid has some hundred links, ten deep. Poses take the cube of a chain's length.
MAX_LINKS, MAX_DEPTH = 2_000, 200
NUMBERS = {
    ("origin", "xyz"): (3,),
    ("origin", "rpy"): (3,),
    ("axis", "xyz"): (3,),
    ("mesh", "scale"): (1, 3),
    ("limit", "lower"): (1,),
    ("limit", "upper"): (1,),
    ("mimic", "multiplier"): (1,),
    ("mimic", "offset"): (1,),
}


def read_urdf(path: Path) -> Any:
    """The root element (lxml) of a URDF whose links form one tree.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, unsafe XML, no URDF, or links and joints that are no tree (says which line).
    """
    root = read_xml(path, "a URDF file")
    if local_name(root) != "robot":
        raise DataFormatError(f"not a URDF: <{local_name(root)}>", path, root.sourceline)
    links = _names(root, "link", path)
    if not links:
        raise DataFormatError("not a URDF: no <link> with a name", path, root.sourceline)
    joints = _names(root, "joint", path)
    parents: dict[str, str] = {}
    for joint in joints.values():
        parent, child = _ends(joint, links, path)
        if child in parents:
            raise DataFormatError(
                f"not a URDF: link {child!r} has two parents", path, joint.sourceline
            )
        parents[child] = parent
    _check_tree(links, parents, path)
    for element in [*links.values(), *joints.values()]:
        _check_numbers(element, path)
    return root


def _names(root: Any, kind: str, path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for element in children(root, kind):
        name = element.get("name")
        if not name:
            raise DataFormatError(f"not a URDF: <{kind}> lacks 'name'", path, element.sourceline)
        if name in found:
            raise DataFormatError(f"two {kind}s are called {name!r}", path, element.sourceline)
        found[name] = element
    if len(found) > MAX_LINKS:
        raise DataFormatError(f"{len(found)} {kind}s, at most {MAX_LINKS} are read", path)
    return found


def _ends(joint: Any, links: dict[str, Any], path: Path) -> tuple[str, str]:
    ends = []
    for end in ("parent", "child"):
        elements = children(joint, end)
        if not elements:
            raise DataFormatError(f"not a URDF: <joint> lacks <{end}>", path, joint.sourceline)
        link = attribute(elements[0], "link", path)
        if link not in links:
            raise DataFormatError(
                f"not a URDF: {end} link {link!r} does not exist", path, elements[0].sourceline
            )
        ends.append(link)
    return ends[0], ends[1]


def _check_tree(links: dict[str, Any], parents: dict[str, str], path: Path) -> None:
    """Every link must reach the one link without a parent, in not too many joints."""
    depths: dict[str, int] = {}
    for start in links:
        way: dict[str, None] = {}  # from the link towards the root, up to where it is known
        link = start
        while link in parents and link not in depths:
            if link in way:
                circle = " > ".join([*list(way)[list(way).index(link) :], link])
                raise DataFormatError(f"not a URDF: joints go in a circle: {circle}", path)
            way[link] = None
            link = parents[link]
        depth = depths.setdefault(link, 0)
        for link in reversed(way):
            depth += 1
            depths[link] = depth
        if depth > MAX_DEPTH:
            raise DataFormatError(
                f"a chain of {depth} joints ends at {start!r}, at most {MAX_DEPTH} are read", path
            )
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise DataFormatError(
            f"not a URDF: several links without a parent: {', '.join(roots[:10])}", path
        )


def _check_numbers(element: Any, path: Path) -> None:
    for part in element.iter():
        kind = local_name(part)
        if kind == "mesh":
            attribute(part, "filename", path)
        for (owner, name), counts in NUMBERS.items():
            text = part.get(name) if kind == owner else None
            if text is None:
                continue
            values = parse_floats(text.replace(",", " ").split(), path, part.sourceline)
            if len(values) not in counts:
                wanted = " or ".join(str(count) for count in counts)
                raise DataFormatError(
                    f"{name} needs {wanted} numbers, got {len(values)}", path, part.sourceline
                )
            # The iCub's own file gives its fixed joints such an axis; it turns nothing there.
            if kind == "axis" and not any(values) and element.get("type") != "fixed":
                raise DataFormatError("an axis of length zero", path, part.sourceline)
