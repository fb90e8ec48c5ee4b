"""What the issues ask for, beside what a run of `make bench` got: benchmarks/asked.toml, judged.

Each entry of the table names an area, a path into its rows, a bound (`most`, `least` or
`equals`), a unit and where the bound comes from. A path is a list of keys; a table in it picks
the rows of a list that have these values. Where it picks several, the worst of them counts.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.areas import NAMES
from benchmarks.harness.record import RESULTS

TABLE = ROOT / "benchmarks" / "asked.toml"
KEPT = "kept in"  # a file: what a note on a figure of another run begins with
BOUNDS = ("most", "least", "equals")
TIMES = ("s", "ms", "us", "times", "factorisations C", "s wall")
HEADS = ("asked for", "asked", "got", "spread", "ratio", "", "peer", "asked in")


def asked() -> list[dict[str, Any]]:
    """The entries of asked.toml."""
    return list(tomllib.loads(TABLE.read_text(encoding="utf-8"))["asked"])


def find(rows: Any, path: Sequence[Any]) -> Iterator[Any]:
    """All values that a path leads to; none where a key or a row is missing."""
    if not path:
        if rows is not None:
            yield rows
        return
    first, rest = path[0], path[1:]
    if isinstance(first, Mapping):
        for row in rows if isinstance(rows, list) else ():
            if isinstance(row, Mapping) and all(row.get(k) == v for k, v in first.items()):
                yield from find(row, rest)
    elif isinstance(rows, Mapping) and first in rows:
        yield from find(rows[first], rest)


def judge(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row an entry: asked, got, ratio, and whether it is met.

    Returns
    -------
    list of dict
        `key, area, what, unit, bound, asked, got, spread, ratio, state, peer, peer_name, source,
        note`. `key` names the figure for good. The ratio is above 1 where the figure is better
        than asked. `state` is "met", "falls short" or "not measured"; `note` says why, or from
        where a figure comes that is not of this run.
    """
    return [_judged(entry, result) for entry in asked()]


def _judged(entry: Mapping[str, Any], result: Mapping[str, Any]) -> dict[str, Any]:
    rows, note = _rows(entry, result)
    bound = next(name for name in BOUNDS if name in entry)
    limit = entry[bound]
    if isinstance(limit, list):  # a path: what the peer reached
        limit = worst(find(rows, limit), bound)
    got = worst(find(rows, entry["path"]), bound)
    state = "not measured"
    if got is not None and limit is not None:
        state = "met" if met(got, limit, bound) else "falls short"
        if state == "falls short" and _once(entry, result):
            state, note = "not measured", "one run on a machine that does other things: no verdict"
    elif not note:
        note = "its rows are missing" + (f": {entry['needs']}" if "needs" in entry else "")
    return {
        "key": f"{entry['area']}.{entry['key']}",
        "area": entry["area"],
        "what": entry["what"],
        "unit": entry.get("unit", ""),
        "bound": bound,
        "asked": limit,
        "got": got,
        "spread": _spread(entry, rows, got),
        "ratio": ratio(got, limit, bound),
        "state": state,
        "peer": worst(find(rows, entry["peer"]), bound) if "peer" in entry else None,
        "peer_name": entry.get("peer_name", ""),
        "source": entry["source"],
        "note": note,
    }


def _once(entry: Mapping[str, Any], result: Mapping[str, Any]) -> bool:
    """Whether a figure is a time that the quick form took once."""
    area = result["areas"].get(entry["area"], {}) if "file" not in entry else {}
    return area.get("form") == "quick" and ("spread" in entry or entry.get("unit") in TIMES)


def limits() -> dict[str, str]:
    """What is known to stand in the way of figures that fall short, by key."""
    return {f"{one['area']}.{one['key']}": one["limit"] for one in asked() if "limit" in one}


def _spread(entry: Mapping[str, Any], rows: Any, got: Any) -> list[float] | None:
    """Lower and upper quartile of the row that counts."""
    values = list(find(rows, entry["path"]))
    spreads = list(find(rows, entry["spread"])) if "spread" in entry else []
    if not spreads or len(spreads) != len(values):
        return None
    one = spreads[values.index(got)]
    return [one[0], one[-1]]


def _rows(entry: Mapping[str, Any], result: Mapping[str, Any]) -> tuple[Any, str]:
    """What an entry's path starts from, and a word on it."""
    if "file" in entry:  # a long run that is not part of this one
        path = RESULTS / entry["file"]
        if not path.is_file():
            return None, f"{entry['file']} is not there"
        rows = json.loads(path.read_text(encoding="utf-8"))
        made = rows.get("made", rows)
        since = f" since {made['commit']}" if "commit" in made else ""
        return rows, f"{KEPT} {entry['file']}{since}"
    if entry["area"] == "bench":
        whole = set(result["areas"]) == set(NAMES) and result["form"] != "quick"
        whole = whole and not any("failed" in area for area in result["areas"].values())
        return (result, "") if whole else (None, "not all areas ran in full or in short")
    area = result["areas"].get(entry["area"])
    if area is None:
        return None, "this area was left out"
    if "failed" in area:
        return None, f"the area failed: {area['failed']}"
    if area["form"] == "quick" and entry.get("quick") is False:
        return None, "not in the quick form"
    return area["rows"], entry.get("short", "") if area["form"] == "short" else ""


def worst(values: Iterator[Any], bound: str) -> Any:
    """The value furthest from what is asked for; None where there is none."""
    found = list(values)
    if not found:
        return None
    if bound == "equals":
        return found[0] if all(one == found[0] for one in found) else str(found)
    return min(found) if bound == "least" else max(found)


def met(got: Any, limit: Any, bound: str) -> bool:
    """Whether a value keeps to its bound."""
    if bound == "equals":
        return bool(got == limit)
    return bool(got >= limit) if bound == "least" else bool(got <= limit)


def ratio(got: Any, limit: Any, bound: str) -> float | None:
    """How many times better than asked; None where that is no number."""
    if bound == "equals" or got is None or limit is None:
        return None
    better, worse = (got, limit) if bound == "least" else (limit, got)
    return float(better / worse) if worse and better else None


def number(value: Any) -> str:
    """A value for people: three or four figures, thousands with commas."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if value and abs(value) < 1e-3:
        return f"{value:.1e}"
    if float(value).is_integer() or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.4g}" if abs(value) >= 1 else f"{value:.3g}"


def cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """One row of the table, in words."""
    sign = {"most": "≤ ", "least": "≥ ", "equals": ""}[row["bound"]]
    what = row["what"] + (f" [{row['unit']}]" if row["unit"] else "")
    peer = f"{number(row['peer'])} {row['peer_name']}" if row["peer"] is not None else ""
    return (
        what + (f" ({row['note']})" if row["note"] else ""),
        sign + number(row["asked"]),
        number(row["got"]),
        " to ".join(map(number, row["spread"])) if row["spread"] else "",
        "" if row["ratio"] is None else f"{row['ratio']:.3g}x",
        row["state"],
        peer,
        row["source"],
    )


def table_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table as text, area after area, and a count at the end."""
    lines = []
    table = [HEADS, *map(cells, rows)]
    widths = [min(max(len(line[k]) for line in table), 78 if k == 0 else 34) for k in range(7)]
    heads = "  ".join(name.ljust(width) for name, width in zip(HEADS, widths, strict=False))
    area = None
    for row in rows:
        if row["area"] != area:
            area = row["area"]
            lines += ["", f"== {area}", heads + "  " + HEADS[-1]]
        line = cells(row)
        text = "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=False))
        lines.append(f"{text}  {line[-1]}")
    return "\n".join([*lines, "", summary(rows)])


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many are met, fall short and were not measured, kept ones apart; which fall short."""
    kept = [row for row in rows if row["note"].startswith(KEPT)]
    run = [row for row in rows if not row["note"].startswith(KEPT)]
    text = f"{_counted(run)} asked for and measured by this run"
    text += f"\n{_counted(kept)} kept from runs before" if kept else ""
    short = [f"  {row['area']}: {cells(row)[0]}: asked {cells(row)[1]}, got {cells(row)[2]}"
             for row in rows if row["state"] == "falls short"]  # fmt: skip
    return "\n".join([text, *short])


def _counted(rows: Sequence[Mapping[str, Any]]) -> str:
    states = [row["state"] for row in rows]
    count = {state: states.count(state) for state in ("met", "falls short", "not measured")}
    return (
        f"{count['met']} met, {count['falls short']} fall short, "
        f"{count['not measured']} not measured, of {len(rows)}"
    )
