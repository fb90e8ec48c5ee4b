"""The single figures of a run of `make bench`, by name: what `compare.py` compares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def figures_of(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """All figures of a run.

    Returns
    -------
    list of dict
        `key`, which stays the same from run to run, `area, name, unit, value, better` ("less" or
        "more") and `spread`: lower and upper quartile, or None where only one value was taken.
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
            key, name = row["key"], row["what"]
            yield _figure(key, name, row["unit"], value, better, row["spread"])


def _scaling(rows: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for row in rows.get("curves", ()):
        if "cpu_s" in row and not row["peer"]:
            name = f"{row['curve']}, {row['taxels']:,} taxels"
            key = f"scaling.{row['curve']}.{row['taxels']}"
            yield _figure(f"{key}.s", name, "s", row["cpu_s"], "less", row.get("spread_s"))
            if row.get("peak_mb") is not None:
                yield _figure(f"{key}.mb", f"{name}, memory", "MB", row["peak_mb"], "less", None)


def _needs(rows: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for row in rows.get("cases", ()):
        name = f"{row['what']}: {row['case']}"
        key = f"needs.{row['what']}.{row['case']}"
        yield _figure(f"{key}.s", name, "s", row["cpu_s"], "less", row["spread_s"])
        yield _figure(f"{key}.mb", f"{name}, memory", "MB", row["mb"], "less", row["spread_mb"])


def _figure(
    key: str, name: str, unit: str, value: float, better: str, spread: Any
) -> dict[str, Any]:
    quartiles = [spread[0], spread[-1]] if spread else None
    return {"key": key, "area": key.partition(".")[0], "name": name, "unit": unit, "value": value,
            "better": better, "spread": quartiles}  # fmt: skip
