"""Whether motions within the ranges of a law's sensors drive its outputs into their limits of slew."""

from collections.abc import Callable

import numpy as np

from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.rounding_errors import unfold_law
from middeck.systems.poles.resolvent import evaluate_transfer
from middeck.systems.state_space.statespace import SampledStateSpace

SPARE = 2.0
"""How far beyond reach a limit must be to be none: motions at a limit are no sines."""


def reached_slews(package: ControllerPackage) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Whether motions z^k can hold the step of each output at a given share of what is left: motion, output.

    An output of which each step takes a share h goes by u = h v / (z - 1 + h) where v is asked for. A limit
    of slew s leaves that share of a sine v - u no smaller than s / h, so that |v| is at least
    s |z - 1 + h| / (h |z - 1|). The law asks for no more than its gain at z allows, from inputs within their
    ranges and commands applied within their limits; beyond a range the engine trips. An output
    whose share is 1 is held by no limit, and counts as one that is reached.
    """
    law, m, p = unfold_law(package, single=False), len(package.inputs), len(package.outputs)
    wanted, E = list(law.wanted), law.G[:, m : m + p]
    C, D = law.H[wanted], law.J[wanted, :m]
    by_y, by_applied = law.G[:, :m] - E @ D, E
    learning = SampledStateSpace(
        law.F - E @ C, np.hstack([by_y, by_applied]), C, np.hstack([D, np.zeros((p, p))]),
        period_s=package.period_s,
    )  # fmt: skip
    sizes = np.concatenate([package.input_range, np.maximum(package.upper, -package.lower)])

    def reached(motions: np.ndarray, shares: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):  # what is no number is reached
            most = np.abs(evaluate_transfer(learning, motions)) @ sizes
            step = np.abs(motions - 1.0)[:, None]
            least = package.slew * np.abs(motions[:, None] - 1.0 + shares) / (shares * step)
        return ~(least > SPARE * most) | (shares == 1.0)

    return reached
