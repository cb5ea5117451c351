"""Designs, and whether rounding of the plant's matrices changes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.law.compensator import Compensator
from middeck.control.law.rounding_of_results import is_vague_half, measure_known
from middeck.control.riccati.continuous import RiccatiSolution
from middeck.systems.plants.mode_blocks import unmix_states
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.modal_states import MIXED
from middeck.systems.poles.rounding import is_vague
from middeck.systems.poles.state_units import balance_states
from middeck.systems.poles.verdict import CURE
from middeck.systems.state_space.statespace import LinearSystem, poles
from middeck.values import record

SCALINGS = 4
"""Rounds in which sizes of outputs and inputs settle."""

FEEDBACK, APART, REMAINS = 1.5, 1e9, 1e-11
"""Size of a compensator's A over the plant's, and condition of a Riccati solution whose states have units of
their own, both above which a design is tried again; or the residual alone (poles all but at rest). Of 1374
designs with intensities and weights over 18 and 24 decades rounding moved 119 by 1e-4 or more; 9 of these are
not found so, two of them off by 1e-3 and 1e-2. Of 400 ordinary ones 44 are tried again."""
LITTLE = 1e-7
"""Change by the first move of a plant's entries up to which such a design is not moved again."""


@record
class DesignView:
    """Compared quantities of a design: its system and its cost, positive, near the poles of its Riccati
    equations.
    """

    system: LinearSystem
    cost: float
    solutions: tuple[RiccatiSolution, RiccatiSolution]


Design = TypeVar("Design")


def design_known(
    what: str,
    design: Callable[[Plant], Design],
    view: Callable[[Design], DesignView],
    plant: Plant,
) -> Design:
    """The result of ``design``; warns (`UserWarning`) where rounding of the plant moves its response or cost.

    Responses are compared near all poles of the first design (`measure_known`), where rounding may move the
    plant's (`is_mixed`), or weights or intensities are so far apart that the compensator's own entries cancel
    (`_cancels`). ``what`` names the numbers.
    """
    found, mixed = design(plant), is_mixed(plant)
    if not mixed and not _cancels(view(found), plant):
        return found
    first: list[tuple[np.ndarray, np.ndarray]] = []

    def numbers(found: Design) -> Float[np.ndarray, " number"]:
        seen = view(found)
        if not first:
            at = _lines(seen)
            first.append((at, _sizes(statespace_response(seen.system, at))))
        lines, sizes = first[0]
        apart = (statespace_response(seen.system, lines) / sizes).ravel()
        return np.concatenate([np.real(apart), np.imag(apart), np.log([seen.cost])])

    def again(moved: Plant) -> Design:
        return found if moved is plant else design(moved)

    cure = CURE if mixed else "weights and intensities that differ by fewer decades"
    least = 0.0 if mixed else LITTLE
    return measure_known(
        what, again, numbers, plant, vague=lambda _: True, least=least, cure=cure, stacklevel=5
    )


def is_mixed(half: Plant | Compensator) -> bool:
    """Whether rounding may change a design: by poles (`is_vague_half`), or by ports of weak modes."""
    return is_vague_half(half) or (isinstance(half, Plant) and unmix_states(half)[1] > MIXED)


def _cancels(seen: DesignView, plant: Plant) -> bool:
    """Whether rounding may move a compensator's poles, or its gains: the gains of directions that cost or
    noise hardly sees are rounding of the others."""
    if max(one.residual for one in seen.solutions) > REMAINS:
        return True
    # A sampled plant's A is about as large as one that turns states only.
    sampled = seen.system.period_s is not None
    rates = np.sqrt(len(seen.system.A)) if sampled else _norm(remove_delays(plant).system)
    if _norm(seen.system) <= FEEDBACK * rates:
        return False
    return is_vague(seen.system) or max(_spread(one.X) for one in seen.solutions) > APART


def _spread(X: Float[np.ndarray, "state state"]) -> float:
    """Condition of a Riccati solution whose states have units of their own."""
    own = np.diag(X) > 0.0  # past inputs have no errors
    unit = np.sqrt(np.diag(X)[own])
    values = np.abs(np.linalg.eigvalsh(X[np.ix_(own, own)] / unit / unit[:, None]))
    return float(values.max(initial=0.0) / max(values.min(initial=1.0), np.finfo(float).tiny))


def _norm(system: LinearSystem) -> float:
    return float(np.linalg.norm(balance_states(system).A))


def _lines(seen: DesignView) -> Float[np.ndarray, " line"]:
    """Distances from the origin of s [rad/s] of all poles.

    Integral action and noise of one frequency have poles on the axis: there is no response there.
    """
    at = np.concatenate([poles(seen.system), *(one.poles for one in seen.solutions)])
    period_s = seen.system.period_s
    if period_s is not None:
        at = np.log(at[at != 0.0]) / period_s
    far = np.abs(at) > 1e-9 * np.abs(at).max(initial=0.0)
    size = np.abs(at[far & (np.abs(np.real(at)) > 1e-6 * np.abs(at))])
    return size if period_s is None else np.minimum(size, np.pi / period_s)


def _sizes(H: Complex[np.ndarray, "line output input"]) -> Float[np.ndarray, "line output input"]:
    """Bounds of the entries on each line as products of a size of the output and one of the input.

    An entry far below its bound is rounding of the others, in whatever units.
    """
    size = np.abs(H)
    of_output = size.max(axis=2, keepdims=True, initial=0.0)
    for _ in range(SCALINGS):
        of_output = np.where(of_output > 0.0, of_output, 1.0)
        of_input = (size / of_output).max(axis=1, keepdims=True, initial=0.0)
        of_input = np.where(of_input > 0.0, of_input, 1.0)
        of_output = (size / of_input).max(axis=2, keepdims=True, initial=0.0)
    return np.where(of_output > 0.0, of_output, 1.0) * of_input
