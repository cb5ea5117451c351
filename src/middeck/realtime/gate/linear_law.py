"""A package between its limits as a linear sampled law, at a fade."""

from __future__ import annotations

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.rounding import unfold_law
from middeck.systems.state_space.statespace import SampledStateSpace


def linear_law(package: ControllerPackage, fade: float = 1.0) -> Compensator:
    """u = p + ``fade`` c of ``package``: compensator, filters and inner loop, limits left out.

    Where the compensator estimates from the applied command it sees the faded one: at a fade of zero it is
    the open observer, which follows the plant without moving it. Raises `ConfigError` for a fade outside 0
    to 1.

    >>> from middeck.realtime.package.build import package_law
    >>> from middeck.signals.ports import Port
    >>> lag = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[-2.0]], period_s=0.1)
    >>> half = linear_law(package_law(Compensator(lag, (Port("y", "m"),), (Port("u", "N"),)), "lag"), 0.5)
    >>> half.sampled.D.tolist()
    [[-1.0]]
    """
    if not 0.0 <= fade <= 1.0:
        raise ConfigError(f"a fade of {fade}", hint="0 to 1")
    unfolded = unfold_law(package, single=False)
    m, p = len(package.inputs), len(package.outputs)
    law, loop = list(unfolded.law), list(unfolded.loop)
    by_y, by_e = unfolded.G[:, :m], unfolded.G[:, m : m + p]
    C, D = unfolded.H[law], unfolded.J[law, :m]
    missing = fade - 1.0
    sampled = SampledStateSpace(
        unfolded.F + missing * by_e @ C,
        by_y + missing * by_e @ D,
        unfolded.H[loop] + fade * C,
        unfolded.J[loop, :m] + fade * D,
        period_s=package.period_s,
    )
    return Compensator(sampled, package.inputs, package.outputs, method=f"package {package.name}")
