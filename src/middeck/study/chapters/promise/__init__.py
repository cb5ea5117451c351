"""A promise made from ground tests alone, and what came in orbit."""
