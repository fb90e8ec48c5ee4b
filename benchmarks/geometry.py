"""Surface meshes, flat maps and contact images, with the peers in one run: `make bench-geometry`.

Writes benchmarks/results/geometry.json and cost_of_flattening.png. CPU time of one thread; C is
one sparse Cholesky (or LDL or LU) factorisation of the same mesh's cotangent Laplacian by the
fastest solver installed, measured in turns with everything else. `--quick` takes 1,000 vertices
only and leaves out what takes long.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from contact_images import contact_image_rows
from meshing import meshing_rows, missing
from saddle import flattening_rows, large_rows

RESULTS = Path(__file__).parent / "results"
SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
LARGE = 1_000_000
LIBRARIES = (
    "numpy", "scipy", "libigl", "cholespy", "scikit-sparse", "pymeshlab", "potpourri3d", "open3d",
    "numba",
)  # fmt: skip
# (method, n, most C): what issue and design ask for.
MOST_C = (("fast", 100_000, 2.0), ("balanced", 100_000, 7.0), ("dirichlet", 100_000, 15.0))
PLOTTED = ("fast", "balanced", "dirichlet", "libigl LSCM", "libigl ARAP-10 from BFF",
           "libigl SLIM-2 from BFF")  # fmt: skip


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="1,000 vertices only")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    options = parser.parse_args()
    started = time.process_time()
    result: dict[str, Any] = {"commit": _commit(), "versions": _versions(), "threads": 1}
    rows = flattening_rows((1_000,) if options.quick else SIZES)
    if not options.quick:
        rows += large_rows(LARGE, ("fast", "balanced", "dirichlet"))
    result["flattening"] = rows
    result["exponents"] = exponents(rows)
    result["cost_model"] = cost_model(rows)
    result["icub"] = icub_row(repeats=1 if options.quick else 5)
    result["meshing"] = meshing_rows((1_000,) if options.quick else (1_000, 10_000))
    result["meshing_peers_not_installed"] = missing()
    if not options.quick:
        result["contact_images"] = contact_image_rows()
    result["goals"] = goals(result)
    result["cpu_seconds"] = time.process_time() - started
    options.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(result, indent=1, allow_nan=False)
    (options.out / "geometry.json").write_text(text + "\n", encoding="utf-8")
    plot(rows, result["exponents"], options.out / "cost_of_flattening.png")
    for goal in result["goals"]:
        print(f"{'met   ' if goal['met'] else 'MISSED'} {goal['what']}: "
              f"{goal['reached']:.4g}, asked {goal['asked']:.4g}")  # fmt: skip


def exponents(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Slope of log seconds over log n of each method, from 10,000 vertices on where possible."""
    fits = {}
    for name in dict.fromkeys(row["method"] for row in rows if "method" in row):
        points = np.array([(row["n"], row["seconds"]) for row in rows if row.get("method") == name])
        large = points[points[:, 0] >= 9_000]
        if len(large) >= 2:
            fits[name] = float(np.polyfit(*np.log(large).T, 1)[0])
    return fits


def cost_model(rows: list[dict[str, Any]]) -> dict[str, tuple[float, float]]:
    """What `auto` needs: seconds at 100,000 vertices and exponent, `fast` taken off the others."""
    model = {}
    for name in ("fast", "balanced", "dirichlet"):
        seconds = {row["n"]: row["seconds"] for row in rows if row.get("method") == name}
        base = {row["n"]: row["seconds"] for row in rows if row.get("method") == "fast"}
        sizes = np.array([n for n in seconds if n >= 900], float)
        values = np.array([seconds[n] - (base[n] if name != "fast" else 0.0) for n in seconds])
        if len(sizes) >= 2 and (values > 0).all():
            slope, level = np.polyfit(np.log(sizes / 1e5), np.log(values), 1)
            model[name] = (float(np.exp(level)), float(slope))
    return model


def icub_row(repeats: int) -> dict[str, Any]:
    """All parts of the iCub meshed and flattened, warm."""
    import skinmap
    from skinmap.flat.flat_map import flatten
    from skinmap.surface.surface_mesh import build_surface

    robot = skinmap.load_robot("icub")
    skins = [robot.skin(part) for part in robot.parts]
    times = []
    for _ in range(repeats + 1):  # the first warms up
        started = time.process_time()
        meshes = [build_surface(skin) for skin in skins]
        meshed = time.process_time()
        maps = [flatten(mesh) for mesh in meshes]
        times.append((meshed - started, time.process_time() - meshed))
    charts = [chart for flat in maps for chart in flat.charts]
    errors = [100.0 * chart.distortion.edge_rms for chart in charts]
    meshing, flattening = np.median(times[1:], axis=0)
    return {
        "patches": len(charts),
        "flips": sum(flat.flips for flat in maps),
        "edge_rms_percent": {"median": float(np.median(errors)), "worst": max(errors)},
        "meshing_seconds": float(meshing),
        "flattening_seconds": float(flattening),
    }


def goals(result: dict[str, Any]) -> list[dict[str, Any]]:
    """What was asked for beside what was reached; only what this run measured."""
    by_method = {
        (row["method"], round(row["n"], -4)): row for row in result["flattening"] if "method" in row
    }
    asked: list[tuple[str, float, float]] = []
    for name, n, most in MOST_C:
        if (name, n) in by_method:
            asked.append((f"{name} at {n:,} vertices [C]", by_method[name, n]["C"], most))
    if ("dirichlet", 100_000) in by_method:
        ours = by_method["dirichlet", 100_000]["symmetric_dirichlet"]
        slim = by_method["libigl SLIM-2 from BFF", 100_000]["symmetric_dirichlet"]
        asked.append(("symmetric Dirichlet of dirichlet against SLIM-2", ours, slim))
    if ("fast", LARGE) in by_method:
        row = by_method["fast", LARGE]
        asked.append(("memory of fast at 1,000,000 vertices [GB]", row["peak_gb"], 8.0))
        asked.append(("flips of fast at 1,000,000 vertices", row["flips"], 0))
    icub = result["icub"]
    asked += [
        ("iCub: flips", icub["flips"], 0),
        ("iCub: worst edge rms [%]", icub["edge_rms_percent"]["worst"], 1.4),
        ("iCub: median edge rms [%]", icub["edge_rms_percent"]["median"], 0.5),
        ("iCub: meshed and flattened, warm [s]",
         icub["meshing_seconds"] + icub["flattening_seconds"], 0.6),
    ]  # fmt: skip
    asked += [
        ("10,000 taxels meshed by consensus [s]", row["cpu_s"], 0.3)
        for row in result["meshing"]
        if row["method"] == "consensus" and row["n"] == 10_000
    ]
    if "contact_images" in result:
        small, large = result["contact_images"]
        asked += [
            ("contact image 66 x 100, one sample [us]", small["image_us"], 15.0),
            ("contact image 66 x 100, batch [us]", small["batch_us_per_sample"], 3.0),
            ("contact image 512 x 512 [bandwidth bounds]", large["times_bandwidth_bound"], 2.0),
        ]
    return [
        {"what": what, "reached": reached, "asked": most, "met": bool(reached <= most)}
        for what, reached, most in asked
    ]


def plot(rows: list[dict[str, Any]], fits: dict[str, float], target: Path) -> None:
    """CPU seconds against vertices, both logarithmic, with the fitted exponents."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.5, 5.0), layout="constrained")
    factors = sorted((row["n"], row["seconds"]) for row in rows if row.get("is_C"))
    axes.loglog(*zip(*factors, strict=True), "k--", lw=1, label="C: one factorisation")
    for name in PLOTTED:
        points = sorted((row["n"], row["seconds"]) for row in rows if row.get("method") == name)
        if not points:
            continue
        slope = f", n^{fits[name]:.2f}" if name in fits else ""
        style = ":s" if name.startswith("libigl") else "-o"
        axes.loglog(*zip(*points, strict=True), style, ms=4, label=name + slope)
    axes.set_xlabel("vertices n")
    axes.set_ylabel("CPU time of one thread [s]")
    axes.set_title("Cost of flattening a saddle")
    axes.grid(which="major", alpha=0.3)
    axes.legend(frameon=False, fontsize=9)
    figure.savefig(target, dpi=110)
    pyplot.close(figure)


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _commit() -> str:
    here = Path(__file__).parent
    command = ["git", "-C", str(here), "describe", "--always", "--dirty"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    return run.stdout.strip() or "unknown"


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    main()
