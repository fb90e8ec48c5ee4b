"""One self-contained page of a run of `make bench`: the table of what is asked, and the curves."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.harness.asked import HEADS, cells, summary
from benchmarks.scale.needs_page import bars

STYLE = """
body { font: 15px/1.45 sans-serif; color: #222; max-width: 1180px; margin: 2em auto }
body { padding: 0 1em }
h1 { font-size: 1.6em } h2 { margin-top: 2em; border-bottom: 1px solid #ccc }
table { border-collapse: collapse; width: 100%; font-size: 13px }
table.asked { table-layout: fixed }
.asked th:nth-child(1) { width: 34% } .asked th:nth-child(4) { width: 12% }
.asked th:nth-child(6) { width: 9% } .asked th:nth-child(7) { width: 16% }
.asked th:nth-child(8) { width: 7% } .asked td:nth-child(8) { white-space: nowrap }
.asked th:nth-child(n+2):nth-child(-n+5) { text-align: right }
th, td { text-align: left; padding: 3px 8px; border-bottom: 1px solid #e4e4e4; vertical-align: top }
th { background: #f3f4f6 } td.number { text-align: right; white-space: nowrap }
tr.short td { background: #fdecea } tr.not td { color: #777 }
.state { font-weight: bold; white-space: nowrap } .met { color: #1b7837 }
.short .state { color: #b2182b }
figure { margin: 1em 0 } img { max-width: 100% } .failed { color: #b2182b; font-weight: bold }
p.small { color: #555; font-size: 13px }
"""
CLASSES = {"met": "good", "falls short": "short", "not measured": "not"}
COLOURS = ("#1b6ca8", "#d1495b", "#2e933c", "#8d6a9f", "#e39c1c", "#00798c", "#555555")
FAMILIES = (
    "meshing", "flattening", "neighbourhoods", "structures", "histogram", "contacts", "drawing",
)  # fmt: skip


def page_of(result: Mapping[str, Any]) -> str:
    """The page: head, table, what each area took, curves, needs, versions."""
    parts = [
        "<!doctype html>", '<html lang="en"><head><meta charset="utf-8">',
        f"<title>Skinmap: what is asked and what is got</title><style>{STYLE}</style></head><body>",
        "<h1>Skinmap: what is asked and what is got</h1>", _head(result),
        f"<pre>{html.escape(summary(result['asked']))}</pre>",
    ]  # fmt: skip
    for area in dict.fromkeys(row["area"] for row in result["asked"]):
        parts += [f"<h2>{html.escape(area)}</h2>", _note(result, area), _table(result, area)]
    parts += [*_curves(result), *_needs(result), _areas(result), _versions(result)]
    return "\n".join([*parts, "</body></html>"]) + "\n"


def _head(result: Mapping[str, Any]) -> str:
    machine = result["machine"]
    form = {
        "short": "the short form of each area",
        "full": "the full form of each area",
        "quick": "the quick form, which only shows that all runs: no figures to keep",
    }
    return (
        f"<p>Commit {html.escape(str(result['commit']))}; {form[result['form']]}; "
        f"{machine['cores']} cores of {html.escape(machine['processor'])}, "
        f"{machine['memory_gb']} GB; load average {machine['load_average']} at the start; "
        f"{result['seconds'] / 60:.1f} minutes. Accuracies are simulated where the figure says so; "
        "times are CPU time of one thread, medians, unless said otherwise.</p>"
    )


def _note(result: Mapping[str, Any], area: str) -> str:
    found = result["areas"].get(area)
    if found is None:
        return ""
    if "failed" in found:
        return f'<p class="failed">This area failed: {html.escape(found["failed"])}</p>'
    shorter = f"Short form: {html.escape(found['shorter'])}. " if found["shorter"] else ""
    return f'<p class="small">{shorter}{found["seconds"]:.0f} s.</p>'


def _table(result: Mapping[str, Any], area: str) -> str:
    heads = "".join(f"<th>{html.escape(head)}</th>" for head in HEADS)
    lines = []
    for row in result["asked"]:
        if row["area"] != area:
            continue
        what, asked, got, spread, ratio, state, peer, source = map(html.escape, cells(row))
        good = " met" if row["state"] == "met" else ""
        lines.append(
            f'<tr class="{CLASSES[row["state"]]}"><td>{what}</td><td class="number">{asked}</td>'
            f'<td class="number">{got}</td><td class="number">{spread}</td>'
            f'<td class="number">{ratio}</td>'
            f'<td class="state{good}">{state}</td><td>{peer}</td><td>{source}</td></tr>'
        )
    return f'<table class="asked"><tr>{heads}</tr>{"".join(lines)}</table>'


def _curves(result: Mapping[str, Any]) -> list[str]:
    rows = (result["areas"].get("scaling", {}).get("rows") or {}).get("curves")
    if not rows:
        return []
    missing = [f"{row['curve']} at {row['taxels']:,}: {row['left_out']}"
               for row in rows if "left_out" in row]  # fmt: skip
    text = "CPU seconds of one thread (left) and memory (right); dashed lines are peers."
    parts = ["<h2>Scaling curves</h2>", f"<p>{text}</p>", _picture(_scaling(rows))]
    if missing:
        parts.append(f'<p class="small">Left out: {html.escape("; ".join(missing))}.</p>')
    flat = (result["areas"].get("geometry", {}).get("rows") or {}).get("flattening")
    if flat:
        parts += ["<h2>Flattening beside its peers</h2>", _picture(_flattening(flat))]
    return parts


def _needs(result: Mapping[str, Any]) -> list[str]:
    rows = (result["areas"].get("needs", {}).get("rows") or {}).get("cases")
    text = "<p>Fresh processes, after the imports; bars are CPU time, dots are memory.</p>"
    return ["<h2>Only what a scene needs</h2>", text, _picture(bars(rows))] if rows else []


def _areas(result: Mapping[str, Any]) -> str:
    lines = "".join(
        f"<tr><td>{html.escape(name)}</td><td>{found['seconds']:.0f}</td>"
        f"<td>{found['cpu_seconds']:.0f}</td><td>{found['load_average']:.2f}</td>"
        f"<td>{html.escape(found.get('failed', 'done'))}</td></tr>"
        for name, found in result["areas"].items()
    )
    heads = "<th>area</th><th>wall [s]</th><th>CPU [s]</th><th>load before</th><th>state</th>"
    return f"<h2>Areas</h2><table><tr>{heads}</tr>{lines}</table>"


def _versions(result: Mapping[str, Any]) -> str:
    names = ", ".join(f"{name} {what}" for name, what in result["versions"].items())
    return f"<h2>Versions</h2><p>Python {result['python']}; {html.escape(names)}.</p>"


def _picture(figure: Any) -> str:
    from matplotlib import pyplot

    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    pyplot.close(figure)
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    return f'<figure><img alt="plot" src="data:image/png;base64,{data}"></figure>'


def _subplots(*shape: int, size: tuple[float, float]) -> Any:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot.subplots(*shape, figsize=size, layout="constrained", squeeze=False)


def _scaling(rows: Sequence[Mapping[str, Any]]) -> Any:
    families = [f for f in FAMILIES if any(r["curve"].startswith(f) and "cpu_s" in r for r in rows)]
    figure, axes = _subplots(len(families), 2, size=(11.0, 3.1 * len(families)))
    for line, family in zip(axes, families, strict=True):
        some = [row for row in rows if row["curve"].startswith(family) and "cpu_s" in row]
        for colour, name in zip(COLOURS, dict.fromkeys(row["curve"] for row in some), strict=False):
            own = [row for row in some if row["curve"] == name]
            style = {"color": colour, "label": name, "ls": "--" if own[0]["peer"] else "-"}
            sizes = [row["taxels"] for row in own]
            line[0].loglog(sizes, [row["cpu_s"] for row in own], marker="o", ms=4, **style)
            memory = [row.get("peak_mb") for row in own]
            if not own[0]["peer"] and any(memory):
                line[1].loglog(sizes, [max(m or 0, 0.1) for m in memory], marker="s", ms=4, **style)
        for axis, label in zip(
            line, ("CPU time [s]", "memory above the imports [MB]"), strict=True
        ):
            axis.set_ylabel(label)
            axis.set_xlim(700, 1.5e6)
            axis.grid(which="major", alpha=0.3)
        line[0].legend(fontsize=8, frameon=False)
        if not line[1].lines:  # within what the input took
            line[1].set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel("taxels")
    return figure


def _flattening(rows: Sequence[Mapping[str, Any]]) -> Any:
    figure, axes = _subplots(1, 1, size=(9.0, 4.6))
    axis = axes[0, 0]
    names = dict.fromkeys(row["method"] for row in rows if "method" in row)
    kept = [name for name in names if name not in ("tutte", "harmonic", "lscm")]
    for place, name in enumerate(kept):
        own = sorted((row["n"], row["seconds"]) for row in rows if row.get("method") == name)
        peer = any(row["peer"] for row in rows if row.get("method") == name)
        colour = COLOURS[place % len(COLOURS)]
        axis.loglog(*zip(*own, strict=True), color=colour, marker="o", ms=4,
                    ls="--" if peer else "-", label=name)  # fmt: skip
    factors = sorted((row["n"], row["seconds"]) for row in rows if row.get("is_C"))
    axis.loglog(*zip(*factors, strict=True), "k:", label="one factorisation")
    axis.set_xlabel("vertices")
    axis.set_ylabel("CPU time [s]")
    axis.grid(which="major", alpha=0.3)
    axis.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
