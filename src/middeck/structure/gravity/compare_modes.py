"""Effects of an environment on the modes: pairs, ratios, cross-orthogonality, MAC, subspace angles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Int
from scipy.linalg import lapack

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.gravity.orbit_lab_pairs import pair_modes, shares_of
from middeck.structure.gravity.tracking import Spectrum, align_repeated, spectrum_of
from middeck.structure.gravity.turned_modes import modes_at_rest
from middeck.structure.modes.mesh_error import LIMIT, MORE_ELEMENTS, estimate_mesh_error
from middeck.structure.modes.names.kinds import CURE, HELD
from middeck.structure.modes.solve import Modes
from middeck.values import record

# Frequencies that differ by less than this part of themselves are one frequency to a ratio.
ALIKE = 0.01
# A mode that has this part of what the partner has of a shape could be the partner.
RIVAL = 0.5
# Least common part of two shapes: a pair with less is one in name only.
COMMON = 0.25


@record(kw_only=True)
class ModeComparison:
    """Modes of one structure in two environments: ``orbit`` (0) and ``lab`` (1), the lowest ``count`` each.

    Attributes:
        cross_orthogonality: |Phi_0' M_0 Phi_1|, rows orbit, columns lab; each side mass-normalised with its
            own mass, flexible modes of one frequency in the basis nearest to the other side's.
        mac: Modal assurance criterion over the translations [m] and rotations [rad] of the nodes and the
            joint angles: it depends on the unit of length, as pairs and `cross_orthogonality` do not.
        pairs: (orbit, lab) indices of the flexible modes in orbit, one to one, with the largest sum of
            cross-orthogonality over all modes; rigid-body modes take flexible ones last. One whose partner is
            not among the lowest ``count``, or has less than a quarter of its shape, has no pair.
        ratio: Frequency lab over orbit of each pair.
        subspace_angle: Principal angles [rad], ascending, between the rigid-body modes and the suspension
            modes.
        warnings: Pairs that another mode could dispute, with the ratio that it would give; ratios that a
            coarse mesh puts off. Those of each side alone are in its own.
    """

    orbit: Modes
    lab: Modes
    count: int
    cross_orthogonality: Float[np.ndarray, "orbit lab"]
    mac: Float[np.ndarray, "orbit lab"]
    pairs: Int[np.ndarray, "pair 2"]
    ratio: Float[np.ndarray, " pair"]
    subspace_angle: Float[np.ndarray, " angle"]
    warnings: tuple[str, ...]

    @property
    def unpaired(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Flexible modes without a partner among the lowest ``count``: in orbit, in the laboratory."""
        return self._left(self.orbit, 0), self._left(self.lab, 1)

    def _left(self, side: Modes, column: int) -> tuple[int, ...]:
        paired = set(self.pairs[:, column].tolist())
        return tuple(
            i for i, kind in enumerate(side.kind[: self.count]) if kind == "flexible" and i not in paired
        )


@named_kinds
def compare_modes(orbit: Modes, lab: Modes, count: int = 26) -> ModeComparison:
    """Compare the lowest ``count`` modes; both sides must share the structure, hence the coordinates.

    Shapes enter as displacements and small rotations in fixed world axes and relative joint angles, the
    coordinates of `Modes.shapes`; those in orbit, and their mass, are first turned with the article to how it
    rests in the laboratory (`modes_at_rest`). Raises `ConfigError` for
    two different meshes or articles, whose modes `correlate_modes` compares at common nodes.
    """
    sides = [m.equilibrium.model for m in (orbit, lab)]
    if sides[0].frames != sides[1].frames:
        raise ConfigError(
            "the modes are of different meshes or articles, without common coordinates",
            where=" and ".join(f"{s.structure.title!r} of {len(s.frames)} frames" for s in sides),
            hint="correlate_modes(modes, measure_modes(others), ...) compares them at common nodes",
        )
    count = min(count, len(orbit.omega), len(lab.omega))
    free = modes_at_rest(orbit, lab)[0]
    phi_0 = _nearest_basis(free, lab.shapes)
    phi_0, phi_1 = phi_0[:, :count], _nearest_basis(spectrum_of(lab), phi_0)[:, :count]
    cross = np.abs(phi_0.T @ (free.mass @ phi_1))
    paired = pair_modes(orbit, lab, count)
    found = [(i, int(j)) for i, j in enumerate(paired.end.found) if orbit.kind[i] == "flexible" and j < count]
    pairs = np.array(found, dtype=int).reshape(-1, 2)
    shares = shares_of(paired.at_rest, lab)
    disputed = tuple(_disputed(orbit, lab, pairs, shares))
    pairs = pairs[[_in_common(lab, pair, shares)[0] >= COMMON for pair in pairs.tolist()]]
    coarse = tuple(_coarse_ratios(orbit, lab, pairs, count))
    return ModeComparison(
        orbit=orbit,
        lab=lab,
        count=count,
        cross_orthogonality=cross,
        mac=_mac(orbit, phi_0, phi_1),
        pairs=pairs,
        ratio=lab.omega[pairs[:, 1]] / orbit.omega[pairs[:, 0]],
        subspace_angle=_subspace_angles(orbit, lab, free),
        warnings=(*disputed, *coarse),
    )


def _nearest_basis(modes: Spectrum, others: np.ndarray) -> np.ndarray:
    """Shapes of ``modes``, those of one frequency in the basis nearest to ``others``: any is as good.

    The basis of rigid modes has names, and stays.
    """
    return np.where(modes.lam > 0.0, align_repeated(modes, others).shapes, modes.shapes)


def _disputed(orbit: Modes, lab: Modes, pairs: np.ndarray, shares: np.ndarray) -> Iterator[str]:
    """Pairs with a mode of another kind, or beside which another mode has half as much of the shape.

    Modes whose frequencies differ by less than `ALIKE` count as one: which of them is the partner makes no
    difference to the ratio.
    """
    f_0, f_1 = orbit.frequency_hz, lab.frequency_hz
    cure = f", or {CURE}" if lab.equilibrium.environment.hung else ""
    for i, j in pairs.tolist():
        own, rival = _in_common(lab, (i, j), shares)
        beside = shares[i, rival]
        a, b = f_1[j] / f_0[i], f_1[rival] / f_0[i]
        called = f"orbit mode {i} {orbit.name[i]!r} at {f_0[i]:.4g} Hz"
        if max(own, beside) < COMMON:
            yield f"{called} has no partner: the nearest, at {f_1[j]:.4g} Hz, has {own:.0%} of it in common"
        elif beside >= RIVAL * own:
            yield (
                f"{called} has no one partner: {own:.0%} of it is at {f_1[j]:.4g} Hz and {beside:.0%} "
                f"at {f_1[rival]:.4g} Hz, so that its ratio is {a:.4g} or {b:.4g}; read the two as a pair of "
                f"modes{cure}"
            )
        elif lab.kind[j] != "flexible":
            yield (
                f"{called} is nearest to a mode at {f_1[j]:.4g} Hz that moves {lab.rigid_share[j]:.0%} as a "
                f"rigid body, where the article has changed its shape: its ratio {a:.4g} is of unlike modes; "
                f"{CURE}, or follow it with middeck path"
            )


def _coarse_ratios(orbit: Modes, lab: Modes, pairs: np.ndarray, count: int) -> Iterator[str]:
    """Ratios whose two frequencies the mesh puts off by different parts; where it has no shape like a mode,
    the warnings of that side say so."""
    errors = [estimate_mesh_error(side, count)[at] for side, at in zip((orbit, lab), pairs.T, strict=True)]
    known = np.all(np.isfinite(errors), axis=0)
    off = np.where(known, errors[1], 0.0) - np.where(known, errors[0], 0.0)
    wrong = np.flatnonzero(np.abs(off) > LIMIT)
    if len(wrong):
        worst = int(np.argmax(np.abs(off)))
        i, j = pairs[worst].tolist()
        yield (
            f"{len(wrong)} of {len(off)} ratios are off by over {LIMIT:.2%}, because the mesh is coarse; "
            f"the worst is that of orbit mode {i} {orbit.name[i]!r}, {lab.omega[j] / orbit.omega[i]:.4g}, "
            f"{100.0 * abs(off[worst]):.2g} % too {'high' if off[worst] > 0.0 else 'low'}; {MORE_ELEMENTS}"
        )


def _in_common(lab: Modes, pair: Sequence[int], shares: np.ndarray) -> tuple[float, int]:
    """The partner's share of the orbit mode's shape, and the next best mode."""
    i, j = pair
    near = np.abs(lab.frequency_hz - lab.frequency_hz[j]) <= ALIKE * lab.frequency_hz[j]
    return float(shares[i, near].sum()), int(np.argmax(np.where(near, 0.0, shares[i])))


def _mac(modes: Modes, phi_0: np.ndarray, phi_1: np.ndarray) -> np.ndarray:
    """The MAC on what a test would measure: the named nodes and the joints."""
    tree = modes.equilibrium.model.tree
    nodes = len(modes.equilibrium.model.structure.nodes)
    seen = np.concatenate([np.arange(6 * nodes), np.arange(6 * tree.roots, tree.size)])
    return modal_assurance(phi_0[seen], phi_1[seen])


def _subspace_angles(orbit: Modes, lab: Modes, free: Spectrum) -> np.ndarray:
    """Principal angles in the metric of the orbit mass (Björck and Golub 1973), sine and cosine form."""
    rigid = [i for i, k in enumerate(orbit.kind) if k == "rigid"]
    hung = [i for i, k in enumerate(lab.kind) if k in HELD]
    if not rigid or not hung:
        return np.zeros(0)
    # Some coordinates have no mass: turns of a thin member about its own axis.
    factor, order, rank, _ = cast("Any", lapack).dpstrf(free.mass.toarray())
    root = np.triu(factor)[:rank]
    a, b = (root @ shapes[order - 1] for shapes in (free.shapes[:, rigid], lab.shapes[:, hung]))
    return np.sort(sla.subspace_angles(a, b))
