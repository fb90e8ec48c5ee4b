"""Anchors picked by hand: a board beside the link that it is wrapped on."""
