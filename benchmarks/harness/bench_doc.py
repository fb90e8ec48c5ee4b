"""docs/benchmarks.md from a run of `make bench`: the same figures as on its page, by their keys."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.asked import cells, limits, number, summary
from benchmarks.harness.record import RESULTS

TARGET = ROOT / "docs" / "benchmarks.md"
HEAD = """# Benchmarks

What the issues ask for beside what came out, the peers in the same run. Written by `make bench`
from `benchmarks/results/bench.json`; `benchmarks/results/bench.html` shows the same with plots.

Commit {commit}; {form} form; {cores} cores of {processor}, {memory} GB; load average {load} at
the start; {minutes:.1f} minutes, {cpu:.0f} s of CPU time. Times are CPU time of one thread,
medians; the spread is from the lower to the upper quartile. Accuracies are simulated where the
words say so. A ratio above 1 is better than asked.

```text
{summary}
```

Every figure has a key that stays: `got`, `asked`, `spread` and `peer` of the row with that `key`
in the list `asked` of `bench.json`. Single figures of the curves below and of
[what a scene needs](needs.md) stand in its list `figures`, as `scaling.CURVE.TAXELS.s` and `.mb`,
`needs.QUESTION.CASE.s` and `.mb`. `make bench-compare OLD=a.json NEW=b.json` compares two runs by
these keys. How the form of a run was shorter than the full one stands with each area:

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
    curves = (areas.get("scaling", {}).get("rows") or {}).get("curves")
    lines += _curves(curves) if curves else ()
    kept = RESULTS / "commands.json"
    if kept.is_file():
        lines += _commands(json.loads(kept.read_text(encoding="utf-8")))
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


def _curves(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """CPU seconds, and memory in MB, of every curve at every size."""
    sizes = sorted({row["taxels"] for row in rows})
    text = "CPU seconds, and memory in MB where it is known, by taxels; `(peer)` is not ours."
    yield from ("", "## Scaling by taxels", "", text, "")
    yield from _row(("curve", *(f"{n:,}" for n in sizes)), head=True)
    measured = [row for row in rows if "cpu_s" in row]
    for name in dict.fromkeys(row["curve"] for row in measured):
        own = {row["taxels"]: row for row in measured if row["curve"] == name}
        peer = " (peer)" if next(iter(own.values()))["peer"] else ""
        yield from _row((name + peer, *(_point(own.get(n)) for n in sizes)))
    for row in rows:
        if "left_out" in row:
            yield f"\nLeft out: {row['curve']} at {row['taxels']:,}: {row['left_out']}."


def _commands(kept: Mapping[str, Any]) -> Iterator[str]:
    """Whole commands beside their imports and necessary work."""
    yield from (
        "",
        "## Commands",
        "",
        f"Written by `make bench-commands` at commit {kept['commit']}, load average "
        f"{kept['machine']['load_average']} at the start: fresh processes, medians, the second run "
        'on (the first one fills the cache). CPU seconds beside those of `python -c "import ..."` '
        "of what the command needs and of the functions that its output is made of; the ratio is "
        "the command's over both together.",
        "",
    )
    heads = ("command", "CPU [s]", "first run", "wall [s]", "MB", "imports", "work", "ratio")
    yield from _row(heads, head=True)
    keys = ("cpu_s", "first_cpu_s", "wall_s", "mb", "imports_cpu_s", "work_cpu_s", "ratio")
    for row in kept["commands"]:
        shown = ["" if row.get(key) is None else f"{row[key]:.3g}" for key in keys]
        shown = shown if "failed" not in row else ["failed", *shown[1:]]
        yield from _row((f"`{row['command']}`", *shown))
    yield ""
    for line, why in kept["left_out"].items():
        yield f"Not measured: `{line}`: {why}.\n"


def _point(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return ""
    memory = (
        f", {row['peak_mb']:,.0f} MB" if row.get("peak_mb") is not None and not row["peer"] else ""
    )
    return number(row["cpu_s"]) + memory


def _row(texts: Sequence[str], *, head: bool = False) -> Iterator[str]:
    yield "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"
    if head:
        yield "|---" * len(texts) + "|"


def write_doc(result: Mapping[str, Any]) -> None:
    """Write docs/benchmarks.md."""
    TARGET.write_text(doc_of(result), encoding="utf-8")


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS / "bench.json"
    write_doc(json.loads(path.read_text(encoding="utf-8")))
