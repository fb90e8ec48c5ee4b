"""Accidents of files: flipped bits, lost lines, words that are not numbers, a cut end."""

from __future__ import annotations

import io
import zipfile

from hypothesis import strategies as st

WORDS = [
    b"", b"nan", b"-inf", b"1e308", b"-1e308", b"1e999", b"99999999999999999999", b"-1", b"0",
    b"1_000", b"0x1p3", b"2.5", b"x", b"\xc3\xa9", b"\xff", b"\0", b"\r", b'"', b"'", b"<", b">",
    b"&a;", b"&#0;", b"#", b"[", b"]", b"(", b")", b",", b"=", b"../..", b"/dev/zero", b":",
    b"true", b"1e-320", b"9" * 400, b"9" * 5000, b"1 2 3 4", b"package:x", b":x", b"x:",
    b"\\u0000", b"null", b"{}", b"{", b"[" * 2000, b"Infinity", b"NaN",
]  # fmt: skip
KINDS = ["flip", "drop", "double", "swap", "word", "insert", "cut"]
SHARE = st.floats(0, 1, exclude_max=True)
ACCIDENT = st.tuples(st.sampled_from(KINDS), SHARE, SHARE, st.sampled_from(WORDS))
accidents = st.lists(ACCIDENT, min_size=1, max_size=4)

BETWEEN = b' \t\n,"()=<>'
MEMBER = b"\n\0\xffmember:"


def mutate(data: bytes, steps: list[tuple[str, float, float, bytes]]) -> bytes:
    """The data after some accidents; their two numbers say where, as shares of the whole."""
    for kind, where, other, word in steps:
        if not data:
            return data
        place = int(where * len(data))
        if kind == "flip":
            data = data[:place] + bytes([data[place] ^ 1 << int(other * 8)]) + data[place + 1 :]
        elif kind == "cut":
            data = data[:place]
        elif kind == "insert":
            data = data[:place] + word + data[place:]
        elif kind == "word":
            end = place
            while end < len(data) and data[end : end + 1] not in BETWEEN:
                end += 1
            start = place
            while start > 0 and data[start - 1 : start] not in BETWEEN:
                start -= 1
            data = data[:start] + word + data[end:]
        else:
            lines = data.split(b"\n")
            i, j = int(where * len(lines)), int(other * len(lines))
            if kind == "drop":
                del lines[i]
            elif kind == "double":
                lines.insert(j, lines[i])
            else:
                lines[i], lines[j] = lines[j], lines[i]
            data = b"\n".join(lines)
    return data


def spread(archive: bytes) -> bytes:
    """The members of a zip laid side by side, those of zips inside it too.

    Damage then reaches what they hold, instead of stopping at their checksums.
    """
    with zipfile.ZipFile(io.BytesIO(archive)) as whole:
        return b"".join(MEMBER + name.encode() + b"\n" + whole.read(name) for name in _names(whole))


def packed(members: bytes) -> bytes:
    """A zip of what `spread` laid side by side, with checksums that are right again."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as whole:
        for member in members.split(MEMBER)[1:]:
            name, _, content = member.partition(b"\n")
            text = name.decode("utf-8", "replace").replace("\0", "")
            if text and text not in whole.namelist():
                whole.writestr(zipfile.ZipInfo(text), content)
    return buffer.getvalue()


def _names(whole: zipfile.ZipFile) -> list[str]:
    """Small members first: a head is damaged more often than it would be by its size."""
    return sorted(whole.namelist(), key=lambda name: whole.getinfo(name).file_size)
