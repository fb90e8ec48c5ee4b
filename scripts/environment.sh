#!/usr/bin/env bash
# Make a virtual environment and install into it, with uv where present, else with venv and pip.
#
#   scripts/environment.sh FOLDER REQUIREMENT...
#
# PYTHON       interpreter to use (default python3)
# UV           path of uv; empty: use venv and pip even where uv is present
# CONSTRAINTS  pinned versions (default constraints.txt); empty: the newest that fit together
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

folder=$1
shift
python=${PYTHON:-python3}
uv=${UV-$(command -v uv || true)}
constraints=${CONSTRAINTS-constraints.txt}

if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "skinmap needs Python 3.11 or later, '$python' is not; try for example: make PYTHON=python3.12" >&2
    exit 2
fi
"$python" scripts/system_packages.py ${uv:+--uv}

echo "Installing Python packages into $folder (takes a minute or two, only once) ..." >&2
# An interpreter that is gone (or moved) leaves a folder that neither tool can mend.
"$folder/bin/python" -c '' 2>/dev/null || rm -rf "$folder"
options=(${constraints:+-c "$constraints"} "$@")
if [ -n "$uv" ]; then
    "$uv" venv -q --allow-existing --python "$(command -v "$python")" "$folder"
    "$uv" pip install -q --python "$folder" "${options[@]}"
else
    "$python" -m venv "$folder"
    # -qq: only errors; what pip warns of concerns its own set-up.
    "$folder/bin/python" -m pip install -qq --disable-pip-version-check "${options[@]}"
fi
