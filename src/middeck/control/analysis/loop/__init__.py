"""A plant and a compensator as the two halves of a loop, and the frequency lines of its analysis."""
