"""docs/benchmarks.md from a run of `make bench`: the same figures as on its page, by their keys.

    python -m benchmarks.harness.bench_doc

judges the kept run again by today's bounds and results of other runs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.asked import cells, judge, limits, summary
from benchmarks.harness.record import RESULTS, write

TARGET = ROOT / "docs" / "benchmarks.md"
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
HEADS = ("key", "what", "asked", "got", "spread", "ratio", "", "peer")


def doc_of(result: Mapping[str, Any]) -> str:
    """The page as Markdown."""
    machine, areas = result["machine"], result["areas"]
    lines = [
        HEAD.format(
            commit=result["commit"], form=result["form"], cores=machine["cores"],
            processor=machine["processor"], memory=machine["memory_gb"],
            load=machine["load_average"], minutes=result["seconds"] / 60.0,
            cpu=sum(area["cpu_seconds"] for area in areas.values()),
            summary=summary(result["asked"]),
        ),
        *_areas(areas),
    ]  # fmt: skip
    for area in dict.fromkeys(row["area"] for row in result["asked"]):
        rows = [row for row in result["asked"] if row["area"] == area]
        lines += ["", f"## {area.capitalize()}", "", *_table(rows), *_limits(rows)]
    return "\n".join([*lines, ""])


def _areas(areas: Mapping[str, Any]) -> Iterator[str]:
    yield from _row(
        ("area", "wall [s]", "CPU [s]", "load before", "shorter by", "state"), head=True
    )
    for name, area in areas.items():
        state = area.get("failed", "done")
        times = [f"{area[key]:.0f}" for key in ("seconds", "cpu_seconds")]
        yield from _row((name, *times, f"{area['load_average']:.2f}", area["shorter"], state))


def _table(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield from _row(HEADS, head=True)
    for row in rows:
        what, asked, got, spread, ratio, state, peer, _ = cells(row)
        bold = f"**{state}**" if state == "falls short" else state
        yield from _row((f"`{row['key']}`", what, asked, got, spread, ratio, bold, peer))


def _limits(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """What stands in the way of the figures that fall short, where that is known."""
    known = limits()
    for row in rows:
        if row["state"] == "falls short" and row["key"] in known:
            yield from ("", f"`{row['key']}`: {known[row['key']]}")


def _row(texts: Sequence[str], *, head: bool = False) -> Iterator[str]:
    yield "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"
    if head:
        yield "|---" * len(texts) + "|"


def write_doc(result: Mapping[str, Any]) -> None:
    """Write docs/benchmarks.md."""
    TARGET.write_text(doc_of(result), encoding="utf-8")


if __name__ == "__main__":
    kept = RESULTS / "bench.json"
    run = json.loads(kept.read_text(encoding="utf-8"))
    run["asked"] = judge(run)
    write(kept, run)
    write_doc(run)
