"""From a measurement model to plants, zeros, modal parameters and smaller models."""
