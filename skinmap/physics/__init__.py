"""Touches by a physics engine that nobody here wrote: MuJoCo presses hands on a bed of springs."""
