"""How far to trust a mode: the mesh, and members too stiff for matrices."""
