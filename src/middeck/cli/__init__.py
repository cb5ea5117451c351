"""The command line: one verb per arrow of the work, files in and files out."""
