"""Articles meshed: coordinates, potential energy with its derivatives, mass, factorisation."""
