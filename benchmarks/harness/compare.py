"""Two runs of `make bench` side by side: `make bench-compare OLD=a.json NEW=b.json`.

Per figure old, new, their ratio, and whether the change lies beyond the spread of both runs. Exit
1 where a figure became worse by more than the threshold (and beyond the spread, where the runs
know it), 2 where the files cannot be compared.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.harness.asked import number
from benchmarks.harness.record import FORMAT

THRESHOLD = 1.25
FIGURE = {"key", "area", "name", "unit", "value", "better", "spread"}
SAME = ("system", "processor", "cores", "memory_gb")  # of the machine


class NotComparableError(Exception):
    """Two files that cannot be compared, in one line."""


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 0, 1 for regressions, 2 for files that cannot be compared."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--threshold", type=float, default=THRESHOLD,
                        help="times as bad that is a regression")  # fmt: skip
    parser.add_argument("--other-machine", action="store_true", help="compare them all the same")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    try:
        old, new = load(options.old), load(options.new)
        check(old, new, other_machine=options.other_machine)
    except NotComparableError as error:
        print(error, file=sys.stderr)
        return 2
    rows = compare(old, new, threshold=options.threshold)
    worse = [row for row in rows if row["verdict"] == "regression"]
    if options.json:
        found = {"threshold": options.threshold, "rows": rows, "regressions": len(worse)}
        print(json.dumps(found, indent=1))
    else:
        print(text_of(rows, options.threshold))
    return 1 if worse else 0


def load(path: Path) -> dict[str, Any]:
    """A file of `make bench`."""
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise NotComparableError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise NotComparableError(f"cannot read {path}: {error}") from None
    found = result.get("format") if isinstance(result, dict) else None
    if found != FORMAT:
        raise NotComparableError(f"{path} has format {found!r}; this program reads {FORMAT}")
    if "figures" not in result:
        raise NotComparableError(f"{path} is of one area; `make bench` writes what is compared")
    try:
        whole = all(row.keys() >= FIGURE for row in result["figures"])
        whole = whole and result["machine"].keys() >= {*SAME} and isinstance(result["form"], str)
    except (AttributeError, KeyError, TypeError):
        whole = False
    if not whole:
        raise NotComparableError(f"{path} is damaged: figures, machine or form are not whole")
    return dict(result)


def check(old: Mapping[str, Any], new: Mapping[str, Any], *, other_machine: bool) -> None:
    """Refuse files of different machines or of different forms."""
    machines = [tuple(run["machine"][key] for key in SAME) for run in (old, new)]
    if machines[0] != machines[1]:
        a, b = (", ".join(map(str, one)) for one in machines)
        text = f"warning: the files are of two machines: {a}; and {b}"
        if not other_machine:
            raise NotComparableError(f"{text}; --other-machine compares them all the same")
        print(text, file=sys.stderr)
    if old["form"] != new["form"]:
        raise NotComparableError(
            f"one file is of the {old['form']} form, the other of the {new['form']} form"
        )


def compare(
    old: Mapping[str, Any], new: Mapping[str, Any], *, threshold: float = THRESHOLD
) -> list[dict[str, Any]]:
    """One row a figure that is in either file.

    Returns
    -------
    list of dict
        `key, area, name, unit, old, new, ratio` (new over old), `beyond_spread` (None where neither
        run knows a spread) and `verdict`: "same", "better", "regression", "new" or "gone".
    """
    before, after = ({row["key"]: row for row in run["figures"]} for run in (old, new))
    return [
        _row(before.get(key), after.get(key), threshold) for key in dict.fromkeys([*before, *after])
    ]


def _row(
    old: Mapping[str, Any] | None, new: Mapping[str, Any] | None, threshold: float
) -> dict[str, Any]:
    either = new or old
    assert either is not None
    row = {key: either[key] for key in ("key", "area", "name", "unit")}
    row |= {"old": old and old["value"], "new": new and new["value"]}
    row |= {"ratio": None, "beyond_spread": None}
    if old is None or new is None:
        return row | {"verdict": "new" if old is None else "gone"}
    beyond = outside(old, new)
    ratio = new["value"] / old["value"] if old["value"] else None
    return row | {
        "ratio": ratio,
        "beyond_spread": beyond,
        "verdict": verdict(old["value"], new["value"], new["better"], beyond, threshold),
    }


def outside(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool | None:
    """Whether the quartiles of two runs lie apart; None where one has none."""
    if not old["spread"] or not new["spread"]:
        return None
    return bool(old["spread"][1] < new["spread"][0] or new["spread"][1] < old["spread"][0])


def verdict(old: float, new: float, better: str, beyond: bool | None, threshold: float) -> str:
    """In a word what a change is."""
    small, large = (new, old) if better == "more" else (old, new)
    worse = large > small * threshold if small > 0 else large > small
    improved = small > large * threshold if large > 0 else small > large
    if beyond is False or not (worse or improved):
        return "same"
    return "regression" if worse else "better"


def text_of(rows: Sequence[Mapping[str, Any]], threshold: float) -> str:
    """The table for people: what changed first, and a count of the rest."""
    said = {True: "beyond the spread", False: "within the spread", None: "spread unknown"}
    lines = []
    for kind in ("regression", "better", "gone", "new", "same"):
        for row in (one for one in rows if one["verdict"] == kind):
            ratio = "" if row["ratio"] is None else f"{row['ratio']:.3g}x"
            unit = f" {row['unit']}" if row["unit"] else ""
            lines.append(
                f"{kind:<10}  {row['area']}: {row['name']}: {number(row['old'])} to "
                f"{number(row['new'])}{unit}  {ratio}  {said[row['beyond_spread']]}"
            )
    count = sum(row["verdict"] == "regression" for row in rows)
    lines.append(
        f"{count} of {len(rows)} figures worse by more than {threshold:g}x"
        if count
        else f"no figure of {len(rows)} worse by more than {threshold:g}x"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
