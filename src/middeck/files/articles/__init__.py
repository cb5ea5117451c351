"""Articles: the form of their files, what is wrong with them, and the structure that they describe."""
