"""Limit of matrices in W: beside a member too stiff for them, the softest modes lose their digits.

Rest states and modes are found in carried coordinates, in which any stiffness will do. What is formed in W
rounds by 1e-16 of the stiffest member; on 60 random dumbbells derivatives of frequencies and shares of a
budget then err by up to 1e-13 of the ratio.
"""

import numpy as np

from middeck.errors import NumericalError
from middeck.structure.assembly.carriers import bushing_stiffness, member_stiffness
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.imbalance import article_size
from middeck.values import record

LIMIT = 1e10


@record
class Stiffest:
    """The stiffest member, spring or bushing, compared with what holds the article.

    Attributes:
        where: Its kind and name.
        held: Stiffness that holds the article [N/m].
        ratio: Ratio of both stiffnesses.
    """

    where: str
    held: float
    ratio: float

    def refusal(self, what: str, why: str = "", instead: str = "") -> NumericalError:
        """The error that names it, with ``why`` it cannot be made softer and what ``instead`` is possible."""
        return NumericalError(
            f"{what} would be rounding: {self.where} is {self.ratio:.1e} times as stiff as the supports"
            f"{', and ' if why else ''}{why}",
            where=self.where,
            hint=f"{instead}make it softer, to {LIMIT:.0e} times at most, which changes no measurable number",
        )


def check_beside_modes(modes: Modes, what: str) -> None:
    """Refuse ``what`` beside a member, spring or bushing beyond `LIMIT` times as stiff as the softest mode.

    Raises `NumericalError` that names it.
    """
    found = beside_modes(modes)
    if found is not None and found.ratio > LIMIT:
        raise found.refusal(what)


def check_beside_devices(equilibrium: Equilibrium, what: str) -> None:
    """The same, of the stiffness of all devices; nothing moves where there are none."""
    found = beside_devices(equilibrium)
    if found is not None and found.ratio > LIMIT:
        raise found.refusal(what)


def beside_modes(modes: Modes) -> Stiffest | None:
    """The stiffest part over the softest mode that oscillates; None where none does."""
    swings = modes.omega[modes.omega > 0.0]
    if not len(swings):
        return None
    rest = modes.equilibrium
    return _stiffest(rest, float(swings.min() ** 2) * rest.model.structure.mass)


def beside_devices(equilibrium: Equilibrium) -> Stiffest | None:
    """The stiffest part over all devices together; None where there are none."""
    held = float(np.sum(equilibrium.loads.law.stiffness))
    return _stiffest(equilibrium, held) if held > 0.0 else None


def _stiffest(rest: Equilibrium, held: float) -> Stiffest:
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
    return Stiffest(where, held, most / held)
