"""Rigid patches on chains of joints: where they are mounted."""
