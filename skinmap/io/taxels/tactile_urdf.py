"""Taxels in a URDF with the tactile extension of the ROS tactile toolbox.

`<sensor name><parent link/><origin xyz rpy/><tactile channel>` holds either one
`<array rows cols size spacing? offset? order?/>` or many `<taxel idx xyz rpy/>`. Poses are in the
sensor's frame, which `origin` places on the link; +z is the outward normal; `idx` is the place in
the live vector. Two attributes of ours on `<taxel>`, which others ignore, keep what the format has
no room for: `module`, and `normal` with every bit.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, OutputError, unknown_name, warn
from skinmap.geometry.rigid import rpy_matrix
from skinmap.io.safe_xml import attribute, children, local_name, read_xml
from skinmap.io.text import MAX_CHANNEL, digits, in_file, parse_floats, parse_whole
from skinmap.skin.taxels import TaxelTable

MAX_TAXELS = 100_000  # a short line of XML can ask for any number of them
ORDERS = {"row-major": True, "col-major": False, "column-major": False}
MARKER_RADIUS, MARKER_HEIGHT = "0.002", "0.0005"  # of the markers that viewers of a URDF draw [m]
SAME_DIRECTION = 1e-6  # between rpy and our exact normal; both come from the same numbers


def read_tactile_urdf(path: Path) -> TaxelTable:
    """Read the taxels of the one sensor of a URDF, in the frame of its link.

    Raises
    ------
    DataFormatError
        No URDF, no tactile sensor, several (see `read_tactile_sensors`), or one that is wrong.
    """
    tables = read_tactile_sensors(path)
    if len(tables) > 1:
        raise DataFormatError(
            f"holds several tactile sensors, make a file of each: {', '.join(tables)}", path
        )
    return next(iter(tables.values()))


def read_tactile_sensors(path: Path) -> dict[str, TaxelTable]:
    """Read all tactile sensors of a URDF: name to table, whose `link` is the sensor's parent.

    Raises
    ------
    DataFormatError
        No URDF, no tactile sensor, or one that is wrong (names the line).
    """
    root = read_xml(path, "a URDF file")
    if local_name(root) != "robot":
        raise DataFormatError(f"not a URDF: <{local_name(root)}>", path, root.sourceline)
    tables: dict[str, TaxelTable] = {}
    count = 0
    for element in children(root, "sensor"):
        tactile = children(element, "tactile")
        if not tactile:
            continue  # a camera, say
        name = attribute(element, "name", path)
        if name in tables:
            _warn(f"sensor {name!r} comes twice; the first one counts", path, element)
            continue
        with np.errstate(over="ignore", invalid="ignore"):  # the table refuses what is infinite
            tables[name] = _sensor(element, tactile[0], path, MAX_TAXELS - count)
        count += len(tables[name])
    if not tables:
        raise DataFormatError("no <sensor> with <tactile> in it", path)
    return tables


def _sensor(element: Any, tactile: Any, path: Path, most: int) -> TaxelTable:
    parents = children(element, "parent")
    if not parents:
        raise DataFormatError("<sensor> lacks <parent link=.../>", path, element.sourceline)
    link = attribute(parents[0], "link", path)
    taxels, arrays = children(tactile, "taxel"), children(tactile, "array")
    if not taxels and not arrays:
        raise DataFormatError("<tactile> has neither <taxel> nor <array>", path, tactile.sourceline)
    if arrays[1:] or (taxels and arrays):
        _warn("one <array> or many <taxel> are read; the rest is ignored", path, tactile)
    if len(taxels) > most:
        raise DataFormatError(f"more than {MAX_TAXELS} taxels", path, tactile.sourceline)
    if taxels:
        channels, modules, positions, normals = _taxels(taxels, path)
    else:
        channels, positions = _array(arrays[0], path, most)
        modules, normals = np.zeros_like(channels), np.tile([0.0, 0.0, 1.0], (len(channels), 1))
    origin = children(element, "origin")
    shift, rpy = _pose(origin[0], path) if origin else ([0.0] * 3, [0.0] * 3)
    if any(shift) or any(rpy):  # the identity is left out: it would cost the sign of zeros
        rotation = rpy_matrix(rpy)
        positions, normals = positions @ rotation.T + shift, normals @ rotation.T
    with in_file(path, tactile.sourceline):
        return TaxelTable(channels, modules, positions, normals, link=link)


def _taxels(elements: list[Any], path: Path) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Channels (n,), modules (n,), positions (n, 3) and normals (n, 3) of a list of taxels."""
    n = len(elements)
    channels, modules = np.empty(n, np.int64), np.empty(n, np.int64)
    positions, normals = np.empty((n, 3)), np.empty((n, 3))
    for row, element in enumerate(elements):
        line = element.sourceline
        words = [attribute(element, "idx", path), element.get("module", "0")]
        channels[row], modules[row] = parse_whole(words, path, line, most=MAX_CHANNEL)
        if channels[row] < 0:
            raise DataFormatError(f"idx starts at 0, got {channels[row]}", path, line)
        positions[row], rpy = _pose(element, path)
        normals[row] = rpy_matrix(rpy)[:, 2]
        if element.get("normal") is not None:
            exact = np.array(_numbers(element, "normal", 3, path))
            length = float(np.linalg.norm(exact))
            if length > 0 and np.abs(exact / length - normals[row]).max() > SAME_DIRECTION:
                raise DataFormatError("normal and rpy disagree", path, line)
            normals[row] = exact
    return channels, modules, positions, normals


def _array(element: Any, path: Path, most: int) -> tuple[IntArray, FloatArray]:
    """Channels (n,) and positions (n, 3): rows run along x, columns along y."""
    line = element.sourceline
    words = [attribute(element, "rows", path), attribute(element, "cols", path)]
    rows, cols = parse_whole(words, path, line)
    if rows < 1 or cols < 1:
        raise DataFormatError(f"rows and cols start at 1, got {rows} and {cols}", path, line)
    if rows * cols > most:
        raise DataFormatError(f"{rows} x {cols}: more than {MAX_TAXELS} taxels", path, line)
    order = element.get("order", "row-major")
    if order not in ORDERS:
        raise DataFormatError(unknown_name("order", order, ORDERS), path, line)
    has_spacing = element.get("spacing") is not None
    spacing = _numbers(element, "spacing" if has_spacing else "size", 2, path)
    offset = _numbers(element, "offset", 2, path, "0 0")
    channels = np.arange(rows * cols)
    if ORDERS[order]:
        row, col = channels // cols, channels % cols
    else:
        row, col = channels % rows, channels // rows
    x, y = row * spacing[0] - offset[0], col * spacing[1] - offset[1]
    return channels, np.column_stack([x, y, np.zeros(len(channels))])


def _pose(element: Any, path: Path) -> tuple[list[float], list[float]]:
    return _numbers(element, "xyz", 3, path, "0 0 0"), _numbers(element, "rpy", 3, path, "0 0 0")


def _numbers(
    element: Any, name: str, count: int, path: Path, default: str | None = None
) -> list[float]:
    words = (element.get(name) or default or attribute(element, name, path)).split()
    if len(words) != count:
        raise DataFormatError(
            f"{name} needs {count} numbers, got {len(words)}", path, element.sourceline
        )
    return parse_floats(words, path, element.sourceline)


def _warn(message: str, path: Path, element: Any) -> None:
    warn(f"{path}:{element.sourceline}: {message}", above=2)


def write_tactile_urdf(
    sensors: Mapping[str, TaxelTable], path: Path, *, robot: str = "skin"
) -> None:
    """Write a URDF with the tactile extension: one sensor a table, all on one link.

    +z of a taxel is its normal. `module` and `normal` are attributes of ours, which others ignore;
    they keep what an angle cannot: the last bits, a length that is not 1, and zero.

    Parameters
    ----------
    sensors : mapping of str to TaxelTable
        Sensor name to its taxels, in the frame of the table's link ("base" where it has none).
        One link only: links without the joints between them are no robot.
    path : Path
        The file.
    robot : str
        Name of the robot.

    Raises
    ------
    OutputError
        No sensor or taxel, several links, or a name that XML cannot hold.
    """
    links = {table.link or "base" for table in sensors.values()}
    if len(links) != 1:
        raise OutputError(f"a tactile URDF needs sensors on one link, got {sorted(links)}")
    (link,) = links
    root = ET.Element("robot", name=_xml_name(robot))
    ET.SubElement(root, "link", name=_xml_name(link))
    for name, table in sensors.items():
        if len(table) == 0:
            raise OutputError("no taxel to write")
        sensor = ET.SubElement(root, "sensor", name=_xml_name(name), update_rate="50.0")
        ET.SubElement(sensor, "parent", link=link)
        ET.SubElement(sensor, "origin", xyz="0 0 0", rpy="0 0 0")
        tactile = ET.SubElement(sensor, "tactile", channel=name)
        for channel, module, position, normal in zip(
            table.channels, table.modules, table.positions, table.normals, strict=True
        ):
            taxel = ET.SubElement(
                tactile,
                "taxel",
                idx=str(channel),
                xyz=digits(position),
                rpy=digits(_angles(normal.tolist())),
                module=str(module),
                normal=digits(normal),
            )
            geometry = ET.SubElement(taxel, "geometry")  # the format wants one
            ET.SubElement(geometry, "cylinder", radius=MARKER_RADIUS, length=MARKER_HEIGHT)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _angles(normal: list[float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] that turn +z to a normal of any length; none for a normal of zero."""
    x, y, z = normal
    return 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)


def _xml_name(name: str) -> str:
    if not name or not name.isprintable():
        raise OutputError(f"a URDF cannot hold the name {name!r}")
    return name
