"""Baselines, gains, drift and health of taxels."""
