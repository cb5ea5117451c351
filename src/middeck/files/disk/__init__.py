"""Files on disk: written whole or not at all, known by their content."""
