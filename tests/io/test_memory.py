"""Files of nearly 10 MB are read or refused in less than 200 MB and without a hang.

All kinds are in benchmarks/reliability/large.py.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from benchmarks.reliability import large
from benchmarks.reliability.cuts import MOST_MB, apart

# The largest of each kind, all of it in the rows: what a generator gone wild would leave.
HEADS = {
    "csv": "channel,module,x,y,z,nx,ny,nz\n",
    "icub": "name x\n[calibration]\n",
    "skinware": "400000\n",
}
ROWS = {
    "csv": "{0},0,0.0,0.5,{0},0,0,1\n",
    "icub": "0 0 {0} 0 0 0\n",
    "skinware": "0 {0} 1 2 {0} 0 0 1 0 0\n",
}
CHILD = """
import resource, sys
from pathlib import Path
from skinmap.errors import SkinError
from skinmap.io.taxels.taxel_table import read_taxels
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before = peak()
try:
    read_taxels(Path(sys.argv[1]), sys.argv[2])
except SkinError as error:
    print(str(error)[:100])
print(peak() - before)
"""


@pytest.mark.parametrize("format", HEADS)
def test_large_tables_take_less_than_200_mb(tmp_path, format):
    path = tmp_path / "large.txt"
    with path.open("w") as file:
        file.write(HEADS[format])
        for number in range(1, 1_000_000):
            if file.write(ROWS[format].format(number)) and file.tell() > 9_800_000:
                break
    result = subprocess.run(
        [sys.executable, "-c", CHILD, str(path), format],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert float(result.stdout.split()[-1]) < 200.0, result.stdout


@pytest.mark.parametrize(
    "kind", ["touches", "numbers", "module-layout-csv", "places", "batch", "anchors"]
)
def test_large_tables_of_other_readers_take_no_more(kind):
    """A fifth of the size and of the memory; words of all rows together took twice as much."""
    found, code = apart(large.examine, kind, large.MEGABYTES / 5)
    assert found is not None, f"the process ended with {code}"
    assert not found["faults"]
    assert found["more_mb"] < MOST_MB / 5


def test_a_part_of_thousands_of_taxels_at_one_place_is_refused_at_once():
    """Each is a copy of one of a few taxels: nearest ones were looked for among all of them."""
    found, code = apart(large.examine, "self-touch-part", large.MEGABYTES / 5)
    assert found is not None, f"the process ended with {code}"
    assert not found["faults"]
    assert found["longest_s"] < 5.0
