"""Meshes, flat maps, structures and contact images beside their peers."""
