"""The kernel machine of the histograms, evaluated fast."""
