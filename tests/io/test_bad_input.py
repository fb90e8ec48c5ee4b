"""What a file from anywhere may try: entities, circles, sizes, things that are no mesh."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import DataFormatError, MissingFileError, UnknownNameError
from skinmap.io import text as text_module
from skinmap.io.robots.manifest import load_robot
from skinmap.io.robots.mesh_file import read_mesh
from skinmap.io.robots.urdf import UrdfBody
from skinmap.io.taxels.tactile_urdf import read_tactile_urdf
from skinmap.io.taxels.taxel_table import read_taxels
from skinmap.io.text import MAX_BYTES, parse_floats, read_text

BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
TREE = """<robot name="r">
<link name="a"/><link name="b"/><link name="c"/>
<joint name="ab" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<origin xyz="0 0 1" rpy="0 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="bc" type="fixed"><parent link="b"/><child link="c"/></joint>
</robot>"""


@pytest.fixture
def urdf(tmp_path):
    """A function that writes a URDF, with one text replaced by another, and returns its path."""

    def write(old: str = "", new: str = "", text: str = TREE):
        assert old in text
        (tmp_path / "r.urdf").write_text(text.replace(old, new) if old else text)
        return tmp_path / "r.urdf"

    return write


def sparse(path, size: int):
    """A file of a size that takes no place on the disk."""
    with path.open("wb") as file:
        file.truncate(size)
    return path


@pytest.mark.parametrize("reader", [UrdfBody, read_tactile_urdf])
@pytest.mark.parametrize("head", [BOMB, OUTSIDE, '<!DOCTYPE r SYSTEM "http://x.y/z.dtd">'])
def test_document_types_and_entities_are_refused(urdf, reader, head):
    with pytest.raises(DataFormatError, match=r"r\.urdf:2: <!DOCTYPE is not allowed"):
        reader(urdf(text=f"<?xml version='1.0'?>\n{head}{TREE}"))


@pytest.mark.parametrize("reader", [UrdfBody, read_tactile_urdf])
def test_encodings_do_not_hide_entities(tmp_path, reader):
    path = tmp_path / "r.urdf"
    head = '<?xml version="1.0" encoding="UTF-16"?>'
    path.write_bytes((head + BOMB + TREE).encode("utf-16"))
    with pytest.raises(DataFormatError, match="NUL bytes"):
        reader(path)
    head = '<?xml version="1.0" encoding="UTF-7"?>'
    path.write_bytes(head.encode() + BOMB.replace("<", "+ADw-").encode() + TREE.encode())
    with pytest.raises(DataFormatError, match=r"not allowed|not a URDF"):
        reader(path)


def test_inclusions_are_refused(urdf):
    include = '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="/etc/hostname"/>'
    with pytest.raises(DataFormatError, match=":6: XInclude is not allowed"):
        UrdfBody(urdf("</robot>", include + "</robot>"))


def test_urdf_of_the_tree_loads(urdf):
    body = UrdfBody(urdf())
    assert body.links == ("a", "b", "c")
    np.testing.assert_allclose(body.poses({"ab": 0.5})["c"][:3, 3], [0, 0, 1])


MORE = """<link name="d"/><link name="e"/>
<joint name="cd" type="revolute"><parent link="c"/><child link="d"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="ce" type="revolute"><parent link="c"/><child link="e"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="cd"/></joint>"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "</robot>",
            '<joint name="ca" type="fixed"><parent link="c"/><child link="a"/></joint></robot>',
            "joints go in a circle: a > c > b > a",
        ),
        ('<child link="c"/>', '<child link="b"/>', ":5: not a URDF: link 'b' has two parents"),
        ('<child link="b"/>', '<child link="a"/>', "joints go in a circle: a > a"),
        ("</robot>", '<link name="d"/></robot>', "several links without a parent: a, d"),
        ("</robot>", '<link name="c"/></robot>', ":6: two links are called 'c'"),
        ('name="bc"', 'name="ab"', ":5: two joints are called 'ab'"),
        ('<child link="c"/>', "", ":5: not a URDF: <joint> lacks <child>"),
        ('<child link="c"/>', '<child link="x"/>', ":5: .* child link 'x' does not exist"),
        ("0 0 1", "0 0 0", ":3: an axis of length zero"),
        ("0 0 1", "0 0 inf", ":3: expected a finite number, got 'inf'"),
        ("0 0 1", "0 1", ":3: xyz needs 3 numbers, got 2"),
        ('lower="-1"', 'lower="low"', ":4: expected a number, got 'low'"),
        ("</robot>", "", "not a URDF file: .*robot"),
        ("robot", "robert", "not a URDF: <robert>"),
        (' name="r"', "", "not a URDF"),
        ('"fixed"', '"fixt"', ":5: not a URDF: joint 'bc' has the type 'fixt'; the types are: rev"),
        (' type="fixed"', "", "joint 'bc' has the type None"),
    ],
)
def test_urdf_that_is_no_tree_of_links_is_refused(urdf, old, new, message):
    with pytest.raises(DataFormatError, match=message):
        UrdfBody(urdf(old, new))


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_numbers_stand_still_and_others_move(urdf, kind):
    text = TREE.replace('type="fixed"', f'type="{kind}"').replace("</robot>", MORE + "</robot>")
    body = UrdfBody(urdf(text=text))
    assert list(body.joints) == ["ab", "cd"]
    poses = body.poses({"cd": 0.5})
    turned = [poses["c"][:3, :3].T @ poses[link][:3, :3] for link in "de"]
    np.testing.assert_allclose(turned[0], turned[1])  # the second one mimics the first
    assert abs(turned[0] - np.eye(3)).max() > 0.4  # sin of half a radian


def chain(n: int) -> str:
    """A URDF of n links in a row."""
    links = "".join(f'<link name="{i}"/>' for i in reversed(range(n)))
    joints = "".join(
        f'<joint name="{i}" type="fixed"><parent link="{i}"/><child link="{i + 1}"/></joint>'
        for i in range(n - 1)
    )
    return f'<robot name="r">{links}{joints}</robot>'


def test_chains_that_take_for_ever_are_refused(urdf):
    assert len(UrdfBody(urdf(text=chain(201))).links) == 201
    with pytest.raises(DataFormatError, match="a chain of 201 joints ends at '201', at most 200"):
        UrdfBody(urdf(text=chain(202)))
    with pytest.raises(DataFormatError, match="2001 links, at most 2000"):
        UrdfBody(urdf(text=chain(2001)))
    with pytest.raises(DataFormatError, match="more than 200000 tags"):
        UrdfBody(urdf("</robot>", "<a/>" * 200_000 + "</robot>"))


def test_a_joint_that_does_not_turn_may_have_no_axis(urdf):
    # The iCub's own URDF has such fixed joints.
    assert UrdfBody(urdf('<child link="c"/>', '<child link="c"/><axis xyz="0 0 0"/>')).links


def test_meshes_of_a_urdf_are_checked_when_asked_for(urdf, tmp_path):
    visual = '<link name="a"><visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    body = UrdfBody(urdf('<link name="a"/>', visual.format("gone.stl")))
    with pytest.raises(MissingFileError, match=r"gone\.stl.* a mesh that the URDF names"):
        body.mesh("a")
    (tmp_path / "m.stl").write_bytes(b"")
    with pytest.raises(DataFormatError, match=r"m\.stl"):
        UrdfBody(urdf('<link name="a"/>', visual.format("m.stl"))).mesh("a")
    with pytest.raises(MissingFileError, match="a mesh"):
        UrdfBody(urdf('<link name="a"/>', visual.format("m" * 300 + ".stl"))).mesh("a")
    with pytest.raises(DataFormatError, match="scale needs 1 or 3 numbers, got 2"):
        UrdfBody(urdf('<link name="a"/>', visual.format('m.stl" scale="1 1')))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.stl", "", r"m\.stl"),
        ("m.stl", "solid x\nendsolid x\n", r"m\.stl"),
        ("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", r"m\.obj"),
        ("m.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "NaN"),
        ("m.ply", "ply\nformat ascii 1.0\nelement vertex 99999999999\n", r"m\.ply"),
        ("m.txt", "v 0 0 0\n", r"a text where a mesh \(\.stl, \.obj"),
        ("m.zip", "PK", "not a mesh"),
        ("m.dae", f"{BOMB}<COLLADA/>", ":1: <!DOCTYPE is not allowed"),
        ("m.dae", "<COLLADA", "not a COLLADA mesh"),
    ],
)
def test_read_mesh_refuses_what_is_no_mesh(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(DataFormatError, match=message):
        read_mesh(tmp_path / name)


def test_read_mesh_names_a_missing_file(tmp_path):
    with pytest.raises(MissingFileError, match=r"gone\.stl.*a mesh"):
        read_mesh(tmp_path / "gone.stl")


@pytest.mark.parametrize("name", ["t.csv", "t.txt", "t.calib", "t.urdf"])
def test_large_files_are_refused_before_they_are_read(tmp_path, monkeypatch, name):
    monkeypatch.setattr(text_module.Path, "read_text", None)
    monkeypatch.setattr(text_module.Path, "read_bytes", None)
    path = sparse(tmp_path / name, MAX_BYTES + 1)
    with pytest.raises(DataFormatError, match="64 MB; at most 64 MB are read"):
        read_taxels(path)


def test_large_meshes_are_refused_before_they_are_read(tmp_path):
    with pytest.raises(DataFormatError, match="600 MB; at most 512 MB"):
        read_mesh(sparse(tmp_path / "m.stl", 600 * 2**20))


def test_names_that_no_file_can_have_are_missing_files(tmp_path):
    for name in ("x" * 300 + ".csv", "a\0b.csv", "."):
        with pytest.raises(MissingFileError, match="a taxel table"):
            read_taxels(tmp_path / name)
    with pytest.raises(MissingFileError, match="a text file"):
        read_text(tmp_path)


@pytest.mark.parametrize("word", ["1_000", "\u0661", "", "0x10", "1e999", "nan"])
def test_numbers_are_plain_numbers(tmp_path, word):
    with pytest.raises(DataFormatError, match=r"t:3: expected a"):
        parse_floats([word], tmp_path / "t", 3)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1e300,0,0,0,0,0,0,1", r"t\.csv:2: channel or module beyond"),
        ('"' + "x" * 140_000 + '"', "not CSV: field larger"),
    ],
)
def test_read_csv_refuses_what_overflows(tmp_path, row, message):
    (tmp_path / "t.csv").write_text(f"channel,module,x,y,z,nx,ny,nz\n{row}\n")
    with pytest.raises(DataFormatError, match=message):
        read_taxels(tmp_path / "t.csv")


MANIFEST = """[robot]
name = "one"
urdf = "r.urdf"
[[part]]
name = "hand"
link = "c"
taxels = "t.csv"
"""


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("r.urdf", ":x", UnknownNameError, "no package of robot models ''"),
        ("r.urdf", "..a:x", UnknownNameError, r"no package of robot models '\.\.a'"),
        ("r.urdf", "a\\u0000", DataFormatError, "no file can be called"),
        ("t.csv", "a\\u0000", DataFormatError, "no file can be called"),
        ("r.urdf", "x" * 300, MissingFileError, "a URDF file"),
        ('urdf = "r.urdf"', f'mesh = "{"x" * 300}.stl"', MissingFileError, "a mesh file"),
        ("[[part]]", "[[part]]\nmodule = '" + "x" * 300 + ".csv'", MissingFileError, "a module"),
        ("[[part]]", "pose_deg = 3\n[[part]]", DataFormatError, "pose_deg must be a table, got 3"),
        ("[[part]]", "pose_deg.ab = nan\n[[part]]", DataFormatError, "must be a number, got nan"),
        ("[[part]]", "pose_deg.ab = true\n[[part]]", DataFormatError, "must be a number, got True"),
        ("[[part]]", "pose_deg.ab = 1e300\n[[part]]", DataFormatError, "must be a number"),
    ],
)
def test_manifests_that_try_something_are_refused(urdf, tmp_path, old, new, error, message):
    urdf()
    assert old in MANIFEST
    (tmp_path / "m.toml").write_text(MANIFEST.replace(old, new))
    with pytest.raises(error, match=message):
        load_robot(tmp_path / "m.toml")


def test_load_robot_takes_any_name(tmp_path):
    for name in ("x" * 300, "a\0b"):
        with pytest.raises(UnknownNameError, match="no robot"):
            load_robot(name)
        with pytest.raises(MissingFileError, match="a robot manifest"):
            load_robot(name + ".toml")


@pytest.mark.parametrize("word", ["99999999999999999999", "x", "1.5"])
def test_read_icub_names_the_line_of_its_list(tmp_path, word):
    text = f"name x\ntaxel2Repr ( 3 {word} )\n[calibration]\n0 0 1 0 0 1\n"
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(DataFormatError, match=r"t\.txt:2: "):
        read_taxels(tmp_path / "t.txt")
