"""The wiring doctor: which channel is really where, told by touches and by the skin at rest."""
