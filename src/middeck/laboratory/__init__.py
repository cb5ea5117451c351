"""The simulated laboratory: an article with hidden errors, its rig, its bench and its experiments."""
