"""Keep what a command prints, with its head and the code that ran.

    python -m benchmarks.harness.keep evaluation_kaspar evaluate --protocol kaspar --seeds 5

writes benchmarks/results/evaluation_kaspar.json: its JSON, and under `made` the head of `about`,
the command and the pieces of code behind it. Caches are empty, so that all that it takes
runs; with `--jobs` the pieces that run in other processes would be missing, so it is refused.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from typing import Any
from unittest import mock

from benchmarks.harness.record import RESULTS, about, watched, write


def run(words: list[str]) -> dict[str, Any]:
    """What `skinmap WORDS --json` prints, and the head of its file.

    Raises
    ------
    ValueError
        If the command would spread its work.
    """
    if "--jobs" in words:
        raise ValueError("kept results are of one process: no --jobs")
    head = about("full")
    with (
        tempfile.TemporaryDirectory() as cache,
        mock.patch.dict(os.environ, SKINMAP_CACHE=cache),
        watched() as pieces,
    ):
        from click.testing import CliRunner

        from skinmap.cli.main import cli

        done = CliRunner().invoke(cli, [*words, "--json"], catch_exceptions=False)
        if done.exit_code:
            raise SystemExit(done.output)
    command = " ".join(["skinmap", *words])
    made = {**head, "command": command, "code": " ".join(sorted(pieces))}
    return {"made": made, **json.loads(done.stdout)}


if __name__ == "__main__":
    name, *rest = sys.argv[1:]
    write(RESULTS / f"{name}.json", run(rest))
