"""What a run says: results, progress, errors with their file, and advice in words of the command line."""
