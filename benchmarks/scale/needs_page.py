"""docs/needs.md and its picture, from the rows that needs.py measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import ROOT

DOCS = ROOT / "docs"
PICTURE = "pictures/needs.png"
HEAD = """# Only what a scene needs

Time and memory grow with what is asked for, and nothing else is loaded, meshed, flattened or
trained (`tests/test_one_part.py` holds that for one part of a robot). Written by
`make bench-needs` from `benchmarks/results/needs.json`: commit {commit}, {cores} cores of
{processor}, load average {load};
{turns} fresh processes a case, medians of CPU time of one thread with their quartiles; memory is
the largest resident size above that after the imports ({low:.0f} MB for skins, {high:.0f} MB with
the viewer). A first picture pays about 130 MB for the renderer itself.

![CPU time (bars) and memory (dots) of each case]({picture})
"""


def write_page(result: Mapping[str, Any], folder: Path = DOCS) -> None:
    """Write the page and its picture."""
    from matplotlib import pyplot

    figure = bars(result["cases"])
    figure.savefig(folder / PICTURE, dpi=100, metadata={"Software": None})
    pyplot.close(figure)
    (folder / "needs.md").write_text(page_of(result), encoding="utf-8")


def page_of(result: Mapping[str, Any]) -> str:
    """The page as Markdown: a table for each question, and how much the last case costs more."""
    from benchmarks.scale.needs import WHATS

    machine, cases = result["machine"], result["cases"]
    imports = [row["imports_mb"] for row in cases]
    lines = [
        HEAD.format(
            commit=result["commit"], cores=machine["cores"], processor=machine["processor"],
            load=machine["load_average"], turns=cases[0]["turns"], picture=PICTURE,
            low=min(imports), high=max(imports),
        )
    ]  # fmt: skip
    for what, (_, text) in WHATS.items():
        rows = [row for row in cases if row["what"] == what]
        lines += [f"## {what.capitalize()}", "", f"{text}.", "", *_table(rows), ""]
        lines += [growth(rows), ""]
    return "\n".join(lines)


def _table(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    size = next((name for name in ("taxels", "triangles") if rows[0][name]), None)
    heads = ["case", *([size] if size else []), "CPU [s]", "quartiles", "memory [MB]"]
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for row in rows:
        low, high = row["spread_s"][::2] if row["spread_s"] else (None, None)
        cells = [row["case"], *([f"{row[size]:,.0f}"] if size else []), f"{row['cpu_s']:.3f}"]
        cells += ["–" if low is None else f"{low:.3f} to {high:.3f}", f"{row['mb']:.0f}"]
        yield f"| {' | '.join(cells)} |"


def growth(rows: Sequence[Mapping[str, Any]]) -> str:
    """In words how much more the last case takes than the first."""
    from benchmarks.scale.needs_cases import AS_READ

    reduced = [row for row in rows if row["case"] != AS_READ]
    first, last = reduced[0], reduced[-1]
    text = f"From {first['case']} to {last['case']}: {last['cpu_s'] / first['cpu_s']:.2g} times the"
    text += f" time and {last['mb'] - first['mb']:+.0f} MB"
    size = next((name for name in ("taxels", "triangles") if first[name]), None)
    if size and last[size] != first[size]:
        text += f", for {last[size] / first[size]:.3g} times the {size}"
    return text + "."


def bars(rows: Sequence[Mapping[str, Any]]) -> Any:
    """A matplotlib figure: CPU time as bars and memory as dots, a panel for each question."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    whats = list(dict.fromkeys(row["what"] for row in rows))
    lines = (len(whats) + 2) // 3
    figure, axes = pyplot.subplots(
        lines, 3, figsize=(11.0, 3.0 * lines), layout="constrained", squeeze=False
    )
    for axis, what in zip(axes.flat, whats, strict=False):
        _panel(axis, what, [row for row in rows if row["what"] == what])
    for axis in axes.flat[len(whats) :]:
        axis.set_axis_off()
    return figure


def _panel(axis: Any, what: str, rows: Sequence[Mapping[str, Any]]) -> None:
    place = range(len(rows))
    seconds = [row["cpu_s"] for row in rows]
    spread = [row["spread_s"] or (one, one, one) for row, one in zip(rows, seconds, strict=True)]
    reach = [[mid - low for low, mid, _ in spread], [high - mid for _, mid, high in spread]]
    axis.bar(place, seconds, yerr=reach, color="#9ecae1", width=0.6, ecolor="#777777", capsize=2)
    axis.set_xticks(place, [row["case"].replace(" ", "\n") for row in rows], fontsize=7)
    axis.set_title(what + (" [cell, mm]" if what == "mesh detail" else ""), fontsize=10)
    axis.set_ylabel("CPU [s]", fontsize=8, color="#3182bd")
    other = axis.twinx()
    other.plot(place, [row["mb"] for row in rows], "o-", color="#d1495b", ms=5, lw=1)
    other.set_ylabel("memory [MB]", fontsize=8, color="#d1495b")
    other.set_ylim(0, 1.25 * max(max(row["mb"] for row in rows), 1.0))
