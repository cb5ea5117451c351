"""Elements on grids or between them: masses, springs, bushings, scalar points."""
