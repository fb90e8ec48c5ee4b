"""Neighbour offsets of each taxel and the periodic structures among them."""
