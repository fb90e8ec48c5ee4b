"""Which tables of calibrations are measured, and which stay."""

from __future__ import annotations

from benchmarks.calibration import calibrations


def test_scans_without_their_package_leave_the_table_of_before(monkeypatch, capsys):
    monkeypatch.setattr(calibrations, "find_spec", lambda _: None)
    kept: list[str] = []
    found = calibrations.measure(True, only=["scan"], keep=lambda name, _: kept.append(name))
    assert "scan" not in found
    assert kept == []
    assert "open3d is not installed" in capsys.readouterr().err
