"""The single figures of a run of `make bench`, by name: what `compare.py` compares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def figures_of(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """All figures of a run.

    Returns
    -------
    list of dict
        `area, name, unit, value, better` ("less" or "more") and `spread`: lower and upper
        quartile, or None where only one value was taken.
    """
    return [*_asked(result["asked"]), *_scaling(_rows(result, "scaling")),
            *_needs(_rows(result, "needs"))]  # fmt: skip


def _rows(result: Mapping[str, Any], area: str) -> Mapping[str, Any]:
    return result["areas"].get(area, {}).get("rows") or {}


def _asked(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for row in rows:
        value = row["got"]
        if "kept in" in row["note"] or isinstance(value, bool | str | None):
            continue
        if row["bound"] != "equals":
            better = "more" if row["bound"] == "least" else "less"
            yield _figure(row["area"], row["what"], row["unit"], value, better, row["spread"])


def _scaling(rows: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for row in rows.get("curves", ()):
        if "cpu_s" in row and not row["peer"]:
            name = f"{row['curve']}, {row['taxels']:,} taxels"
            spread = row.get("spread_s")
            yield _figure("scaling", name, "s", row["cpu_s"], "less", spread)
            if row.get("peak_mb") is not None:
                yield _figure("scaling", f"{name}, memory", "MB", row["peak_mb"], "less", None)


def _needs(rows: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for row in rows.get("cases", ()):
        name = f"{row['what']}: {row['case']}"
        yield _figure("needs", name, "s", row["cpu_s"], "less", row["spread_s"])
        yield _figure("needs", f"{name}, memory", "MB", row["mb"], "less", row["spread_mb"])


def _figure(
    area: str, name: str, unit: str, value: float, better: str, spread: Any
) -> dict[str, Any]:
    quartiles = [spread[0], spread[-1]] if spread else None
    return {"area": area, "name": name, "unit": unit, "value": value, "better": better,
            "spread": quartiles}  # fmt: skip
