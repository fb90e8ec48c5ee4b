"""What `skinmap evaluate` prints for people and writes into `--out`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from skinmap.report.result import plain
from skinmap.report.table import table


def show(result: dict[str, Any]) -> None:
    """Print the tables of a result."""
    shows = {
        "kaspar": _show_kaspar,
        "baxter": _show_baxter,
        "cross-patch": _show_cross_patch,
        "recordings": _show_recordings,
    }
    shows[result["protocol"]](result)


def write(result: dict[str, Any], out: Path) -> list[str]:
    """Write the result as JSON and its pictures; names of the files."""
    from skinmap.cli.evaluate import figures
    from skinmap.io.output import staged_folder

    files = ["evaluation.json"]
    with staged_folder(out) as stage:
        text = json.dumps(plain(result), indent=2, allow_nan=False)
        (stage / files[0]).write_text(text + "\n", encoding="utf-8")
        if result["protocol"] == "kaspar":
            figures.kaspar_figure(result, stage / "kaspar.png")
            figures.sweep_figure(result["sweep"], stage / "sweep.png")
            files += ["kaspar.png", "sweep.png"]
        elif result["protocol"] == "cross-patch":
            figures.patches_figure(result, stage / "patches.png")
            files.append("patches.png")
        elif result["protocol"] == "recordings":
            figures.leak_figure(result, stage / "leak.png")
            files.append("leak.png")
    return files


def _percent(value: float | None) -> str:
    return "" if value is None or value != value else f"{100 * value:.1f}"


def _show_kaspar(result: dict[str, Any]) -> None:
    click.echo(
        f"{result['robot']} {result['part']}, {result['taxels']} taxels, "
        f"{len(result['seeds'])} seeds, touches {result['places']} (simulated); accuracy in %"
    )
    classes = list(result["samples"])
    rows = [(row, f"{100 * row['std']:.1f}") for row in result["table"]]
    rows += [({**row, "folds": "paper"}, "") for row in result["paper"]]
    table(
        ["percent", "folds", "features", "classifier", *classes, "mean", "std"],
        [
            [
                f"{row['percent']} %",
                row["folds"],
                row["features"],
                row["classifier"],
                *(_percent(row["per_class"][name]) for name in classes),
                _percent(row["mean"]),
                std,
            ]
            for row, std in rows
        ],
    )
    click.echo("\ncarry-over between patches with other numbers of taxels, 10 %, by event")
    table(
        ["features", "same patch", "other patches", "worst", "worst pair"],
        [
            [
                row["features"],
                _percent(row["same"]),
                _percent(row["other"]),
                _percent(row["worst"]),
                " > ".join(row["worst_pair"]),
            ]
            for row in result["carry_over"]["summary"]
        ],
    )
    if result["sweep"]:
        click.echo("\nradius and codewords a structure, 10 %, by event")
        _show_sweep(result["sweep"])


def _show_sweep(rows: list[dict[str, Any]]) -> None:
    words = list(dict.fromkeys(row["words"] for row in rows))
    radii = list(dict.fromkeys(row["radius_mm"] for row in rows))
    cells = {(row["radius_mm"], row["words"]): row for row in rows}
    table(
        ["r [mm]", "structures", *(f"k = {k}" for k in words)],
        [
            [
                f"{r:g}",
                cells[r, words[0]]["structures"],
                *(_percent(cells[r, k]["mean"]) for k in words),
            ]
            for r in radii
        ],
    )


def _show_cross_patch(result: dict[str, Any]) -> None:
    where = "leave one patch out"
    if result["train_robot"]:
        where = f"trained on {result['train_robot']}"
    click.echo(
        f"{result['robot']}, {len(result['patches'])} patches, {where}, "
        f"{len(result['seeds'])} seeds (simulated); accuracy in % of touches"
    )
    classes = list(result["gestures"])
    table(
        ["features", "classifier", "mean", "worst", "worst patch", *classes],
        [
            [
                row["features"],
                row["classifier"],
                _percent(row["mean"]),
                _percent(row["worst"]),
                row["worst_patch"],
                *(_percent(row["per_class"].get(name)) for name in classes),
            ]
            for row in result["rows"]
        ],
    )


def _show_recordings(result: dict[str, Any]) -> None:
    touches = ", ".join(f"{count} {name}" for name, count in result["touches"].items())
    click.echo(f"{touches} on {', '.join(result['parts'])}; {result['folds']} folds; in %")
    classes = list(result["touches"])
    table(
        ["classifier", "folds", *classes, "mean", "std"],
        [
            [
                row["classifier"],
                row["folds"],
                *(_percent(row["per_class"].get(name)) for name in classes),
                _percent(row["mean"]),
                f"{100 * row['std']:.1f}",
            ]
            for row in result["table"]
        ],
    )
    for row in result["leak"]:
        click.echo(f"plain folds flatter {row['classifier']} by {row['points']:.1f} points")
    for name, why in result["skipped"].items():
        click.echo(f"{name} was left out: {why}")


def _show_baxter(result: dict[str, Any]) -> None:
    click.echo(
        f"{result['robot']} {result['part']}, {result['images']} images of {result['touches']} "
        f"touches (simulated), {result['repeats']} splits 70/30; mean of the diagonal in %"
    )
    methods = [name for name in result["confusion"] if name != "labels"]
    table(
        ["method", "split", "mean", "min", "max"],
        [
            [name, split, *(_percent(found[key]) for key in ("mean", "min", "max"))]
            for name in methods
            for split, found in (("by touch", result[name]), ("plain", result[name]["plain"]))
        ],
    )
