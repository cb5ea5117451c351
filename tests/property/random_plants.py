"""Plants of random modes with two inputs and two outputs."""

from __future__ import annotations

import numpy as np

from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from plant_builders import sum_of_modes


def modal_plant(rng: np.random.Generator, omega: np.ndarray, zeta: float = 0.01) -> Plant:
    """A plant of modes at ``omega`` with random shapes; those at zero frequency are not damped."""
    psi, phi = rng.standard_normal((len(omega), 2)), rng.standard_normal((2, len(omega)))
    modal = sum_of_modes(
        omega, np.where(omega > 0.0, zeta, 0.0), psi, phi, names=tuple(f"mode {i}" for i in range(len(omega)))
    )
    inputs, outputs = (Port("a", "N"), Port("b", "N")), (Port("x", "m"), Port("y", "m"))
    u, y = ("a", "b"), ("x", "y")
    return Plant(dynamics=modal, inputs=inputs, outputs=outputs, w=u, u=u, z=y, y=y)


def random_plant(seed: int, modes: int = 5, rigid: int = 1) -> Plant:
    """``rigid`` modes at zero, the others between 0.2 and 10 Hz."""
    rng = np.random.default_rng(seed)
    hz = np.sort(rng.uniform(0.2, 10.0, modes - rigid))
    return modal_plant(rng, np.concatenate([np.zeros(rigid), 2.0 * np.pi * hz]))
