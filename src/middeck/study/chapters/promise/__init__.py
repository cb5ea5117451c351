"""A promise made from ground tests alone, and its outcome in orbit."""
