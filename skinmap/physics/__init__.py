"""Touches by a physics engine of others: MuJoCo presses hands on a bed of springs."""
