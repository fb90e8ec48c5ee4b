"""Flat maps: flattening methods, distortion, packing of charts."""
