"""OUTPUT4: matrices as text and in binary."""
