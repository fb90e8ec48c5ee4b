"""Presses on a table: where the patches of a robot are mounted."""
