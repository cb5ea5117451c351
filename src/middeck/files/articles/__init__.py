"""Articles: the form of their files, the faults of these, and the structure that they describe."""
