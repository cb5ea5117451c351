"""Linear statics of frames for the tests: the displacement method, constraints by their null space."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla

from middeck.structure.model.article import Section, Structure
from middeck.structure.model.environment import Environment


def cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def carried(offset: np.ndarray) -> np.ndarray:
    """Motion of a point at ``offset`` per motion of its node."""
    out = np.eye(6)
    out[:3, 3:] = -cross_matrix(offset)
    return out


def bar(s: Section, length: float) -> np.ndarray:
    """Timoshenko beam, 12x12 in its own axes."""
    K = np.zeros((12, 12))
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K[np.ix_([0, 6], [0, 6])], K[np.ix_([3, 9], [3, 9])] = s.EA / length * pair, s.GJ / length * pair
    for v, r, EI, GA, sign in ((1, 5, s.EI_z, s.GA_y, 1.0), (2, 4, s.EI_y, s.GA_z, -1.0)):
        soft, a = 12.0 * EI / (GA * length**2), sign * length
        k = np.array(
            [
                [12.0, 6.0 * a, -12.0, 6.0 * a],
                [6.0 * a, (4.0 + soft) * length**2, -6.0 * a, (2.0 - soft) * length**2],
                [-12.0, -6.0 * a, 12.0, -6.0 * a],
                [6.0 * a, (2.0 - soft) * length**2, -6.0 * a, (4.0 + soft) * length**2],
            ]
        )
        at = [v, r, v + 6, r + 6]
        K[np.ix_(at, at)] += EI / (length**3 * (1.0 + soft)) * k
    return K


def solve_frame(parts: Structure, bench: Environment) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Motion of each node, and the reaction (force, moment) of each clamped node and ground bushing."""
    place = {n.name: n.position for n in parts.nodes}
    size = 6 * len(place)
    rows = {n: np.arange(6 * i, 6 * i + 6) for i, n in enumerate(place)}
    K, f = np.zeros((size, size)), np.zeros(size)
    for m in parts.members:
        a, b = place[m.start] + m.start_offset, place[m.end] + m.end_offset
        length = float(np.linalg.norm(b - a))
        x = (b - a) / length
        y = m.up - x * (x @ m.up)
        axes = np.array([x, y / np.linalg.norm(y), np.cross(x, y / np.linalg.norm(y))])
        T = np.kron(np.eye(4), axes) @ sla.block_diag(carried(m.start_offset), carried(m.end_offset))
        at = np.concatenate([rows[m.start], rows[m.end]])
        K[np.ix_(at, at)] += T.T @ bar(m.section, length) @ T
        w = m.section.rho_A * length * axes @ bench.gravity
        arm = length / 12.0 * np.array([0.0, -w[2], w[1]])
        f[at] += T.T @ np.concatenate([0.5 * w, arm, 0.5 * w, -arm])
    bodies = [(n.name, n.body) for n in parts.nodes] + [(m.frame, m.body) for m in parts.masses]
    for name, body in bodies:
        f[rows[name]] += carried(body.cg).T @ np.concatenate([body.mass * bench.gravity, np.zeros(3)])
    for p in parts.loads:
        f[rows[p.frame]] += carried(p.offset).T @ np.concatenate([p.force, p.moment])
    points, ground = {a.name: a for a in parts.attach_points}, []

    def motion(name: str) -> np.ndarray:
        out = np.zeros((6, size))
        out[:, rows[points[name].frame]] = carried(points[name].offset)
        return out

    for b in (*parts.bushings, *bench.bushings):
        turn = np.kron(np.eye(2), b.axes)
        k = turn @ b.stiffness @ turn.T
        if hasattr(b, "attach"):
            G = motion(b.attach)
            ground.append((b.name, k @ G))
        else:
            first, last = points[b.start], points[b.end]
            span = place[last.frame] + last.offset - place[first.frame] - first.offset
            G = motion(b.end) - carried(span) @ motion(b.start)
        K += G.T @ k @ G
    held = [
        (rows[c.node][start : start + 3], c.axes[:, "xyz".index(letter)], moved["xyz".index(letter)])
        for c in bench.clamps
        for letters, start, moved in ((c.along, 0, c.shift), (c.about, 3, c.turn))
        for letter in letters
    ]
    C, d = np.zeros((len(held), size)), np.zeros(len(held))
    for row, (at, axis, moved) in enumerate(held):
        C[row, at], d[row] = axis, moved
    Z = sla.null_space(C) if held else np.eye(size)
    q = np.linalg.lstsq(C, d, rcond=None)[0] if held else np.zeros(size)
    q = q + Z @ np.linalg.solve(Z.T @ K @ Z, Z.T @ (f - K @ q))
    reactions = {c.node: (K @ q - f)[rows[c.node]] for c in bench.clamps}
    return q.reshape(-1, 6), reactions | {name: -G @ q for name, G in ground}
