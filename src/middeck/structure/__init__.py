"""From a structure and an environment to modes and a plant: gravity is an argument.

``solve_equilibrium(structure, environment) -> Equilibrium``, ``solve_modes(equilibrium) -> Modes``,
``compare_modes(orbit, lab) -> ModeComparison``, ``build_plant(modes, ...) -> Plant``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
