"""Error of each frequency by the modes that reductions left out of components."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.modes.mesh_error import ModesToJudge

# Least share of a frequency that is reported, and one that is rounding.
FELT, ROUNDING = 1e-3, 1e-9


def estimate_reduction_error(modes: ModesToJudge, count: int) -> Float[np.ndarray, "component mode"]:
    """Share by which each of the lowest ``count`` frequencies is too high; zero where nothing is known of it.

    A mode of frequency w with the boundary held, left out, would take lambda^2 (L' u)^2 / (w^2 - lambda) from
    lambda to first order, u the motion of the boundary. All are taken to be as low as the lowest of them, so
    that it is a bound to that order, and infinite from there on. Modes that lie close exchange a quarter of
    it at most (`tests/truth/test_components.py`).
    """
    rest, lam = modes.equilibrium, modes.omega[:count] ** 2
    out = np.zeros((len(rest.components), len(lam)))
    for k, (part, element, state, rows) in enumerate(rest.components):
        if part.left_out is None:
            continue
        u = (element.basis @ state.seen(rows @ modes.shapes[:, :count]))[: len(part.left_out)]
        still = 0.5 * lam * np.einsum("im,ij,jm->m", u, part.left_out, u)
        room = 1.0 - lam / (2.0 * np.pi * part.next_hz) ** 2
        share = np.divide(still, room, out=np.full(len(lam), np.inf), where=room > 0.0)
        out[k] = np.where(still > ROUNDING, share, 0.0)
    return out


def reduction_warnings(modes: ModesToJudge, count: int) -> tuple[str, ...]:
    """A sentence for each component whose reduction moves one of the ``count`` lowest frequencies."""
    found: list[str] = []
    parts = modes.equilibrium.model.structure.components
    for part, share in zip(parts, estimate_reduction_error(modes, count), strict=True):
        off = np.flatnonzero(share > FELT)
        if len(off):
            first, by = int(off[0]), share[off[0]]
            most = f"by up to {by:.2%}" if by < 1.0 else "by an unknown share"
            found.append(
                f"component {part.name!r} lacks its modes from {part.next_hz:.4g} Hz up: {len(off)} of the "
                f"{len(share)} lowest frequencies may be more than {FELT:.1%} too high, the first that of "
                f"mode {first} ({modes.frequency_hz[first]:.4g} Hz) {most}; keep more modes of it"
            )
    return tuple(found)
