"""Benchmarks: each area beside its peers, its results in benchmarks/results.

A program here is run from the top of the checkout, as `python -m benchmarks.live.live`.
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
