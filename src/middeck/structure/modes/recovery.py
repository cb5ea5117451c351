"""Further results of components from their own output transformations: at rest, and of each mode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly.energy import component_states
from middeck.structure.modes.solve import Modes


class Recovered(NamedTuple):
    """Outputs of a component by name: as its frame sees the rest state, and modes of unit amplitude.

    ``rest`` has what deformation gives, no motion as one body; ``modes`` have both, in the axes of the frame.
    """

    names: tuple[str, ...]
    rest: Float[np.ndarray, " output"]
    modes: Float[np.ndarray, "output mode"]


def recover_outputs(modes: Modes, component: str) -> Recovered:
    """Results of the component's output transformation; raises `ConfigError` for one that has none."""
    at = modes.equilibrium
    states = component_states(at.model, at.config, at.loads)
    for part, element, (state, rows) in zip(
        at.model.structure.components, at.model.components, states, strict=True
    ):
        if part.name == component and part.recovery is not None:
            back = part.recovery @ element.basis
            return Recovered(part.outputs, back @ state.deformation, back @ state.seen(rows @ modes.shapes))
    known = [part.name for part in at.model.structure.components if part.recovery is not None]
    raise ConfigError(
        f"no component {component!r} with outputs", where="component", hint=", ".join(known) or "none has any"
    )
