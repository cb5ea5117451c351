"""Participation of modes in an eigenvector, whatever the states' scaling (Pérez-Arriaga et al. 1982)."""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.loop.closed_loop import ClosedLoop
from middeck.errors import NumericalError
from middeck.values import record


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
    """Participation in the eigenvalue of largest real part.

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
