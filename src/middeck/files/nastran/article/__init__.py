"""From the parts of a deck to the documents of an article and of its supports."""
