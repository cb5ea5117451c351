"""0-g frequencies of the data sheet by a second, plain program that shares no line with the first.

In orbit the problem is linear: a textbook space frame (Przemieniecki 1968, tables of k and m written out),
its ends carried rigidly to the nodes by offset matrices, bodies by their own, and each gimbal a body with
one more coordinate. It reads the sheet itself, not our articles.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.files.setups import load_setup
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium

ROOT = Path(__file__).parents[2]
SHEET = tomllib.loads((ROOT / "tests/reference/mace-article.toml").read_text())
ELEMENTS = 8


def beam_matrices(L: float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass of a round tube along x, Euler-Bernoulli with rotary inertia."""
    section, lexan = SHEET["section"]["strut"], SHEET["material"]["lexan"]
    D, d = section["outer_diameter"], section["inner_diameter"]
    area, I = np.pi * (D**2 - d**2) / 4, np.pi * (D**4 - d**4) / 64  # noqa: E741
    EI, GJ = lexan["E"] * I, lexan["E"] / (2 * (1 + lexan["nu"])) * 2 * I
    m, r2 = lexan["rho"] * area * L, I / area
    k_b = EI / L**3 * np.array(
        [[12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2],
         [-12, -6 * L, 12, -6 * L], [6 * L, 2 * L**2, -6 * L, 4 * L**2]]
    )  # fmt: skip
    m_b = m / 420 * np.array(
        [[156, 22 * L, 54, -13 * L], [22 * L, 4 * L**2, 13 * L, -3 * L**2],
         [54, 13 * L, 156, -22 * L], [-13 * L, -3 * L**2, -22 * L, 4 * L**2]]
    )  # fmt: skip
    m_b += m * r2 / (30 * L**2) * np.array(
        [[36, 3 * L, -36, 3 * L], [3 * L, 4 * L**2, -3 * L, -(L**2)],
         [-36, -3 * L, 36, -3 * L], [3 * L, -(L**2), -3 * L, 4 * L**2]]
    )  # fmt: skip
    bar_k, bar_m = np.array([[1, -1], [-1, 1]]), np.array([[2, 1], [1, 2]]) / 6
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    flip = np.diag([1, -1, 1, -1])  # w' = -theta_y
    for at, k, mass in (
        ([0, 6], lexan["E"] * area / L * bar_k, m * bar_m),
        ([3, 9], GJ / L * bar_k, m * 2 * r2 * bar_m),
        ([1, 5, 7, 11], k_b, m_b),
        ([2, 4, 8, 10], flip @ k_b @ flip, flip @ m_b @ flip),
    ):
        K[np.ix_(at, at)] += k
        M[np.ix_(at, at)] += mass
    return K, M


def cross(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def carried(offset: np.ndarray) -> np.ndarray:
    """Motion of a point at ``offset`` from that of its node: u + theta x offset."""
    T = np.eye(6)
    T[:3, 3:] = -cross(offset)
    return T


def turned(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


class Frame:
    """Matrices that grow as parts are added; coordinates are handed out in order."""

    def __init__(self, size: int) -> None:
        self.K, self.M = np.zeros((size, size)), np.zeros((size, size))

    def add_body(self, at: list[int], T: np.ndarray, mass: float, inertia: np.ndarray) -> None:
        own = np.zeros((6, 6))
        own[:3, :3], own[3:, 3:] = mass * np.eye(3), inertia
        self.M[np.ix_(at, at)] += T.T @ own @ T


def sheet_frequencies(name: str) -> np.ndarray:
    """All natural frequencies [Hz] in orbit, rigid ones included."""
    article = SHEET["article"][name]
    nodes, struts, gimbals = article["node"], article["strut"], article["gimbal"]
    index = {n["name"]: i for i, n in enumerate(nodes)}
    inner = len(struts) * (ELEMENTS - 1)
    frame = Frame(6 * (len(nodes) + inner) + 2 * len(gimbals))
    for i, n in enumerate(nodes):
        place = list(range(6 * i, 6 * i + 6))
        frame.add_body(place, carried(np.array(n["cg"])), n["mass"], np.diag(n["inertia"]))
    fresh = len(nodes)
    for strut in struts:
        a, b = nodes[index[strut["from"]]], nodes[index[strut["to"]]]
        L = (b["x"] - a["x"] - (a["size"] + b["size"]) / 2) / ELEMENTS
        K, M = beam_matrices(L)
        chain = [index[strut["from"]], *range(fresh, fresh + ELEMENTS - 1), index[strut["to"]]]
        fresh += ELEMENTS - 1
        for e in range(ELEMENTS):
            T = np.eye(12)
            if e == 0:
                T[:6, :6] = carried(np.array([a["size"] / 2, 0, 0]))
            if e == ELEMENTS - 1:
                T[6:, 6:] = carried(np.array([-b["size"] / 2, 0, 0]))
            at = [6 * c + i for c in chain[e : e + 2] for i in range(6)]
            frame.K[np.ix_(at, at)] += T.T @ K @ T
            frame.M[np.ix_(at, at)] += T.T @ M @ T
    for g, gimbal in enumerate(gimbals):
        add_gimbal(frame, gimbal, 6 * index[gimbal["node"]], 6 * (len(nodes) + inner) + 2 * g)
    lam = sla.eigh(frame.K, frame.M, eigvals_only=True)
    return np.sqrt(np.maximum(lam, 0.0)) / (2 * np.pi)


def add_gimbal(frame: Frame, gimbal: dict, node: int, joint: int) -> None:
    """Stage and payload: what the node does, plus a turn about x, plus one about the stage's z."""
    p = np.array(gimbal["offset"])
    stage = turned(0, np.deg2rad(gimbal["angle_x_deg"]))
    payload = stage @ turned(2, np.deg2rad(gimbal["angle_z_deg"]))
    axes = [np.array([1.0, 0, 0]), stage[:, 2]]
    for R, part, turns in ((stage, "stage", axes[:1]), (payload, "payload", axes)):
        cg = R @ np.array(gimbal[f"{part}_cg"])
        inertia = R @ np.diag(gimbal[f"{part}_inertia"]) @ R.T
        columns = [np.concatenate([np.cross(w, cg), w]) for w in turns]
        T = np.column_stack([carried(p + cg), *columns])
        at = [*range(node, node + 6), *range(joint, joint + len(turns))]
        frame.add_body(at, T, gimbal[f"{part}_mass"], inertia)


@pytest.mark.parametrize(("name", "rigid"), [("simple", 10), ("dm", 8)])
def test_orbit_frequencies_agree_with_a_plain_space_frame(name: str, rigid: int):
    files = ROOT / f"articles/mace-{name}.toml", ROOT / "environments/orbit.toml"
    ours = solve_modes(solve_equilibrium(*load_setup(*files))).frequency_hz
    theirs = sheet_frequencies(name)
    # The plain eigensolver leaves 1e-16 of the largest lambda: sqrt(1e-16 1e13) / 2 pi = 5 mHz.
    assert np.all(theirs[:rigid] < 0.02)
    assert np.all(ours[:rigid] == 0.0)
    assert len(ours) == len(theirs)
    # On the same mesh only rounding differs: 5e-4 of (2 pi 1.65)^2 = 107 at worst, far less in fact.
    low = theirs < 1000.0
    assert ours[rigid:][low[rigid:]] == pytest.approx(theirs[low][rigid:], rel=1e-7)
    assert np.sum(low) > 40
