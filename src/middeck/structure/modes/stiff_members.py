"""Limit of matrices in W: beside a member too stiff for them, the softest modes lose their digits.

Rest states and modes are found in carried coordinates, in which any stiffness will do. What is formed in W
rounds by 1e-16 of the stiffest member; on 60 random dumbbells derivatives of frequencies and shares of a
budget then err by up to 1e-13 of the ratio.
"""

from __future__ import annotations

import numpy as np

from middeck.errors import NumericalError
from middeck.structure.assembly.carriers import bushing_stiffness, member_stiffness
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.statics import article_size

LIMIT = 1e10


def check_beside_modes(modes: Modes, what: str) -> None:
    """Refuse ``what`` beside a member, spring or bushing beyond `LIMIT` times as stiff as the softest mode.

    Raises `NumericalError` that names it.
    """
    swings = modes.omega[modes.omega > 0.0]
    if len(swings):
        rest = modes.equilibrium
        _check(rest, float(swings.min() ** 2) * rest.model.structure.mass, what)


def check_beside_devices(equilibrium: Equilibrium, what: str) -> None:
    """The same, of the stiffness of all devices; nothing moves where there are none."""
    held = float(np.sum(equilibrium.loads.law.stiffness))
    if held > 0.0:
        _check(equilibrium, held, what)


def _check(rest: Equilibrium, held: float, what: str) -> None:
    model, environment = rest.model, rest.environment
    own = [(spring.stiffness, f"spring {spring.name!r}") for spring in model.structure.springs]
    size = 2.0 * article_size(model)
    tied = [(b.name, b.stiffness) for b in (*model.structure.bushings, *environment.bushings)]
    own += [(bushing_stiffness(K, size), f"bushing {name!r}") for name, K in tied]
    stiffness = member_stiffness(model.beams)
    if len(stiffness):
        stiffest = int(np.argmax(stiffness))
        name = model.structure.members[int(model.element_member[stiffest])].name
        own.append((float(stiffness[stiffest]), f"member {name!r}"))
    most, where = max(own, default=(0.0, ""))
    if most > LIMIT * held:
        raise NumericalError(
            f"{what} would be rounding: {where} is {most / held:.1e} times as stiff as the supports",
            where=where,
            hint=f"make it softer, to {LIMIT:.0e} times at most, which changes no measurable number",
        )
