"""A flat board laid on its link: the wrap, by anchors or by touches."""
