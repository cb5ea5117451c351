"""A Craig-Bampton component against the whole: how its error falls with the modes kept."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import middeck as md
from measured.rows import row
from middeck.structure.model.article import Body, Damping, Member, Node, Section, Structure
from middeck.structure.modes.craig_bampton import reduce_structure

BOOM = Section(EA=2e6, GJ=300.0, EI_y=900.0, EI_z=400.0, rho_A=0.6, rho_I_y=2e-4, rho_I_z=1e-4)
ELASTIC, KEPT = slice(6, 12), (8, 16, 32, 64)
TOLD = (1e-8, 1e-3)  # errors that are neither rounding nor of second order


def rows() -> list[dict[str, Any]]:
    """A boom as a component on a free body: six elastic frequencies."""
    full, everything = _frequencies(None), reduce_structure(_boom(0.0), ["hub"], count=1000)
    theory = _theory(full, everything.component, everything.fixed_hz)
    case, out, apart = "Component on a free body", [], []
    for kept in KEPT:
        error = _frequencies(kept) / full - 1.0
        expected = 0.5 * theory[kept:].sum(axis=0)
        told = (expected > TOLD[0]) & (expected < TOLD[1])
        apart += np.abs(error[told] / expected[told] - 1.0).tolist()
        note = f"smallest {error.min():.1e}: all from above"
        out.append(row(case, f"{kept} modes kept, largest of six errors", "", float(error.max()), note=note))
    note = "lambda (p q)^2 / (lambda_c - lambda) summed over the modes c left out"
    measure = f"{len(apart)} errors of 1e-8 to 1e-3, off those of first order"
    return [*out, row(case, measure, "", max(apart), 0.05, note=note)]


def _theory(full: np.ndarray, component: md.structure.Component, fixed_hz: np.ndarray) -> np.ndarray:
    """Relative change of each eigenvalue by leaving out each fixed-interface mode (mode left out, mode)."""
    p = component.mass[:6, 6:]
    whole = md.solve_modes(md.solve_equilibrium(_whole(1000), md.Environment.orbit()))
    q = whole.shapes[:6, ELASTIC]
    value = (2.0 * np.pi * full) ** 2
    return value * (p.T @ q) ** 2 / ((2.0 * np.pi * fixed_hz[:, None]) ** 2 - value)


def _frequencies(kept: int | None) -> np.ndarray:
    parts = _boom(2.0) if kept is None else _whole(kept)
    return md.solve_modes(md.solve_equilibrium(parts, md.Environment.orbit())).frequency_hz[ELASTIC]


def _whole(kept: int) -> Structure:
    made = reduce_structure(_boom(0.0), ["hub"], count=kept).component
    bare = _boom(2.0)
    return dataclasses.replace(bare, nodes=bare.nodes[:1], members=(), components=(made,))


def _boom(hub: float) -> Structure:
    bodies = [Body(m, np.zeros(3), m * np.diag([0.02, 0.03, 0.025])) for m in (hub, 0.3)]
    nodes = tuple(
        Node(name, np.array([x, 0.0, 0.0]), 0.0, b)
        for name, x, b in zip(("hub", "tip"), (0.0, 2.0), bodies, strict=True)
    )
    boom = Member(
        name="boom", start="hub", end="tip", section=BOOM, elements=20, up=np.array([0.0, 0.0, 1.0])
    )
    return Structure(title="boom", nodes=nodes, members=(boom,), joints=(), springs=(), attach_points=(),
                     actuators=(), sensors=(), damping=Damping())  # fmt: skip
