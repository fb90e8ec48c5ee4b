"""Calibrations on simulated evidence."""
