"""What is packed comes back, and stands where the page reads it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.unpacking import unpack
from viewer.web.scene_data import TYPES, finite, pack


@given(
    st.dictionaries(
        st.text(max_size=5), st.tuples(st.sampled_from(TYPES), st.integers(0, 9)), max_size=5
    )
)
def test_unpack_gives_back_what_pack_took(wanted):
    arrays = {name: np.arange(n).astype(kind) for name, (kind, n) in wanted.items()}
    message = pack({"kind": "test", "é": 1}, arrays)
    header, found = unpack(message)
    assert header == {"kind": "test", "é": 1}
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert np.array_equal(found[name], array)


def test_pack_places_arrays_where_typed_arrays_can_stand():
    message = pack({"x": "a"}, {"a": np.zeros(3, np.uint8), "b": np.ones(2, np.float32)})
    assert len(message) % 8 == 0
    assert unpack(message)[1]["b"].tolist() == [1.0, 1.0]


def test_pack_refuses_what_a_page_cannot_read():
    with pytest.raises(TypeError, match=r"array 'a' of type float64, expected one of"):
        pack({}, {"a": np.zeros(3)})


def test_pack_refuses_numbers_that_json_lacks():
    with pytest.raises(ValueError, match="not JSON compliant"):
        pack({"rate": float("nan")}, {})


def test_finite_turns_the_unknown_into_none():
    assert finite(float("nan")) is None
    assert finite(None) is None
    assert finite(np.float32(2.0)) == 2.0
