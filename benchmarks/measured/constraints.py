"""A loop that hinges close, and an RBE3 of a deck: against minimal coordinates and the card's definition."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize as so

import middeck as md
from measured.rows import row
from middeck.cli.main import execute
from middeck.structure.elements.rotations import rotation_log
from middeck.structure.model.article import Body, Damping, Node, PointLoad, Structure
from middeck.structure.model.links import Link

G = 9.80665
PIVOTS = np.array([[0.0, 0.0], [1.1, 0.2]])
LENGTHS, MASSES, INERTIAS = (0.5, 0.9, 0.7), np.array([1.0, 2.0, 1.5]), np.array([0.02, 0.1, 0.05])
PLACES = np.array([[0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [1.8, 1.5, 0.3], [-0.2, 1.2, 0.6]])
LENGTH, E_MODULUS, AREA, INERTIA = 0.8, 7e10, 1e-4, 1e-8
WEIGHTS, FOLLOWS = (1.0, 0.4, 2.5, 1.3), np.array([0.7, 0.9, 1.1])


def loop_rows() -> list[dict[str, Any]]:
    """A four-bar linkage of rigid bars that hangs: rest and frequency."""
    angle = float(
        so.minimize_scalar(_energy, bounds=(-2.6, -0.2), method="bounded", options={"xatol": 1e-10}).x
    )
    rest = md.solve_equilibrium(_linkage(-0.3), md.Environment.clamped("ground", gravity=G))
    apart = float(np.abs(rest.config.x[1:, :2] - _bars(angle)[0]).max())
    omega = float(md.solve_modes(rest).omega[0])
    case, beside = "Loop of four hinges", "the angle of the crank as the one coordinate"
    return [
        row(case, "rest, largest error of a bar's place", "m", apart, 1e-6, note=beside),
        row(case, "frequency, relative error", "", abs(omega / _omega(angle) - 1.0), 1e-6, note=beside),
    ]


def _bars(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres and angles of crank, coupler and rocker."""
    a, b, c = LENGTHS
    first = a * np.array([np.cos(angle), np.sin(angle)])
    d = PIVOTS[1] - first
    s = float(np.linalg.norm(d))
    x = (s**2 + b**2 - c**2) / (2 * s)
    second = first + x * d / s - np.sqrt(b**2 - x**2) * np.array([-d[1], d[0]]) / s
    ends = [(PIVOTS[0], first), (first, second), (second, PIVOTS[1])]
    turns = np.unwrap([np.arctan2(*(q - p)[::-1]) for p, q in ends])
    return np.array([(p + q) / 2 for p, q in ends]), turns


def _energy(angle: float) -> float:
    return float(G * MASSES @ _bars(angle)[0][:, 1])


def _omega(angle: float) -> float:
    """From differences of fourth order: they leave 1e-9."""
    h = 1e-3
    stiffness = np.array([-1, 16, -30, 16, -1]) @ [_energy(angle + k * h) for k in range(-2, 3)] / (12 * h**2)
    p, t = zip(*(_bars(angle + k * h) for k in (-2, -1, 1, 2)), strict=True)
    rate, spin = (np.tensordot([1, -8, 8, -1], np.array(v), 1) / (12 * h) for v in (p, t))
    return float(np.sqrt(stiffness / (MASSES @ np.sum(rate**2, axis=1) + INERTIAS @ spin**2)))


def _linkage(angle: float) -> Structure:
    centres, turns = _bars(angle)
    nodes = [Node("ground", np.zeros(3), 0.0, Body(0.0, np.zeros(3), np.zeros((3, 3))))]
    for k, (m, i) in enumerate(zip(MASSES, INERTIAS, strict=True)):
        nodes.append(Node(f"bar{k}", np.array([*centres[k], 0.0]), 0.0, Body(m, np.zeros(3), i * np.eye(3))))
    half = [s / 2 * np.array([np.cos(t), np.sin(t), 0.0]) for s, t in zip(LENGTHS, turns, strict=True)]
    ends = (("ground", "bar0", -half[0]), ("bar0", "bar1", -half[1]), ("bar1", "bar2", -half[2]))
    hinges = [*ends, ("ground", "bar2", half[2])]
    links = tuple(
        Link(name=f"hinge{k}", first=a, second=b, about="xy", offset=offset)
        for k, (a, b, offset) in enumerate(hinges)
    )
    return Structure(title="linkage", nodes=tuple(nodes), members=(), joints=(), springs=(), attach_points=(),
                     actuators=(), sensors=(), damping=Damping(), links=links)  # fmt: skip


def rbe3_rows() -> list[dict[str, Any]]:
    """Four cantilevers, a grid that is the weighted mean of their tips, and a small load on it."""
    with tempfile.TemporaryDirectory() as folder:
        deck, out, held = (Path(folder) / name for name in ("mean.dat", "mean.toml", "held.toml"))
        deck.write_text(_deck())
        told = ["convert", str(deck), "-o", str(out), "--environment", str(held), "--units", "m-kg-s-N"]
        with contextlib.redirect_stdout(io.StringIO()):
            if execute(told, lambda: False):
                raise RuntimeError("the deck was not converted")
        parts, around = md.load_setup(out, held)
    load = 1e-3 * np.array([1.0, -2.0, 3.0, 0.5, 1.5, -1.0])
    push = PointLoad(name="push", frame="g30", force=load[:3], moment=load[3:])
    still = dataclasses.replace(around, gravity=np.zeros(3))
    rest = md.solve_equilibrium(parts, still, md.LoadCase(name="push", loads=(push,)))
    shift = rest.config.x - rest.model.rest.x
    moved = {
        name: np.hstack([shift[i], rotation_log(rest.config.R[i])])
        for i, name in enumerate(rest.model.frames[: len(shift)])
    }
    tips = np.array([moved[f"g{k}"][:3] for k in range(1, 5)])
    P = _mean()
    flexibility = LENGTH**3 / (3.0 * E_MODULUS * INERTIA) * np.array([1.0, 1.0, 0.0])
    flexibility[2] = LENGTH / (E_MODULUS * AREA)
    spread = flexibility * (P.T @ load).reshape(4, 3)
    follows = np.abs(moved["g30"] - P @ tips.ravel()).max() / np.abs(moved["g30"]).max()
    shared = np.abs(tips - spread).max() / np.abs(spread).max()
    case = "RBE3 of a deck"
    return [
        row(case, "motion of its grid, off the weighted least squares", "", float(follows), 1e-6),
        row(case, "motion of grids that share its load, off the closed form", "", float(shared), 1e-6),
    ]


def _deck() -> str:
    """Cantilevers along z below each tip, whose grids 1 to 4 have the weights, and grid 30."""
    lines = [
        "SOL 101",
        "CEND",
        "SPC = 1",
        "BEGIN BULK",
        "MAT1,1,7.E10,,.3,2700.",
        "PBAR,1,1,1.E-4,1.E-8,1.E-8,2.E-8",
    ]
    for k, (x, y, z) in enumerate(PLACES.tolist(), 1):
        lines += [
            f"GRID,{k},,{x},{y},{z}",
            f"GRID,{k + 10},,{x},{y},{z - LENGTH}",
            f"CBAR,{k},1,{k + 10},{k},1.,0.,0.",
        ]
    lines += ["SPC1,1,123456,11,THRU,14", "GRID,30,," + ",".join(str(v) for v in FOLLOWS), "CONM2,90,30,,1."]
    groups = ",".join(f"{w},123,{k}" for k, w in enumerate(WEIGHTS, 1)).split(",")
    lines += ["RBE3,30,,30,123456," + ",".join(groups[:4])]
    lines += ["+," + ",".join(groups[4:])]
    return "\n".join([*lines, "ENDDATA", ""])


def _mean() -> np.ndarray:
    """Motion of grid 30 per motions of the four: least squares of the card's definition, 6 x 12."""
    arms = PLACES - FOLLOWS
    rigid = np.vstack([np.hstack([np.eye(3), np.cross(np.eye(3), arm).T]) for arm in arms])
    W = np.diag(np.repeat(WEIGHTS, 3))
    return np.linalg.solve(rigid.T @ W @ rigid, rigid.T @ W)
