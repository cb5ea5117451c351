"""The linear-quadratic regulator of a design model (Kwakernaak and Sivan 1972, chapter 3)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.lqg.design_model import DesignModel
from middeck.control.riccati import RiccatiSolution, solve_riccati
from middeck.errors import ConfigError
from middeck.values import record


@record
class Regulator:
    """Gain and Riccati solution on the states of the model, then its integrals; ``R`` is what u costs."""

    solution: RiccatiSolution
    R: Float[np.ndarray, "u u"]


def design_regulator(
    model: DesignModel, authority: float, start: Float[np.ndarray, "state state"] | None = None
) -> Regulator:
    """Minimise E[z'z + u'Ru] on the states of ``model`` and its integrals; ``start``: see `solve_riccati`."""
    if np.any(model.D11):
        raise ConfigError(
            "process noise reaches a performance output directly: white noise makes the cost infinite",
            hint="put a filter between the noise and the output: a colour of the noise or a weight on the "
            "output whose response falls to zero",
        )
    A, B = append_integrals(model)
    effort = 1.0 / np.sqrt(authority)
    C = np.vstack([model.C1, effort * model.shaped])
    D = np.vstack([model.D12, effort * model.shaped_through])
    n, count = len(model.A), len(model.integral)
    Q, S = np.zeros((n + count, n + count)), np.zeros((n + count, B.shape[1]))
    Q[:n, :n], S[:n] = C.T @ C, C.T @ D
    Q[n:, n:] = np.diag(model.integral_weight**2)
    R = D.T @ D + np.diag(model.plain) / authority
    solution = solve_riccati(
        A,
        B,
        Q,
        R,
        S,
        names=(*model.names, *model.integral_names),
        complaint="no control input in u reaches it",
        start=start,
    )
    return Regulator(solution, R)


def append_integrals(model: DesignModel) -> tuple[np.ndarray, np.ndarray]:
    """A and B with the integrals of measurements as last states."""
    rows, count = list(model.integral), len(model.integral)
    A = np.block([[model.A, np.zeros((len(model.A), count))], [model.C2[rows], np.zeros((count, count))]])
    return A, np.vstack([model.control, model.D22[rows]])
