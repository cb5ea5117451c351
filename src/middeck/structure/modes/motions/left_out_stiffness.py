"""Effect of forces and bending at rest that the linear matrices of components lack, for each mode."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.elements.component_element import ComponentElement
from middeck.structure.model.component import Component, body_of, warnings_on_component
from middeck.structure.rest.equilibrium import Equilibrium

# Least relative change of a frequency that is reported.
FELT = 1e-3
# Turn [rad] of a boundary grid in its component's frame beyond which linear matrices are a poor picture.
LARGE = 0.1
# The mean square slope over the mean square deflection of a beam, times its length squared: between clamped
# ends, 12.3.
SLOPE = 12.0
# Share of all forces over all of the length beyond which twist and bending are loaded together.
SHEAR = 0.4
# Relative error of a part's stiffness per rms slope at rest [rad]: with it the mode with the largest error is
# within five times its estimate in 60 random bent beams (tests/truth/test_components.py).
BENT = 0.6


def left_out(
    equilibrium: Equilibrium, lam: Float[np.ndarray, " mode"], shapes: Float[np.ndarray, "coordinate mode"]
) -> Float[np.ndarray, "component mode"]:
    """Estimate of the part of each frequency that a component's linear matrices may miss; zero at zero.

    Forces inside a part of length L work by N L slope^2 / 2. N L are the boundary forces along their arms and
    the weight along the part's extent in its direction (Clausius' virial), without signs, and two fifths of
    all forces over the length for what shear does with twist. The slope is that of the boundary grids in the
    component's frame, and of a beam with the kinetic energy of its modal coordinates. The slope at rest bends
    the part, by which its own stiffness changes: a kink that opens ties bending to twist otherwise. So it is
    an estimate by experience rather than a bound: forces that pull and push cancel in part.
    """
    out = np.zeros((len(equilibrium.components), len(lam)))
    for k, (part, element, state, rows) in enumerate(equilibrium.components):
        pull = (element.stiffness @ state.deformation)[: 6 * len(part.grids)].reshape(-1, 6)[:, :3]
        work, length = _virial(part, pull @ part.axes, part.axes.T @ state.axes.T @ equilibrium.loads.gravity)
        strain = state.slope @ (rows @ shapes)
        works = 0.5 * work * _square_slope(part, element, length, strain)
        bent = np.sqrt(_square_slope(part, element, length, state.deformation[:, None]))
        works += BENT * bent * np.sum(strain * (element.stiffness @ strain), axis=0)
        out[k] = np.divide(works, lam, out=np.zeros(len(lam)), where=lam > 0.0)
    return out


def felt_stiffness(
    equilibrium: Equilibrium, lam: Float[np.ndarray, " mode"], shapes: Float[np.ndarray, "coordinate mode"]
) -> Float[np.ndarray, " mode"]:
    """`left_out` of the component with the largest share of each mode; zero below `FELT`."""
    cost = left_out(equilibrium, lam, shapes).max(axis=0, initial=0.0)
    return np.where(cost > FELT, cost, 0.0)


def _square_slope(
    part: Component, element: ComponentElement, length: float, strain: Float[np.ndarray, "row case"]
) -> Float[np.ndarray, " case"]:
    """Mean square slope of a part in each case of strain, by its grids and its modal coordinates."""
    grids = 6 * len(part.grids)
    turns, q = strain[:grids].reshape(-1, 6, strain.shape[1])[:, 3:], strain[grids:]
    moved = np.sum(q * (element.mass[grids:, grids:] @ q), axis=0)
    return np.mean(np.sum(turns**2, axis=1), axis=0) + SLOPE / (length**2 * part.weight) * np.maximum(
        moved, 0.0
    )


def component_warnings(
    equilibrium: Equilibrium, lam: Float[np.ndarray, " mode"], shapes: Float[np.ndarray, "coordinate mode"]
) -> tuple[str, ...]:
    """Components whose geometric stiffness a frequency feels, and those whose boundary bends too far."""
    parts = equilibrium.model.structure.components
    if not parts:
        return ()
    found = [doubt for part in parts for doubt in warnings_on_component(part)]
    for part, cost in zip(parts, left_out(equilibrium, lam, shapes), strict=True):
        worst = int(np.argmax(cost)) if len(cost) else 0
        if len(cost) and cost[worst] > FELT:
            hz = np.sqrt(lam[worst]) / (2.0 * np.pi)
            found.append(
                f"component {part.name!r} has no geometric stiffness, nor that of its bent shape: by an "
                f"estimate both change the frequency of mode {worst} ({hz:.4g} Hz) by up to "
                f"{100.0 * cost[worst]:.2g} %"
            )
    for part, _, state, _ in equilibrium.components:
        turns = state.deformation[: 6 * len(part.grids)].reshape(-1, 6)[:, 3:]
        bent = np.linalg.norm(turns, axis=1)
        if bent.max() > LARGE:
            at = part.grids[int(np.argmax(bent))]
            found.append(
                f"component {part.name!r} bends by {bent.max():.2g} rad at grid {at}: its matrices are linear"
            )
    return tuple(found)


def _virial(part: Component, pull: np.ndarray, gravity: np.ndarray) -> tuple[float, float]:
    """Forces times lengths [N m] in the component's axes, and its length [m].

    The length is that of its grids, and of a rod with its largest second moment of mass.
    """
    m, centre, inertia = body_of(part)
    arms = part.positions - centre
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    rod = np.sqrt(12.0 / m * np.maximum(np.linalg.eigvalsh(second)[-1], 0.0))
    length = max(float(rod), float(np.linalg.norm(arms, axis=1).max()), float(np.finfo(float).tiny))
    along = np.sqrt(12.0 * m * max(float(gravity @ second @ gravity), 0.0))
    force = m * float(np.linalg.norm(gravity)) + float(np.linalg.norm(pull, axis=1).max())
    work = float(np.abs(np.sum(pull * arms, axis=1)).sum()) + 0.5 * along + SHEAR * force * length
    return work, length
