"""Drawings as DXF of release 2000 in millimetres, which programs for CAD and cutters open."""

from __future__ import annotations

from collections.abc import Iterator

from skinmap.report.vectors import Drawing, Mark, Shape, Stroke, Words

MILLIMETRES = 4  # of $INSUNITS
CENTRED = {"start": 0, "middle": 1, "end": 2}
Pair = tuple[int, object]  # group code and value
# Tables and blocks that the release asks for, with what has to be in each of them.
TABLES = {
    "VPORT": (),
    "LTYPE": ("ByBlock", "ByLayer", "Continuous"),
    "LAYER": (),
    "STYLE": ("Standard",),
    "VIEW": (),
    "UCS": (),
    "APPID": ("ACAD",),
    "DIMSTYLE": (),
    "BLOCK_RECORD": ("*Model_Space", "*Paper_Space"),
}
RECORDS = {
    "LTYPE": ("AcDbLinetypeTableRecord", [(3, ""), (72, 65), (73, 0), (40, 0.0)]),
    "LAYER": ("AcDbLayerTableRecord", [(62, 7), (6, "Continuous")]),
    "STYLE": (
        "AcDbTextStyleTableRecord",
        [(40, 0.0), (41, 1.0), (50, 0.0), (71, 0), (42, 2.5), (3, "txt"), (4, "")],
    ),
    "APPID": ("AcDbRegAppTableRecord", []),
    "BLOCK_RECORD": ("AcDbBlockTableRecord", []),
}
MODEL_SPACE = "1F"  # handle of its record, which entities name as their owner


def drawing_dxf(drawing: Drawing) -> str:
    """Outlines as LWPOLYLINE, marks as CIRCLE and words as TEXT; y points up."""
    layers = list(dict.fromkeys(["0", *(shape.layer for shape in drawing.shapes)]))
    pairs: list[Pair] = [
        (0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1015"),
        (9, "$INSUNITS"), (70, MILLIMETRES), (9, "$MEASUREMENT"), (70, 1),
        (9, "$EXTMIN"), (10, 0.0), (20, 0.0), (30, 0.0),
        (9, "$EXTMAX"), (10, drawing.width), (20, drawing.height), (30, 0.0),
        (9, "$HANDSEED"), (5, "FFFFFF"), (0, "ENDSEC"),
    ]  # fmt: skip
    numbers = iter(range(0x30, 0xFFFFFF))
    pairs += _tables(layers, numbers)
    pairs += _blocks(numbers)
    pairs += [(0, "SECTION"), (2, "ENTITIES")]
    for shape in drawing.shapes:
        pairs += _entity(shape, f"{next(numbers):X}", drawing.height)
    root, groups = f"{next(numbers):X}", f"{next(numbers):X}"
    pairs += [
        (0, "ENDSEC"), (0, "SECTION"), (2, "OBJECTS"),
        (0, "DICTIONARY"), (5, root), (330, 0), (100, "AcDbDictionary"), (281, 1),
        (3, "ACAD_GROUP"), (350, groups),
        (0, "DICTIONARY"), (5, groups), (330, root), (100, "AcDbDictionary"), (281, 1),
        (0, "ENDSEC"), (0, "EOF"),
    ]  # fmt: skip
    return "".join(f"{code}\n{_value(value)}\n" for code, value in pairs)


def _tables(layers: list[str], numbers: Iterator[int]) -> list[Pair]:
    pairs: list[Pair] = [(0, "SECTION"), (2, "TABLES")]
    for table, fixed in TABLES.items():
        names = layers if table == "LAYER" else fixed
        handle = f"{next(numbers):X}"
        pairs += [(0, "TABLE"), (2, table), (5, handle), (330, 0), (100, "AcDbSymbolTable")]
        pairs += [(70, len(names))]
        if table == "DIMSTYLE":
            pairs += [(100, "AcDbDimStyleTable"), (71, 0)]
        for name in names:
            record, more = RECORDS[table]
            own = MODEL_SPACE if name == "*Model_Space" else f"{next(numbers):X}"
            pairs += [(0, table), (5, own), (330, handle), (100, "AcDbSymbolTableRecord")]
            pairs += [(100, record), (2, name)]
            pairs += [] if table == "BLOCK_RECORD" else [(70, 0)]
            pairs += more
        pairs += [(0, "ENDTAB")]
    return [*pairs, (0, "ENDSEC")]


def _blocks(numbers: Iterator[int]) -> list[Pair]:
    pairs: list[Pair] = [(0, "SECTION"), (2, "BLOCKS")]
    for name in TABLES["BLOCK_RECORD"]:
        pairs += [
            (0, "BLOCK"), (5, f"{next(numbers):X}"), (100, "AcDbEntity"), (8, "0"),
            (100, "AcDbBlockBegin"), (2, name), (70, 0), (10, 0.0), (20, 0.0), (30, 0.0),
            (3, name), (1, ""),
            (0, "ENDBLK"), (5, f"{next(numbers):X}"), (100, "AcDbEntity"), (8, "0"),
            (100, "AcDbBlockEnd"),
        ]  # fmt: skip
    return [*pairs, (0, "ENDSEC")]


def _entity(shape: Shape, handle: str, height: float) -> list[Pair]:
    """A shape as an entity; pictures and pieces have none."""
    common: list[Pair] = [(5, handle), (330, MODEL_SPACE), (100, "AcDbEntity"), (8, shape.layer)]
    if isinstance(shape, Stroke):
        own: list[Pair] = [
            (0, "LWPOLYLINE"), *common, (100, "AcDbPolyline"), (90, len(shape.points)),
            (70, int(shape.closed)),
        ]  # fmt: skip
        for x, y in shape.points:
            own += [(10, float(x)), (20, height - float(y))]
        return own
    if isinstance(shape, Mark):
        return [
            (0, "CIRCLE"), *common, (100, "AcDbCircle"),
            (10, shape.x), (20, height - shape.y), (30, 0.0), (40, shape.radius),
        ]  # fmt: skip
    if isinstance(shape, Words):
        x, y = shape.x, height - shape.y
        return [
            (0, "TEXT"), *common, (100, "AcDbText"), (10, x), (20, y), (30, 0.0),
            (40, 0.7 * shape.size), (1, shape.text), (72, CENTRED[shape.anchor]),
            (11, x), (21, y), (31, 0.0), (100, "AcDbText"),
        ]  # fmt: skip
    return []


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.5f}"
    # Other letters than ASCII as release 2000 writes them, line ends not at all.
    text = "".join(one for one in str(value) if one.isprintable())
    return "".join(one if one.isascii() else f"\\U+{ord(one):04X}" for one in text)
