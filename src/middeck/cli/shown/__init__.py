"""Output of a run: results, progress, errors with their file, and hints in words of the command line."""
