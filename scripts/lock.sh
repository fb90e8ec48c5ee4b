#!/usr/bin/env bash
# Write constraints.txt: install the newest versions of everything, all extras, side by side into
# an empty environment, and note what came. Bare names and versions: no address, no path, no hash.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
CONSTRAINTS='' scripts/environment.sh "$work/env" '.[dev,scan]'
{
    echo "# Tested versions of everything skinmap installs; renew with: make lock"
    "$work/env/bin/python" - <<'PYTHON'
import re
from importlib.metadata import distributions

skipped = {"skinmap", "pip"}  # the project itself, and the installer that uv does without
pins = {re.sub(r"[-_.]+", "-", d.name).lower(): d.version for d in distributions()}
for name in sorted(pins.keys() - skipped):
    print(f"{name}=={pins[name]}")
PYTHON
    # Installed by hand where networks are trained: its builds differ from machine to machine.
    grep '^torch==' constraints.txt
} | LC_ALL=C sort >"$work/constraints.txt"
cp "$work/constraints.txt" constraints.txt
