"""What the issues ask for, beside what a run of `make bench` got: benchmarks/asked.toml, judged.

Each entry of the table names an area, a path into its rows, a bound (`most`, `least` or
`equals`), a unit and where the bound comes from. A path is a list of keys; a table in it picks
the rows of a list that have these values. Where it picks several, the worst of them counts.

    python -m benchmarks.harness.asked

judges the kept run again, by today's bounds and results of other runs, and writes
docs/benchmarks.md.
"""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.areas import AREAS
from benchmarks.harness.record import RESULTS, table, write
from skinmap.report.table import Table

TABLE = ROOT / "benchmarks" / "asked.toml"
KEPT = "kept in"  # a file: what a note on a figure of another run begins with
BOUNDS = ("most", "least", "equals")
TIMES = ("s", "ms", "us", "times", "factorisations C", "s wall")
SHORT = "falls short"
HEADS = ("key", "what", "asked", "got", "spread", "ratio", "", "peer")
PAGE = ROOT / "docs" / "benchmarks.md"
HEAD = """# Benchmarks

Bounds beside what came out, with the peers in the same run. Written by `make bench` from
`benchmarks/results/bench.json`.

Commit {commit}; {form} form; {cores} cores of {processor}, {memory} GB; load average {load} at
the start; {minutes:.1f} minutes, {cpu:.0f} s of CPU time. Times are CPU time of one thread,
medians; the spread is from the lower to the upper quartile. Accuracies are simulated where the
words say so. A ratio above 1 is better than asked.

```text
{summary}
```

How the form of a run was shorter than the full one stands with each area:

"""


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
        than asked. `state` is "met", SHORT or "not measured"; `note` says why, or from
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
        state = "met" if met(got, limit, bound) else SHORT
        if state == SHORT and _once(entry, result):
            state, note = "not measured", "one run on a machine that does other things: no verdict"
    elif not note:
        note = "its rows are missing" + (f": {entry['needs']}" if "needs" in entry else "")
    return {
        "key": f"{entry['area']}.{entry['key']}",
        **{name: entry.get(name, "") for name in ("area", "what", "unit")},
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
        whole = set(result["areas"]) == set(AREAS) and result["form"] != "quick"
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
    """One row of the table, in words: a cell under each of `HEADS`."""
    sign = {"most": "≤ ", "least": "≥ ", "equals": ""}[row["bound"]]
    what = row["what"] + (f" [{row['unit']}]" if row["unit"] else "")
    return (
        row["key"],
        what + (f" ({row['note']})" if row["note"] else ""),
        sign + number(row["asked"]),
        number(row["got"]),
        " to ".join(map(number, row["spread"])) if row["spread"] else "",
        "" if row["ratio"] is None else f"{row['ratio']:.3g}x",
        row["state"],
        f"{number(row['peer'])} {row['peer_name']}" if row["peer"] is not None else "",
    )


def by_area(rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, list[Mapping[str, Any]]]]:
    """Judged rows, area after area."""
    for area in dict.fromkeys(row["area"] for row in rows):
        yield area, [row for row in rows if row["area"] == area]


def print_table(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print all rows, area after area, and a count at the end."""
    for area, own in by_area(rows):
        print(f"\n== {area}")
        Table(HEADS, [cells(row) for row in own]).print()
    print(f"\n{summary(rows)}")


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many are met, fall short and were not measured, kept ones apart; which fall short."""
    kept = [row for row in rows if row["note"].startswith(KEPT)]
    run = [row for row in rows if not row["note"].startswith(KEPT)]
    lines = [f"{_counted(run)} asked for and measured by this run"]
    lines += [f"{_counted(kept)} kept from runs before"] * bool(kept)
    for row in rows:
        if row["state"] == SHORT:
            _, what, wanted, got, *_ = cells(row)
            lines.append(f"  {row['area']}: {what}: asked {wanted}, got {got}")
    return "\n".join(lines)


def _counted(rows: Sequence[Mapping[str, Any]]) -> str:
    count = Counter(row["state"] for row in rows)
    return (
        f"{count['met']} met, {count[SHORT]} fall short, "
        f"{count['not measured']} not measured, of {len(rows)}"
    )


def doc_of(result: Mapping[str, Any]) -> str:
    """The page as Markdown."""
    machine, areas, known = result["machine"], result["areas"], limits()
    ran = [
        (name, *(f"{area[key]:.0f}" for key in ("seconds", "cpu_seconds")),
         f"{area['load_average']:.2f}", area["shorter"], area.get("failed", "done"))
        for name, area in areas.items()
    ]  # fmt: skip
    lines = [
        HEAD.format(
            commit=result["commit"], form=result["form"], cores=machine["cores"],
            processor=machine["processor"], memory=machine["memory_gb"],
            load=machine["load_average"], minutes=result["seconds"] / 60.0,
            cpu=sum(area["cpu_seconds"] for area in areas.values()),
            summary=summary(result["asked"]),
        ),
        *table(("area", "wall [s]", "CPU [s]", "load before", "shorter by", "state"), ran),
    ]  # fmt: skip
    for area, rows in by_area(result["asked"]):
        shown = []
        for row in rows:
            key, *rest, state, peer = cells(row)
            shown.append((f"`{key}`", *rest, f"**{state}**" if state == SHORT else state, peer))
        lines += ["", f"## {area.capitalize()}", "", *table(HEADS, shown)]
        for row in rows:
            if row["state"] == SHORT and row["key"] in known:
                lines += ["", f"`{row['key']}`: {known[row['key']]}"]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    judged = json.loads((RESULTS / "bench.json").read_text(encoding="utf-8"))
    judged["asked"] = judge(judged)
    write(RESULTS / "bench.json", judged)
    PAGE.write_text(doc_of(judged), encoding="utf-8")
