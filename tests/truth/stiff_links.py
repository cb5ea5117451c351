"""Dumbbells with a link of any stiffness, and their rest state and modes from relative coordinates by hand.

The truth is its own formulation, in which nothing cancels: position and rotation of the first body, and for
each further one what its member does to it as the body before sees it, a cantilever of linear flexibility.
The potential of weight and springs is formed of rigid motions, its gradient by complex step and its Hessian
by central differences of that (good to 1e-8); the strain energy is exact. Members bend by less than a
milliradian, so that linear flexibility is right to 1e-6. The pencil is solved by Cholesky factors, which
leave a graded matrix its small eigenvalues (Demmel and Veselic 1992).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg as sla

from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.model.article import AttachPoint, Body, Member, Section, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment
from structure_builders import GRAVITY, lab, node, structure

G = 9.80665
BEND = 1e-3


class Case(NamedTuple):
    """Bodies a, b, c on a main beam and a link, hung on springs; ``origin`` is where all of it stands."""

    at: np.ndarray  # (3, 3) positions of the bodies
    mass: np.ndarray
    inertia: np.ndarray  # (3, 3)
    section: tuple[Section, Section]
    tied: np.ndarray  # body of each spring
    offset: np.ndarray
    anchor: np.ndarray
    stiffness: np.ndarray
    free: np.ndarray


def draw(rng: np.random.Generator) -> Case:
    """A link of 1e-4 to 1 m and of 1 to 1e9 N m2, in any direction, with a body that it can carry."""
    length, EI = 10.0 ** rng.uniform(-4, 0), 10.0 ** rng.uniform(0, 9)
    way = rng.standard_normal(3)
    at = np.zeros((3, 3))
    at[1, 0] = rng.uniform(0.6, 1.6)
    at[2] = at[1] + length * way / np.linalg.norm(way)
    mass = np.array([*rng.uniform(0.5, 4.0, 2), 10.0 ** rng.uniform(-3, 0)])
    mass[2] = min(mass[2], BEND * 2.0 * EI / (G * length**2))
    inertia = mass[:, None] * rng.uniform(0.002, 0.004, (3, 3))
    tied = np.array([0, 0, 1, 1])
    offset = rng.uniform(-0.2, 0.2, (4, 3)) + np.array([0, 0.2, 0])
    stiffness = mass.sum() / 4.0 * (2.0 * np.pi * rng.uniform(0.4, 0.8)) ** 2 * rng.uniform(0.7, 1.4, 4)
    anchor = at[tied] + offset + [0, 3.0, 0] + rng.uniform(-0.1, 0.1, (4, 3))
    free = 3.0 - mass.sum() * G / 4.0 / stiffness * rng.uniform(0.9, 1.1, 4)
    main = 10.0 ** rng.uniform(5, 7)
    return Case(at, mass, inertia, (_section(main), _section(EI)), tied, offset, anchor, stiffness, free)


def _section(EI: float) -> Section:
    """A tube of 4 cm; massless."""
    return Section(EA=EI / 4e-4, GJ=0.8 * EI, EI_y=EI, EI_z=EI, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)


def article_of(
    case: Case, origin: np.ndarray | None = None, R: np.ndarray | None = None
) -> tuple[Structure, Environment]:
    """The same for the program, turned by ``R`` with all there is, and moved to ``origin``."""
    R, origin = np.eye(3) if R is None else R, np.zeros(3) if origin is None else origin
    nodes = [
        node(n, R @ x + origin, Body(m, np.zeros(3), _symmetric((R * J) @ R.T)))
        for n, x, m, J in zip("abc", case.at, case.mass, case.inertia, strict=True)
    ]
    members = [
        Member(name=f"{s}-{e}", start=s, end=e, section=section, elements=1, up=R @ up)
        for s, e, section, up in zip("ab", "bc", case.section, _ups(case), strict=True)
    ]
    feet = enumerate(zip(case.tied, case.offset, strict=True))
    points = [AttachPoint(f"p{i}", "abc"[b], R @ o) for i, (b, o) in feet]
    springs = [
        AnchoredSpring(name=f"s{i}", attach=f"p{i}", anchor=R @ x + origin, stiffness=k, free_length=free)
        for i, (x, k, free) in enumerate(zip(case.anchor, case.stiffness, case.free, strict=True))
    ]
    return structure(nodes, members, attach=points), lab(*springs, gravity=R @ GRAVITY)


def _symmetric(A: np.ndarray) -> np.ndarray:
    return 0.5 * (A + A.T)


def _ups(case: Case) -> list[np.ndarray]:
    """Any direction well across each member: its least component."""
    return [np.eye(3)[int(np.argmin(np.abs(d)))] for d in np.diff(case.at, axis=0)]


class Truth(NamedTuple):
    """Displacements (3, 3) and rotation vectors (3, 3) of the bodies; omega, ascending, by mode."""

    shift: np.ndarray
    turn: np.ndarray
    omega: np.ndarray


def solve(case: Case) -> Truth | None:
    """None where Newton does not find a stable state within some tens of steps."""
    k = sla.block_diag(np.zeros((6, 6)), *(_cantilever(case, i) for i in (0, 1)))
    z, R = np.zeros(18), np.eye(3)
    scale = 1.0 / np.sqrt(np.concatenate([np.ones(6), np.diag(k)[6:]]))
    for _ in range(60):
        g, H = _loads(case, z, R)
        g, H = g + k @ z, H + k
        scaled = H * scale[:, None] * scale
        low = float(sla.eigvalsh(scaled)[0])
        scaled += max(0.0, 1.0 - low if low <= 0.0 else 0.0) * np.eye(18)
        q = -scale * np.linalg.solve(scaled, scale * g)
        q *= min(1.0, 0.3 / np.abs(q).max())
        z = z + q
        R, z[3:6] = rotation_exp(z[3:6]) @ R, 0.0
        if low > 0.0 and np.abs(q[:6]).max() < 1e-12:
            return _truth(case, z, R, k)
    return None


def _truth(case: Case, z: np.ndarray, R: np.ndarray, k: np.ndarray) -> Truth:
    H = _loads(case, z, R)[1] + k
    x, turns = _bodies(case, z[None], R)
    M = _mass(case, z, R)
    L = np.linalg.cholesky(H)
    A = sla.solve_triangular(L, np.linalg.cholesky(M), lower=True)
    omega = 1.0 / np.linalg.svd(A, compute_uv=False)
    return Truth(x[0].real - case.at, np.array([rotation_log(t.real) for t in turns[0]]), omega)


def _cantilever(case: Case, i: int) -> np.ndarray:
    """Stiffness of a member's far end on (shift, turn) in the drawn axes."""
    s, d = case.section[i], case.at[i + 1] - case.at[i]
    L = float(np.linalg.norm(d))
    e = d / L
    P = np.eye(3) - np.outer(e, e)
    S = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
    shift = s.EA / L * np.outer(e, e) + 12.0 * s.EI_y / L**3 * P
    turn = s.GJ / L * np.outer(e, e) + 4.0 * s.EI_y / L * P
    # A turn phi alone moves the unloaded end by phi x e L/2: the force is 12 EI/L^3 against that.
    mixed = 6.0 * s.EI_y / L**2 * S
    return np.block([[shift, mixed], [mixed.T, turn]])


def _bodies(case: Case, z: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3, 3) and rotations (n, 3, 3, 3) of the bodies at ``z`` (n, 18); analytic."""
    turn = [_exp(z[:, 3:6]) @ R]
    x = [case.at[0] + z[:, :3]]
    for i in (1, 2):
        own = z[:, 6 * i : 6 * i + 6]
        arm = case.at[i] - case.at[i - 1] + own[:, :3]
        x.append(x[-1] + (turn[-1] @ arm[:, :, None])[:, :, 0])
        turn.append(turn[-1] @ _exp(own[:, 3:]))
    return np.stack(x, axis=1), np.stack(turn, axis=1)


def _exp(v: np.ndarray) -> np.ndarray:
    """Rotations of small vectors by their series, analytic; angles here are below one half."""
    S = np.zeros((len(v), 3, 3), v.dtype)
    for (i, j), c in (((2, 1), 0), ((0, 2), 1), ((1, 0), 2)):
        S[:, i, j], S[:, j, i] = v[:, c], -v[:, c]
    out = term = np.eye(3) + 0.0 * S
    for n in range(1, 14):
        term = term @ S / n
        out = out + term
    return out


def _potential(case: Case, z: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Of weight and springs."""
    x, turn = _bodies(case, z, R)
    ends = x[:, case.tied] + (turn[:, case.tied] @ case.offset[:, :, None])[..., 0]
    length = np.sqrt(np.sum((ends - case.anchor) ** 2, axis=2))
    return G * (x[:, :, 1] @ case.mass) + 0.5 * (length - case.free) ** 2 @ case.stiffness


def _loads(case: Case, z: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    h, step = 1e-5, 1e-30
    unit = np.eye(18)
    points = np.concatenate([z[None], z + h * unit, z - h * unit])
    complex_points = points[:, None] + 1j * step * unit
    g = np.imag(_potential(case, complex_points.reshape(-1, 18), R)).reshape(37, 18) / step
    H = (g[1:19] - g[19:]) / (2.0 * h)
    return g[0], 0.5 * (H + H.T)


def _mass(case: Case, z: np.ndarray, R: np.ndarray) -> np.ndarray:
    """From the velocities of all bodies per rate of each coordinate."""
    step = 1e-30
    x, turn = _bodies(case, z + 1j * step * np.eye(18), R)
    _, here = _bodies(case, z[None] + 0j, R)
    v = np.imag(x) / step  # (18, body, 3)
    spin = np.imag(turn) / step @ np.swapaxes(here.real, 2, 3)
    w = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    local = np.einsum("bij,nbi->nbj", here[0].real, w)
    M = np.einsum("nbi,b,mbi->nm", v, case.mass, v) + np.einsum("nbi,bi,mbi->nm", local, case.inertia, local)
    return 0.5 * (M + M.T)
