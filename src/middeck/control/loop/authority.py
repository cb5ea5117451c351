"""Authority sweeps: performance of a design on several plants, and the first mode to go unstable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.control.loop.closed_loop import ClosedLoop, close_loop
from middeck.control.loop.performance import Performance, loop_metric
from middeck.errors import ConfigError, NumericalError
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.verdict import is_stable
from middeck.values import record

Design = Callable[[float], Compensator]
"""From authority to compensator; e.g. ``functools.partial(design_lqg, plant, weights, kalman=kalman)``."""
STEP, RESOLUTION = 0.25, 0.005  # in log10 authority, for the search for the first instability


@record(kw_only=True)
class AuthoritySweep:
    """The metric of each plant at each authority.

    Attributes:
        authority: The levels.
        plants: Names of the plants, in the order of the rows.
        db: 20 log10 of the metric over the reference; improvement is negative, ``inf`` where unstable.
        stable: Whether the closed loop is stable.
        compensator_stable: Whether the compensator is, by the same threshold.
    """

    authority: Float[np.ndarray, " level"]
    plants: tuple[str, ...]
    db: Float[np.ndarray, "plant level"]
    stable: Bool[np.ndarray, "plant level"]
    compensator_stable: Bool[np.ndarray, " level"]


@record(kw_only=True)
class FirstInstability:
    """Lowest authority found unstable, and the participation of modes.

    Attributes:
        log10_authority: The unstable end of the last interval.
        pole: The eigenvalue of largest real part there [rad/s].
        frequency_hz: Its imaginary part.
        mode_name: The mode with the largest share.
        participation: The share of ``mode_name``, over all its states.
        compensator_share: Share of the compensator's states, over all states.
    """

    log10_authority: float
    pole: complex
    frequency_hz: float
    mode_name: str
    participation: float
    compensator_share: float


@named_kinds
def sweep_authority(
    design: Design,
    levels: Float[np.ndarray, " level"],
    *,
    on: Mapping[str, Plant],
    performance: Performance,
    reference: float,
) -> AuthoritySweep:
    """Metric of every plant under the design at every authority; ``reference`` is the metric called 0 dB."""
    if not 0.0 < reference < np.inf:
        raise ConfigError(f"reference = {reference} is not positive", hint="the metric that counts as 0 dB")
    laws = [design(float(level)) for level in levels]
    loops = {name: [close_loop(plant, law) for law in laws] for name, plant in on.items()}
    metric = np.array([[loop_metric(loop, performance) for loop in row] for row in loops.values()])
    return AuthoritySweep(
        authority=np.asarray(levels, dtype=float),
        plants=tuple(on),
        db=20.0 * np.log10(metric.reshape(len(on), len(laws)) / reference),
        stable=np.array([[loop.stable for loop in row] for row in loops.values()]).reshape(
            len(on), len(laws)
        ),
        compensator_stable=np.array([is_stable(law.system) for law in laws], dtype=bool),
    )


@named_kinds
def find_first_instability(
    design: Design, plant: Plant, *, first: float, last: float = 7.0
) -> FirstInstability | None:
    """Search log10 authority upwards from ``first``; None if every level up to ``last`` is stable.

    The first unstable level is bisected to 0.005 against the level before it; the unstable end is
    reported. Stability may return above it.
    """

    def unstable(log10_authority: float) -> bool:
        return not close_loop(plant, design(10.0**log10_authority)).stable

    # 1e-9: `last` itself is a level however the steps round.
    levels = first + STEP * np.arange(int(np.floor((last - first) / STEP + 1e-9)) + 1)
    found = next((float(level) for level in levels if unstable(float(level))), None)
    if found is None:
        return None
    high, low = found, found - STEP
    while found > first and high - low > RESOLUTION:
        middle = (low + high) / 2.0
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return _describe(design, plant, high)


def _describe(design: Design, plant: Plant, log10_authority: float) -> FirstInstability:
    part = find_participation(close_loop(plant, design(10.0**log10_authority)))
    lead = int(np.argmax(part.shares))
    return FirstInstability(
        log10_authority=log10_authority,
        pole=part.pole,
        frequency_hz=part.pole.imag / (2.0 * np.pi),
        mode_name=part.names[lead],
        participation=float(part.shares[lead] / part.shares.sum()),
        compensator_share=part.compensator,
    )


@record
class Participation:
    """Shares in one eigenvalue of a closed loop.

    Attributes:
        pole: The eigenvalue [rad/s], imaginary part not negative.
        names: The modes (or other parts) of the plant, in its order.
        shares: |left * right eigenvector|, summed over each mode's states; ``shares`` and ``compensator`` sum
            to one.
        compensator: Share of all compensator states together.
    """

    pole: complex
    names: tuple[str, ...]
    shares: Float[np.ndarray, " mode"]
    compensator: float


def find_participation(loop: ClosedLoop) -> Participation:
    """Participation in the eigenvalue of largest real part (Pérez-Arriaga et al. 1982).

    For a plant built from modes the states are the modal ones, position and rate, with or without static
    feedback around it. Raises `NumericalError` for a defective eigenvalue, where shares do not exist.
    """
    form = sla.eig(loop.system.A, left=True, right=True)
    values, left, right = cast("tuple[np.ndarray, np.ndarray, np.ndarray]", form)
    lead = int(np.argmax(np.real(values)))
    pole, left, right = complex(values[lead]), left[:, lead], right[:, lead]
    if abs(np.vdot(left, right)) < 1e-12:
        raise NumericalError(
            f"the eigenvalue {pole:.3g} is defective: participation does not exist",
            hint="move a pole apart: change the authority or the PD gains a little",
        )
    product = np.abs(left.conj() * right)
    product /= product.sum()
    names = tuple(dict.fromkeys(loop.state_names))
    index = np.array([names.index(name) for name in loop.state_names], dtype=int)
    shares = np.bincount(index, weights=product[: len(index)], minlength=len(names))
    pole = complex(pole.real, abs(pole.imag))
    return Participation(pole, names, shares, float(product[len(index) :].sum()))
