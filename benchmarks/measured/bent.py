"""Beams bent far on supports of any stiffness: iterations, and tips against the equation of the rod."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.optimize as so
from scipy.integrate import solve_ivp

import middeck as md
from measured.rows import counted_factorisations, row
from middeck.structure.model.article import (
    AttachPoint,
    Body,
    Damping,
    LoadCase,
    Member,
    Node,
    PointLoad,
    Section,
    Structure,
)
from middeck.structure.model.environment import GroundBushing

STIFFNESS = (1e4, 1e6, 1e8, 1e10, 1e12)  # of the support [N/m, N m/rad]; a clamp stands beside them
TENS = 60
STRAIGHT = Section(EA=1e6, GJ=8.0, EI_y=10.0, EI_z=10.0, rho_A=1e-6, rho_I_y=0.0, rho_I_z=0.0)
# Bathe and Bolourchi, IJNME 14 (1979): a square of 1 with E = 1e7, bent to 45 degrees at a radius of 100.
SQUARE = Section(EA=1e7, GJ=7.02885e5, EI_y=1e7 / 12.0, EI_z=1e7 / 12.0, rho_A=1e-6, rho_I_y=0.0, rho_I_z=0.0)
RADIUS, ANGLE, PIECES = 100.0, 0.25 * np.pi, 32
PUBLISHED = np.array([15.79, 47.23, 53.37])  # Simo and Vu-Quoc, CMAME 58 (1986), of the tip under 600


def rows() -> list[dict[str, Any]]:
    """A straight beam bent to 60 % of its length, and the bend of 45 degrees under 600 across its plane."""
    across = np.linspace(0.0, 1.0, 11)
    straight = np.column_stack([across, 0.0 * across, 0.0 * across])
    turns = np.linspace(0.0, ANGLE, PIECES + 1)
    arc = RADIUS * np.column_stack([1.0 - np.cos(turns), np.sin(turns), 0.0 * turns])
    return [
        *_case("Bent beam, straight, to 60 % of its length", straight, STRAIGHT, (0.0, -30.0, 0.0), 0.0),
        *_case("Bent arc of 45 degrees, radius 100", arc, SQUARE, (0.0, 0.0, 600.0), 1.0 / RADIUS,
               f"; Simo and Vu-Quoc print {', '.join(map(str, PUBLISHED))}"),
    ]  # fmt: skip


def _case(
    case: str, at: np.ndarray, section: Section, force: tuple[float, ...], curvature: float, beside: str = ""
) -> list[dict[str, Any]]:
    length = RADIUS * ANGLE if curvature else 1.0
    exact = rod_tip(section, np.array(force), length, curvature)
    counts: list[tuple[int, int]] = []
    tips: list[np.ndarray] = []
    for k in (*STIFFNESS, np.inf):
        with counted_factorisations() as factors:
            rest = _settled(at, section, force, k)
        if not rest.converged:
            raise RuntimeError(f"{case} on {k:g} N/m does not settle")
        counts.append((len(rest.history), len(factors)))
        tips.append(rest.config.x[len(at) - 1])
    told = ", ".join(f"{n} and {f}" for n, f in counts)
    off = float(np.linalg.norm(tips[-1] - exact) / length)
    stiff = float(np.linalg.norm(tips[-2] - tips[-1]) / length)
    place = f"{', '.join(f'{x:.3f}' for x in tips[-1])}; the equation {', '.join(f'{x:.3f}' for x in exact)}"
    return [
        row(case, "most iterations on supports of 1e4 to 1e12 N/m and on a clamp", "",
            max(n for n, _ in counts), TENS, note=f"iterations and factorisations: {told}"),
        row(case, "most factorisations of the tangent", "", max(f for _, f in counts), 2 * TENS),
        row(case, "tip, off the equation of the rod, of its length", "", off, 1e-3, note=f"{place}{beside}"),
        row(case, "tip on 1e12 N/m, off that on a clamp, of its length", "", stiff, 1e-6),
    ]  # fmt: skip


def _settled(at: np.ndarray, section: Section, force: tuple[float, ...], k: float) -> md.Equilibrium:
    nothing = Body(0.0, np.zeros(3), np.zeros((3, 3)))
    nodes = tuple(Node(f"n{i}", x, 0.0, nothing) for i, x in enumerate(at))
    members = tuple(
        Member(name=f"m{i}", start=f"n{i}", end=f"n{i + 1}", section=section, elements=1,
               up=np.array([0.0, 0.0, 1.0]))
        for i in range(len(at) - 1)
    )  # fmt: skip
    foot = (AttachPoint("foot", "n0", np.zeros(3)),)
    parts = Structure(title="bent", nodes=nodes, members=members, joints=(), springs=(), attach_points=foot,
                      actuators=(), sensors=(), damping=Damping())  # fmt: skip
    held = md.Environment.clamped("n0", gravity=0.0)
    if np.isfinite(k):
        ground = GroundBushing(name="ground", attach="foot", stiffness=k * np.eye(6))
        held = md.Environment(title="on a spring", gravity=np.zeros(3), bushings=(ground,))
    push = PointLoad(name="push", frame=f"n{len(at) - 1}", force=np.array(force))
    return md.solve_equilibrium(parts, held, LoadCase(name="push", loads=(push,)))


def rod_tip(section: Section, force: np.ndarray, length: float, curvature: float) -> np.ndarray:
    """Where the tip of a rod without shear ends, clamped at the origin, under a dead force.

    The moment at s is (r(L) - r(s)) x F, so that the tip's place is all that is unknown: shooting, the load
    growing. An arc begins along y and bends towards x.
    """
    first = np.eye(3) if not curvature else np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    stiffness = np.array([section.GJ, section.EI_y, section.EI_z])
    own = np.array([0.0, 0.0, -curvature])

    def along(_: float, y: np.ndarray, load: np.ndarray, guess: np.ndarray) -> np.ndarray:
        r, R = y[:3], y[3:].reshape(3, 3)
        bent = own + R.T @ np.cross(guess - r, load) / stiffness
        stretch = 1.0 + R[:, 0] @ load / section.EA
        spin = np.array([[0.0, -bent[2], bent[1]], [bent[2], 0.0, -bent[0]], [-bent[1], bent[0], 0.0]])
        return np.concatenate([stretch * R[:, 0], (R @ spin).ravel()])

    def miss(guess: np.ndarray, load: np.ndarray) -> np.ndarray:
        y = np.concatenate([np.zeros(3), first.ravel()])
        found = solve_ivp(along, (0.0, length), y, args=(load, guess), rtol=1e-9, atol=1e-9 * length)
        return found.y[:3, -1] - guess

    tip = miss(np.zeros(3), np.zeros(3))
    for part in np.linspace(0.1, 1.0, 10):
        tip = so.fsolve(miss, tip, args=(part * force,), xtol=1e-10)
    return tip
