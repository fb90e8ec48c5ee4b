"""Sources of samples: recordings, the simulator, live streams, and opening them."""
