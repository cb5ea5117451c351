"""Nastran bulk data: sections of a deck, cards, coordinate systems, and the article that they describe."""
