"""Robots: manifests and bodies."""
