"""From a structure and an environment to modes and a plant: gravity is an argument.

``solve_equilibrium(structure, environment) -> Equilibrium``, ``solve_modes(equilibrium) -> Modes``,
``compare_modes(orbit, lab) -> ModeComparison``, ``build_plant(modes, ...) -> Plant``.
"""
