"""Reduced components in decks: external superelements and matrices by direct input."""
