"""Writing taxel tables in the formats of others, so that reading them back changes nothing.

Numbers are written with as many digits as their bits need. CSV, our own format, is in
`skinmap.io.taxels.taxel_table`.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import OutputError
from skinmap.io.taxels.icub import CHANNELS_PER_MODULE
from skinmap.skin.taxels import ABSENT, THERMAL, TaxelTable

CENTRE_SLOT = 3  # stands for its module in the files of the iCub
CHANNELS_PER_STRIP = 192  # live vectors of the iCub come in multiples of it
MAX_CHANNELS = 100_000  # rows of an iCub file, also those without a taxel; the largest has 1344
MARKER_RADIUS, MARKER_HEIGHT = "0.002", "0.0005"  # of the markers that viewers of a URDF draw [m]


def write_icub(table: TaxelTable, path: Path, *, name: str | None = None) -> None:
    """Write a position file of the iCub: one row a channel, zeros where there is no taxel.

    Parameters
    ----------
    table : TaxelTable
        Its modules must be channel div 12 and no taxel may lie exactly in the origin: the format
        has no room for either.
    path : Path
        The file.
    name : str, optional
        What the header calls it, one word: the link that the positions are in. The table's own
        link if not given.

    Raises
    ------
    OutputError
        A table that the format cannot hold (names the taxel), or a name of several words.
    """
    word = name or table.link or "skin"
    if len(word.split()) != 1 or not word.isprintable():
        raise OutputError(f"an iCub file needs a name of one word, got {word!r}")
    _check_icub(table)
    rows = (int(table.channels[-1]) // CHANNELS_PER_STRIP + 1) * CHANNELS_PER_STRIP
    values = np.zeros((rows, 6))
    values[table.channels] = np.column_stack([table.positions, table.normals])
    representatives = " ".join(str(value) for value in _representatives(table, rows))
    lines = [
        f"name {word}",
        "spatial_sampling taxel",
        f"taxel2Repr ( {representatives} )",
        "[calibration]",
        *(_numbers(row) for row in values),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _check_icub(table: TaxelTable) -> None:
    _check_not_empty(table)
    if table.channels[-1] >= MAX_CHANNELS:
        raise OutputError(
            f"channel {table.channels[-1]}: an iCub file has a row for each channel below it, "
            f"at most {MAX_CHANNELS}; write csv"
        )
    other = table.modules != table.channels // CHANNELS_PER_MODULE
    if other.any():
        raise OutputError(
            f"channel {table.channels[other][0]} is of module {table.modules[other][0]}; in an "
            f"iCub file modules are channel div {CHANNELS_PER_MODULE}; write csv"
        )
    zero = ~table.positions.any(axis=1)
    if zero.any():
        raise OutputError(
            f"channel {table.channels[zero][0]} lies in the origin, which means 'no taxel' in an "
            f"iCub file; write csv"
        )


def _representatives(table: TaxelTable, rows: int) -> IntArray:
    """(rows,) the centre of each taxel's module, else its first taxel; -1 and -2 as they came."""
    stated = np.full(rows, ABSENT)
    tactile = table.channels[~np.isin(table.representative, (ABSENT, THERMAL))]
    modules, first = np.unique(tactile // CHANNELS_PER_MODULE, return_index=True)
    centres = modules * CHANNELS_PER_MODULE + CENTRE_SLOT
    stands_for = np.where(np.isin(centres, tactile), centres, tactile[first])
    stated[tactile] = stands_for[np.searchsorted(modules, tactile // CHANNELS_PER_MODULE)]
    thermal = table.representative == THERMAL
    stated[table.channels[thermal]] = THERMAL
    return stated


def write_tactile_urdf(
    sensors: Mapping[str, TaxelTable], path: Path, *, robot: str = "skin", update_rate: float = 50.0
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
    update_rate : float
        Samples a second that the sensors state.

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
        _check_not_empty(table)
        sensor = ET.SubElement(root, "sensor", name=_xml_name(name), update_rate=repr(update_rate))
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
                xyz=_numbers(position),
                rpy=_numbers(_angles(normal.tolist())),
                module=str(module),
                normal=_numbers(normal),
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


def _check_not_empty(table: TaxelTable) -> None:
    if len(table) == 0:
        raise OutputError("no taxel to write")


def _numbers(values: Iterable[float]) -> str:
    """The shortest digits that give the same bits back."""
    return " ".join(repr(float(value)) for value in values)
