"""What Skinmap survives: damaged files, signals, faults while it runs; docs/reliability.md."""
