"""What holds grids or ties them to others: rigid links, averages, equations, restraints."""
