"""Meshes of some hundred bytes that claim, or unfold to, more than any memory holds."""

from __future__ import annotations

import json
import os
import struct
import zlib
from pathlib import Path

import pytest

from benchmarks.reliability.cuts import apart, peak_mb, resident_mb
from skinmap.errors import SkinError
from skinmap.io.robots.mesh_file import read_mesh

MANY = 10**12
LITTLE = 50.0  # [MB]; the reader itself and what it imports take some ten
CORNERS = struct.pack("<9f3I", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
PLY = (
    "ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
    "property float z\nelement face {faces}\nproperty list {count} int vertex_indices\nend_header\n"
)


def ply(
    kind: str, body: bytes, *, vertices: int = 3, faces: int = 1, count: str = "uchar"
) -> bytes:
    return PLY.format(kind=kind, vertices=vertices, faces=faces, count=count).encode() + body


def glb(blob: bytes = CORNERS, **other: object) -> bytes:
    """A triangle, with some of its entries exchanged."""
    place = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    corners = {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
    views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12}]
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}], "accessors": [place, corners], "bufferViews": views,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(blob)}], **other,
    }  # fmt: skip
    head = json.dumps(tree).encode()
    head += b" " * (-len(head) % 4)
    blob += bytes(-len(blob) % 4)
    body = struct.pack("<I4s", len(head), b"JSON") + head + struct.pack("<I4s", len(blob), b"BIN\0")
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body) + len(blob)) + body + blob


def png(side: int) -> bytes:
    """A black picture: 3.6 billion pixels in 0.4 MB."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    packing, rows = zlib.compressobj(9), bytes((side // 8 + 1) * 1000)
    data = b"".join(packing.compress(rows) for _ in range(side // 1000)) + packing.flush()
    head = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def pictured() -> bytes:
    picture = png(60_000)
    views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12},
             {"buffer": 0, "byteOffset": 48, "byteLength": len(picture)}]  # fmt: skip
    return glb(
        CORNERS + picture, bufferViews=views, textures=[{"source": 0}],
        images=[{"bufferView": 2, "mimeType": "image/png"}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )  # fmt: skip


def accessor(**entries: object) -> bytes:
    place = {"componentType": 5126, "type": "VEC3", **entries}
    corners = {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
    return glb(accessors=[place, corners])


def collada(doublings: int) -> bytes:
    """A triangle that each of so many nodes shows twice as often as the one before."""
    nodes = '<node id="n0"><instance_geometry url="#g"/></node>' + "".join(
        f'<node id="n{k}"><instance_node url="#n{k - 1}"/><instance_node url="#n{k - 1}"/></node>'
        for k in range(1, doublings + 1)
    )
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset/>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">0 0 0 1 0 0
0 1 0</float_array><technique_common><accessor source="#a" count="3" stride="3"><param name="X"
type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh>
</geometry></library_geometries><library_nodes>{nodes}</library_nodes><library_visual_scenes>
<visual_scene id="s"><node><instance_node url="#n{doublings}"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
LIST = struct.pack("<I", 2**32 - 1)
BOMBS = {
    "a.ply": (ply("ascii", b"0 0 0\n", vertices=MANY), "NaN in it"),
    "b.ply": (ply("binary_little_endian", bytes(100), vertices=MANY), "unexpected length"),
    "c.ply": (ply("binary_little_endian", CORNERS[:36] + b"\3", faces=MANY), "unexpected length"),
    "d.ply": (ply("binary_little_endian", CORNERS[:36] + LIST, count="uint"), "not a mesh"),
    "a.off": (b"OFF\n%d 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n" % MANY, "cannot reshape"),
    "a.stl": (bytes(80) + LIST + bytes(50), "without triangles"),
    "a.obj": (OBJ + b"f 1 2 %d\n" % MANY, "out of bounds"),
    "m.obj": (b"mtllib /dev/zero\n" + OBJ + b"usemtl a\nf 1 2 3\n", ""),
    "a.glb": (accessor(bufferView=0, count=MANY), "unfolds to 1,000,000,000,000 vertices"),
    "b.glb": (accessor(count=10**8), "unfolds to 100,000,000 vertices"),
    "c.glb": (glb(nodes=[{"mesh": 0}] * 11_000, scenes=[{"nodes": [*range(11_000)]}]),
              "at 11,000 places"),
    "d.glb": (glb(nodes=[{"mesh": 0, "children": [0]}]), ""),
    "e.glb": (pictured(), ""),
    "a.dae": (collada(30), "unfolds to 3,221,225,472 vertices"),
    "b.dae": (collada(3), ""),
    "c.dae": (collada(3).replace(b'"#g"', b'"#n3"'), "a mesh without triangles"),
}  # fmt: skip


def tried(path: Path) -> dict[str, object]:
    before = resident_mb()
    try:
        said, count = "", len(read_mesh(path)[1])
    except SkinError as error:
        said, count = str(error), 0
    return {"said": said, "faces": count, "more_mb": peak_mb() - before}


@pytest.mark.parametrize("name", BOMBS)
def test_a_mesh_takes_little_memory_whatever_it_claims(tmp_path, monkeypatch, name):
    import trimesh  # noqa: F401 - in this process: what it takes itself is no part of the figure

    content, said = BOMBS[name]
    path = tmp_path / name
    path.write_bytes(content)
    found, code = apart(tried, path)
    assert found is not None, f"the process ended with {code}"
    assert said in found["said"]
    assert bool(found["faces"]) == (not said)
    assert found["more_mb"] < LITTLE


def test_memory_that_is_taken_is_seen(tmp_path):
    found, _ = apart(
        lambda: {"more_mb": -resident_mb() + (len(os.urandom(1) * 10**8) and peak_mb())}
    )
    assert found is not None
    assert found["more_mb"] > LITTLE
