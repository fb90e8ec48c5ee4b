"""Reading profiles: what trade writes is read, and anything else is refused in one line."""

from __future__ import annotations

import re
import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinmap import __version__
from skinmap.errors import (
    DataFormatError,
    MissingFileError,
    SkinError,
    SkinWarning,
    UnknownNameError,
)
from skinmap.profile import KNOBS, MAX_BYTES, Allowed, read_profile

HEAD = f'[profile]\nformat = 1\nskinmap = "{__version__}"\n'
GOOD = (
    HEAD
    + 'robot = "icub"\npart = "torso"\nmachine = "a box"\nseed = 0\nseeds = 3\n\n'
    + '[flatten]\nmethod = "fast"\n\n[flatten.predicted]\nseconds = 0.01\nerror = 1.2\nunit = "%"\n'
)


@pytest.fixture
def profile(tmp_path):
    """Writes a profile and reads it."""

    def read(text: str | bytes):
        path = tmp_path / "p.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_profile(path)

    return read


def test_read_profile_gives_what_is_written(profile):
    read = profile(GOOD)
    assert (read.robot, read.part) == ("icub", "torso")
    assert read.settings == {"flatten": {"method": "fast"}}


def test_a_profile_written_by_hand_needs_settings_alone(profile):
    read = profile("[classify]\nwords = 4\n")
    assert (read.settings, read.robot) == ({"classify": {"words": 4}}, "")


def test_read_profile_warns_of_another_version(profile):
    with pytest.warns(SkinWarning, match=r"Skinmap 0\.0\.9, this is .*may differ"):
        profile(GOOD.replace(__version__, "0.0.9"))


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        (GOOD.replace("format = 1", "format = 2"), DataFormatError, "expected 1, got 2"),
        (GOOD.replace("format = 1", "format = true"), DataFormatError, "expected 1, got True"),
        (GOOD.replace("format = 1\n", ""), DataFormatError, "expected 1, got none"),
        (HEAD.partition("skinmap")[0], DataFormatError, "lacks the version"),
        ("", DataFormatError, r"no table \[profile\]"),
        ("profile = 1", DataFormatError, r"no table \[profile\]"),
        (HEAD + "robot = 3", DataFormatError, r"robot must be text, got 3"),
        (HEAD + "seed = 'a'", DataFormatError, r"seed must be a whole number, got 'a'"),
        (HEAD + "colour = 'a'", UnknownNameError, "no key of .profile. .* 'colour'; .* are: for"),
        (GOOD + "[flattne]\n", UnknownNameError, "'flattne'; did you mean 'flatten'"),
        (HEAD + "[flatten]\nmethd = 'fast'", UnknownNameError, "'methd'; did you mean 'method'"),
        (HEAD + "[flatten]\nmeshing = 'fst'", UnknownNameError, "'fst'; did you mean 'fast'"),
        (HEAD + "[flatten]\nmeshing = 3", DataFormatError, "= 3; expected consensus, fast"),
        (HEAD + "[flatten]\nmeshing = []", DataFormatError, "= a list; expected consensus"),
        (HEAD + "[flatten]\nmeshing = 1990-01-01", DataFormatError, "= a date; expected con"),
        (HEAD + "[classify]\nradius_mm = -1", DataFormatError, r"= -1; .* from 0\.1 to 1000"),
        (HEAD + "[classify]\nradius_mm = nan", DataFormatError, "= nan; expected auto; numbers"),
        (HEAD + "[classify]\nwords = 2.5", DataFormatError, r"= 2\.5; expected whole numbers"),
        (HEAD + "[classify]\nwords = true", DataFormatError, "= true; expected whole"),
        (HEAD + "[classify]\nrotations = 2", DataFormatError, "= 2; expected 1, 4, 6"),
        ("flatten = 1\n" + HEAD, DataFormatError, r"'flatten' must be a table \[flatten\], got 1"),
        ("[profile", DataFormatError, "not TOML: "),
        (b"\xff\xfe", DataFormatError, "not a text file"),
        ("a = " + "[" * 5000 + "]" * 5000, DataFormatError, "not TOML: "),
        (HEAD + "seed = " + "9" * 5000, DataFormatError, "not TOML: "),
        ("#" * (MAX_BYTES + 1), DataFormatError, "64 kB; a profile has at most 64"),
    ],
)  # fmt: skip
def test_read_profile_refuses_in_one_line(profile, text, error, words):
    with pytest.raises(error, match=words) as caught:
        profile(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["missing.toml", "p.toml/below", "nul\0.toml", "n" * 300])
def test_read_profile_refuses_missing_files(tmp_path, name):
    (tmp_path / "p.toml").write_text(GOOD)
    words = r"expected a profile|not TOML|cannot be read"
    with pytest.raises((MissingFileError, DataFormatError), match=words):
        read_profile(f"{tmp_path}/{name}")
    with pytest.raises(DataFormatError, match="not a file; expected a profile"):
        read_profile(tmp_path)


# A word in a place of a good profile, or anything at all.
_words = re.findall(r"\S+", GOOD)
_bits = st.sampled_from([*_words, "[", "]]", "=", '"', "\n", "nan", "1e999", "{a={a={}}}", "'\\"])


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.one_of(
        st.binary(max_size=200),
        st.lists(st.one_of(_bits, st.text(max_size=4))).map(
            lambda w: " ".join(w).encode("utf-8", "replace")
        ),
        st.tuples(st.integers(0, len(GOOD)), st.integers(0, 9), st.binary(max_size=4)).map(
            lambda cut: GOOD.encode()[: cut[0]] + cut[2] + GOOD.encode()[cut[0] + cut[1] :]
        ),
    )
)
def test_read_profile_reads_or_refuses_anything(profile, data):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkinWarning)
        try:
            read = profile(data)
        except SkinError as error:
            said = str(error)
        else:
            said = ""
            for task, knobs in read.settings.items():
                assert all(KNOBS[task][name].allows(value) for name, value in knobs.items())
    assert "\n" not in said


def test_allowed_says_what_there_is():
    assert Allowed(("a", "b")).words() == "a, b"
    assert Allowed(any_name=True).words() == "a name"
    assert (
        Allowed(("auto",), least=1, most=3, whole=True).words() == "auto; whole numbers from 1 to 3"
    )
    assert not Allowed(any_name=True).allows("")
    assert not Allowed(any_name=True).allows(1)
