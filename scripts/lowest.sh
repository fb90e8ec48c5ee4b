#!/usr/bin/env bash
# Install the lowest versions of the direct dependencies that pyproject.toml allows into an empty
# environment, and run the short suite there: every bound is one that works. Arguments go to pytest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-python3.11}" -m venv "$work/env"
"$work/env/bin/pip" install --quiet uv
"$work/env/bin/uv" pip install --quiet --python "$work/env/bin/python" \
    --resolution lowest-direct --editable . \
    'pytest>=9.0' 'pytest-timeout>=2.3' 'hypothesis>=6.100' 'jsonschema>=4.23' 'yourdfpy>=0.0.60' \
    'pandas>=2.2' 'h5py>=3.11' 'setuptools>=77'
"$work/env/bin/uv" pip list --python "$work/env/bin/python"
"$work/env/bin/python" -m pytest -q -p no:cacheprovider \
    tests/geometry tests/skin tests/surface tests/flat tests/io tests/touch tests/classify "$@"
