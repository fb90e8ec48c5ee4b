"""Write the figures of README.md and docs/figures.md out of benchmarks/results, as printed.

The text between the two comments `figures` and `end of figures` is made here, and in pages of docs
the line below each comment `made: NAME`: at which commit a result was made, and whether the code
that ran has changed since. A test refuses pages that say something else, so that no figure outlives
the run and the code that it came from.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # run as a script
    sys.path.insert(0, str(ROOT))

from benchmarks.harness.record import changed, table, today  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results"
OLDER = 0.05  # of the code that ran for a result: a page shows when more than this has changed
CHANGED = ", with more than a twentieth of their code changed since"
UNKNOWN = ", without a record of the code that ran"
MADE = re.compile(r"(<!-- made: ([a-z_, ]+) -->\n)[^\n]*\n")
Section = tuple[Callable[[Path], list[str]], list[str]]
BETWEEN = re.compile(r"(?<=<!-- figures: make figures -->\n).*?(?=<!-- end of figures -->)", re.S)


def main() -> int:
    """Renew README.md and the pages that show results."""
    code = today()
    for name, sections in PAGES.items():
        page = ROOT / name
        page.write_text(renewed(page.read_text(encoding="utf-8"), code, sections), encoding="utf-8")
    for page in pages():
        page.write_text(dated(page.read_text(encoding="utf-8"), code), encoding="utf-8")
    return 0


def pages() -> list[Path]:
    """Pages of docs with a line of when their results were made."""
    return [one for one in sorted((ROOT / "docs").glob("*.md")) if MADE.search(one.read_text())]


def dated(page: str, code: frozenset[str], results: Path = RESULTS) -> str:
    """A page whose lines below `made` tell the age of the results that they name."""
    return MADE.sub(lambda found: f"{found[1]}{age(found[2].split(', '), code, results)}\n", page)


def age(names: Sequence[str], code: frozenset[str], results: Path = RESULTS) -> str:
    """At which commits results were made, those of today's code first."""
    told: dict[str, list[str]] = {"": [], CHANGED: [], UNKNOWN: []}
    for name in names:
        result = _read(results, name)
        made = result.get("made", result)
        share = changed(result, code)
        notes = [made["date"]] if "date" in made else []
        notes += [] if made.get("clean", True) else ["with changes"]
        before = sorted({*result.get("measured_at", {}).values()} - {made["commit"]})
        notes += [f"some of its tables at {' and '.join(before)}"] if before else []
        since = UNKNOWN if share is None else CHANGED if share > OLDER else ""
        note = f" ({', '.join(notes)})" if notes else ""
        told[since].append(f"`{name}` at {made['commit']}{note}")
    return f"Made: {'; '.join(', '.join(some) + since for since, some in told.items() if some)}."


def renewed(
    page: str, code: frozenset[str], sections: Mapping[str, Section], results: Path = RESULTS
) -> str:
    """A page with the figures of the results in place of its own.

    Raises
    ------
    ValueError
        If the page does not hold the two comments once.
    """
    made = "\n".join(
        line
        for title, (rows, names) in sections.items()
        for line in (
            *([f"## {title}", ""] if title else []),
            *rows(results),
            "",
            age(names, code, results),
            "",
        )
    )
    page, found = BETWEEN.subn(lambda _: f"\n{made}\n", page)
    if found != 1:
        raise ValueError("a page needs `figures: make figures` and `end of figures` once")
    return page


def decisive(results: Path) -> list[str]:
    """The figures that decide, each with its judge and the control that shows it can fail."""
    demo, pressed = _read(results, "demo"), _read(results, "evaluation_physics")
    varied = _read(results, "evaluation_cross_patch_varied")
    patches = _row(varied["rows"], features="contact-geometry")
    trained = [row for row in pressed["rows"] if row["trained_on"] == "ours"]
    frozen = _row(trained, tested_on=pressed["frozen"])
    fingers = _row(_read(results, "real_fingers")["named"], variety=1.0)
    found, live = _area(results, "calibration"), _area(results, "live")
    placed = _row([row for row in found["touch"] if not row.get("one_module")], touches=32)
    checked = [r for r in _read(results, "calibration")["wiring"] if r["touch"] == "checkup"]
    healthy = _row(checked, what="healthy")
    kills, calm = live["recordings"]["kills"], live["live_50_hz"]
    chance = f"chance: {100 / len(pressed['gestures']):.0f} %"
    rows = [
        ("taxels laid flat on the iCub; flipped triangles",
         f"{demo['meshed_taxels']:,} of {demo['taxels']:,}; {demo['flips']}",
         "signed area of every triangle", "maps folded on purpose are counted (a test)"),
        ("four gestures named on a patch left out; on the worst patch (simulated)",
         f"{_share(patches['mean'])}; {_share(patches['worst'])}",
         "touches of our simulator that vary", chance),
        ("the same gestures pressed by MuJoCo (simulated)",
         f"{_share(frozen['mean'])}, calibration error {frozen['ece']:.2f}",
         "a frozen variant of another physics", chance),
        ("one real finger named as one finger",
         f"{_share(fingers['one_contact_of_one_finger'])} of "
         f"{fingers['recordings_of_one_finger']} recordings",
         "CySkin recordings of others; its thresholds were chosen on them",
         f"{_share(fingers['named_a_touch'])} of {fingers['recordings_without_a_touch']} "
         "recordings without a touch are named"),
        ("taxels of a patch placed by 32 touches of 1 mm (simulated)",
         f"median {placed['median_mm']:.2f} mm, 95 % within {placed['p95_mm']:.1f} mm",
         "true positions", "wrong boards are refused ([calibration](docs/calibration.md))"),
        ("swapped or mute modules found in a minute of touches (simulated)",
         _at_least(min(r["found_percent"] for r in checked if r["what"] == "all")),
         "planted faults on three parts",
         f"{healthy['false_alarms']} of {healthy['runs']} healthy skins reported"),
        (f"sample to label, {live['channels']:,} taxels at 50 Hz",
         f"median {calm['latency_ms']['median']:.1f} ms, 99 % within "
         f"{calm['latency_ms']['p99']:.1f} ms",
         f"{calm['seconds'] / 60:.0f} min of a stream", f"{calm['lost']} samples lost"),
        (f"{kills['count']} recorders killed at random moments", f"{kills['opened']} files open",
         "`kill -9`", f"at most {kills['most_lost_s']:.2f} s lost"),
    ]  # fmt: skip
    return _table(("", "figure", "judge", "control"), rows)


def skin(results: Path) -> list[str]:
    """What the demo says of meshes and flat maps."""
    demo = _read(results, "demo")
    edges, normals = demo["edge_rms_percent"], demo["normals"]
    structures, solved = demo["structures"], _area(results, "geometry")["icub"]
    seconds = solved["meshing_seconds"] + solved["flattening_seconds"]
    rows = [
        ("taxels in the surface mesh", f"{demo['meshed_taxels']:,} of {demo['taxels']:,}"),
        ("patches, flipped triangles in their maps", f"{demo['patches']}, {demo['flips']}"),
        ("edge error of the flat maps, rms",
         f"{edges['median']:.2f} % in the median patch, {edges['max']:.2f} % in the worst"),
        ("estimated normals against the nearest face of the body",
         f"median {normals['median_deg']:.1f}°, {100 * normals['share_within_15_deg']:.1f} % "
         f"within 15°, {normals['inward']} point inward"),
        ("periodic structures",
         f"{structures['plain']} plain, {structures['rotated']} with rotation by π/3"),
        ("all parts meshed and flattened", f"{seconds:.1f} s CPU"),
    ]  # fmt: skip
    return _table(("`make demo`", ""), rows)


def names(results: Path) -> list[str]:
    """How many simulated touches got their name, by the demo and over all patches."""
    demo = _read(results, "demo")
    varied, clean = (
        {row["features"]: row for row in _read(results, f"evaluation_cross_patch{name}")["rows"]}
        for name in ("_varied", "")
    )
    older = _read(results, "evaluation_cross_patch_histograms")["rows"]
    clean = {row["features"]: row for row in older} | clean
    titles = (
        ("contact geometry (the default)", "contact-geometry"),
        ("histograms of structures, rest dropped, intersection SVM", "histogram"),
        ("the paper's literal histograms", "paper"),
    )
    cells = [
        (
            title,
            *(
                _share(_row(demo["table"], classifier=key, tested_on=test)["accuracy"])
                for test in ("same_parts", "other_parts")
            ),
            *(
                _share(rows[key][which]) if key in rows else ""
                for rows in (varied, clean)
                for which in ("mean", "worst")
            ),
        )
        for title, key in titles
    ]
    patches = ("each patch left out", "the worst of them", "clean touches", "the worst of them")
    heads = ("touches that vary", "same parts", "other parts", *patches)
    mirror = (
        "Each patch is left out in turn; its mirror image on the other side of the body trains. "
        "Clean touches are pads of fixed sizes on clean sensors (`--variety none`)."
    )
    return [*_table(heads, cells), "", mirror]


def physics(results: Path) -> list[str]:
    """What contact geometry names right where MuJoCo presses, and its calibration error."""
    kept = _read(results, "evaluation_physics")
    rows = kept["rows"]
    tested = list(dict.fromkeys(row["tested_on"] for row in rows))
    trained = ("ours", "foam", "ours and mujoco")
    cells = {(row["trained_on"], row["tested_on"]): row for row in rows}
    table_rows = [
        (
            f"trained on {one}",
            *(f"{_share(cells[one, on]['mean'])} ({cells[one, on]['ece']:.2f})" for on in tested),
        )
        for one in trained
    ]
    heads = [f"{one}, frozen" if one == kept["frozen"] else one for one in tested]
    return _table(("touches that vary, parts left out (calibration error)", *heads), table_rows)


def _at_least(percent: float) -> str:
    return f"{percent:.0f} %" + " or more" * (percent < 100.0)


def _share(value: float) -> str:
    return f"{100 * value:.1f} %"


def _row(rows: Sequence[dict[str, Any]], **wanted: object) -> dict[str, Any]:
    """The row that has these values."""
    return next(row for row in rows if all(row.get(k) == one for k, one in wanted.items()))


def _read(results: Path, name: str) -> Any:
    return json.loads((results / f"{name}.json").read_text(encoding="utf-8"))


def _area(results: Path, name: str) -> dict[str, Any]:
    """Rows of an area: of the last whole `make bench` and of its own program, the later first.

    The whole run leaves out the largest sizes and longest runs of some areas, which their own
    programs have measured: of two of one day, an area's own comes first.
    """
    own: dict[str, Any] = _read(results, name)
    every = _read(results, "bench") if (results / "bench.json").is_file() else {"areas": {}}
    whole = every["areas"].get(name, {}).get("rows", {})
    later = own.get("date", "") >= every.get("date", "")
    return _joined(own, whole) if later else _joined(whole, own)


def _joined(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Both, with the first of two tables on top and the first of two figures alone."""
    joined = dict(second)
    for key, value in first.items():
        other = second.get(key)
        if isinstance(value, list) and isinstance(other, list):
            joined[key] = [*value, *other]
        elif isinstance(value, dict) and isinstance(other, dict):
            joined[key] = _joined(value, other)
        elif value is not None:
            joined[key] = value
    return joined


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [line.replace("|  |", "| |") for line in table(heads, rows)]


PATCHES = "evaluation_cross_patch"
SECTIONS: dict[str, Section] = {
    "The iCub, whole": (skin, ["demo", "geometry"]),
    "Touches named right": (names, ["demo", f"{PATCHES}_varied", PATCHES, f"{PATCHES}_histograms"]),
    "The same touches pressed by another physics": (physics, ["evaluation_physics"]),
}

DECISIVE = (
    decisive,
    ["demo", "evaluation_cross_patch_varied", "evaluation_physics", "real_fingers", "calibration",
     "live"],
)  # fmt: skip
PAGES: dict[str, dict[str, Section]] = {"README.md": {"": DECISIVE}, "docs/figures.md": SECTIONS}

if __name__ == "__main__":
    sys.exit(main())
