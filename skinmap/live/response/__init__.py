"""From samples to pressures."""
