"""Tables and archives that calibrations read and write."""
