"""Damage to everything that Skinmap reads: whole originals, and ways to spoil them."""
