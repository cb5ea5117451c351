"""Run files: written while the loop runs, read afterwards."""
