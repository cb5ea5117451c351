"""Results of modes: drawings, outputs of components, and the modes that bend."""
