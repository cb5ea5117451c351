"""Random decks of bars, written in every format, and their stiffness and mass by the textbook.

The matrices are those of Przemieniecki (1968) in their 12 x 12 form, assembled with rigid arms; nothing here
uses middeck.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

E, NU, RHO = 7e10, 0.3, 2700.0
ALL = "123456"


class RandomDeck(NamedTuple):
    """A deck's text; places of its grids; bars, riders and bodies as they were drawn.

    ``systems`` are kind, origin and axes; ``moves_in`` are those of displacements by grid.
    """

    text: str
    places: dict[int, np.ndarray]
    bars: list[dict[str, Any]]
    riders: dict[int, int]
    bodies: list[dict[str, Any]]
    systems: dict[int, tuple[str, np.ndarray, np.ndarray]]
    moves_in: dict[int, int]

    @property
    def free(self) -> list[int]:
        """Grids that ride on no other."""
        return [n for n in self.places if n not in self.riders]


def field(value: Any, width: int) -> str:
    """A field of 8 or 16 columns; reals with as many digits as there is room."""
    if isinstance(value, (float, np.floating)):
        if width == 8:
            for digits in range(7, -1, -1):
                text = f"{value:.{digits}g}"
                text = text if "." in text or "e" in text else text + "."
                if "e" in text:
                    mantissa, exponent = text.split("e")
                    mantissa = mantissa if "." in mantissa else mantissa + "."
                    text = f"{mantissa}{int(exponent):+d}"
                if len(text) <= 8:
                    return text
        return f"{value:.9E}" if width == 16 else repr(float(value))
    return str(value)


def card(rng: np.random.Generator, name: str, *values: Any) -> list[str]:
    """A card in free or large format, with explicit, named or implicit continuation."""
    if rng.random() < 0.5:
        rows = [values[i : i + 8] for i in range(0, len(values), 8)]
        text = ["" if v is None else field(v, 0) for v in rows[0]]
        lines = [", ".join([name.lower() if rng.random() < 0.3 else name, *text])]
        for row in rows[1:]:
            lines.append(
                ", ".join(
                    ["+" if rng.random() < 0.5 else "", *("" if v is None else field(v, 0) for v in row)]
                )
            )
        return lines
    rows = [values[i : i + 4] for i in range(0, len(values), 4)]
    lines, mark = [], f"{name}*"
    for k, row in enumerate(rows):
        last = k == len(rows) - 1
        label = "" if last else f"*L{rng.integers(1e5)}" if rng.random() < 0.5 else "*"
        body = "".join(("" if v is None else field(v, 16)).rjust(16) for v in row)
        lines.append(f"{mark:<8}{body:<64}{label}")
        mark = label if label else "*"
    return lines


def turned(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def inside(kind: str, origin: np.ndarray, axes: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Coordinates of ``point`` in a system, angles in degrees."""
    x, y, z = axes.T @ (point - origin)
    if kind == "R":
        return np.array([x, y, z])
    if kind == "C":
        return np.array([np.sqrt(x * x + y * y), np.degrees(np.arctan2(y, x)), z])
    r = np.sqrt(x * x + y * y + z * z)
    return np.array([r, np.degrees(np.arccos(z / r)), np.degrees(np.arctan2(y, x))])


def components(
    kind: str, origin: np.ndarray, axes: np.ndarray, at: np.ndarray, vector: np.ndarray
) -> np.ndarray:
    """Components of a vector along the coordinate lines through ``at``, by differences of the coordinates."""
    x, y, z = axes.T @ (at - origin)
    along = axes.T @ vector
    if kind == "R":
        return along
    s = np.sqrt(x * x + y * y)
    e_s, e_phi, e_z = np.array([x / s, y / s, 0.0]), np.array([-y / s, x / s, 0.0]), np.array([0.0, 0.0, 1.0])
    if kind == "C":
        return np.array([along @ e_s, along @ e_phi, along @ e_z])
    r = np.sqrt(s * s + z * z)
    e_r = (s * e_s + z * e_z) / r
    e_polar = (z * e_s - s * e_z) / r
    return np.array([along @ e_r, along @ e_polar, along @ e_phi])


def random_deck(seed: int, rods: bool = False, grids: int = 9) -> RandomDeck:
    """Bars in a tree with extra ones, coordinate systems in chains, offsets, rigid links and masses."""
    rng = np.random.default_rng(seed)
    lines: list[str] = []
    systems: dict[int, tuple[str, np.ndarray, np.ndarray]] = {0: ("R", np.zeros(3), np.eye(3))}
    for cid in range(1, 6):
        rid = int(rng.integers(0, cid))
        kind, origin, axes = "RCS"[rng.integers(3)], rng.uniform(-1.0, 1.0, 3) + 4.0, turned(rng)
        a, b, c = origin, origin + 1.3 * axes[:, 2], origin + 0.7 * axes[:, 0] + 0.4 * axes[:, 2]
        points = [inside(*systems[rid], p) for p in (a, b, c)]
        lines += card(rng, f"CORD2{kind}", cid, rid, *np.concatenate(points))
        systems[cid] = (kind, origin, axes)
    places = {int(10 * i + 1): rng.uniform(-1.0, 1.0, 3) for i in range(grids)}
    names, cd = list(places), {}
    for number, place in places.items():
        cp, cd[number] = (int(c) for c in rng.integers(0, 6, 2))
        lines += card(rng, "GRID", number, cp, *inside(*systems[cp], place), cd[number])
    lines += card(rng, "MAT1", 3, E, None, NU, RHO)
    properties: dict[int, dict[str, float]] = {}
    for pid in (1, 2):
        i1, i2 = rng.uniform(1e-8, 9e-8, 2)
        p = {
            "A": 1e-4 * rng.uniform(1, 3),
            "I1": i1,
            "I2": i2,
            "J": 1.2 * (i1 + i2),
            "nsm": rng.uniform(0, 0.2),
            "I12": 0.0 if pid == 1 else 0.4 * np.sqrt(i1 * i2),
        }
        properties[pid] = p
        lines += card(
            rng,
            "PBAR",
            pid,
            3,
            p["A"],
            p["I1"],
            p["I2"],
            p["J"],
            p["nsm"],
            None,
            *[None] * 8,
            None,
            None,
            p["I12"],
        )
    riders = {names[-1]: names[-2], names[-2]: names[0], names[-3]: names[1]}
    lines += card(rng, "RBE2", 901, names[-2], ALL, names[-1])
    lines += card(rng, "RBAR", 902, names[0], names[-2], ALL, None, None, ALL)
    lines += card(rng, "RBE2", 903, names[1], ALL, names[-3])
    ends = [(names[i], names[int(rng.integers(0, i))]) for i in range(1, grids)]
    ends += [tuple(int(n) for n in rng.choice(names, 2, replace=False)) for _ in range(4)]
    bars: list[dict[str, Any]] = []
    for k, (a, b) in enumerate(ends):
        pid = int(rng.integers(1, 3))
        w = [0.1 * rng.standard_normal(3) if rng.random() < 0.4 else np.zeros(3) for _ in "ab"]
        up = rng.standard_normal(3)
        offt = "".join(rng.choice(list(s)) for s in ("GB", "GO", "GO"))
        g0 = int(rng.choice([n for n in names if n not in (a, b)])) if rng.random() < 0.3 else None
        v = up if g0 is None else places[g0] - places[a]
        written = list(up if offt[0] == "B" else components(*systems[cd[a]], places[a], up))
        e1 = (places[b] - places[a]) / np.linalg.norm(places[b] - places[a])
        e2 = (v - (v @ e1) * e1) / np.linalg.norm(v - (v @ e1) * e1)
        own = np.array([e1, e2, np.cross(e1, e2)])
        shown = [
            x
            for n, arm, axes in zip((a, b), w, offt[1:], strict=True)
            for x in (
                [None] * 3
                if not arm.any()
                else own @ arm
                if axes == "O"
                else components(*systems[cd[n]], places[n], arm)
            )
        ]
        written = [g0, None, None] if g0 else written
        lines += card(rng, "CBAR", 100 + k, pid, a, b, *written, offt, None, None, *shown)
        bars.append(
            {"ends": (a, b), "arms": w, "up": up if g0 is None else places[g0] - places[a], **properties[pid]}
        )
    for k in range(2 if rods else 0):
        a, b = (int(n) for n in rng.choice(names[:-3], 2, replace=False))
        rod = {"A": 1e-4 * rng.uniform(1, 3), "I1": 0.0, "I2": 0.0, "I12": 0.0, "J": 1.7e-9, "nsm": 0.13 * k}
        if k:
            lines += card(rng, "CONROD", 200, a, b, 3, rod["A"], rod["J"], None, rod["nsm"])
        else:
            lines += card(rng, "PROD", 8, 3, rod["A"], rod["J"]) + card(rng, "CROD", 201, 8, a, b)
        none = np.zeros(3)
        bars.append({"ends": (a, b), "arms": [none, none], "up": rng.standard_normal(3), **rod})
    bodies: list[dict[str, Any]] = []
    for k, grid in enumerate((names[2], names[-1], names[-1])):
        mass, arm, R = rng.uniform(0.1, 1.0), 0.1 * rng.standard_normal(3), turned(rng)
        inertia = R @ np.diag(1e-3 * rng.uniform(1.0, 1.5, 3)) @ R.T
        cid = int(rng.integers(1, 6))
        kind, origin, axes = systems[cid]
        local = np.array([components(kind, origin, axes, places[grid], e) for e in np.eye(3)]).T
        own = local @ inertia @ local.T
        lines += card(
            rng,
            "CONM2",
            500 + k,
            grid,
            cid,
            mass,
            *(local @ arm),
            None,
            own[0, 0],
            -own[1, 0],
            own[1, 1],
            -own[2, 0],
            -own[2, 1],
            own[2, 2],
        )
        bodies.append({"grid": grid, "mass": mass, "arm": arm, "inertia": inertia})
    head = ["SOL 103", "CEND", "METHOD = 1", "BEGIN BULK", "PARAM   COUPMASS1"]
    return RandomDeck("\n".join([*head, *lines, "ENDDATA", ""]), places, bars, riders, bodies, systems, cd)


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def bending(EI: float, L: float) -> np.ndarray:
    return (
        EI
        / L**3
        * np.array(
            [
                [12, 6 * L, -12, 6 * L],
                [6 * L, 4 * L**2, -6 * L, 2 * L**2],
                [-12, -6 * L, 12, -6 * L],
                [6 * L, 2 * L**2, -6 * L, 4 * L**2],
            ]
        )
    )


def bending_mass(m: float, rho_i: float, L: float) -> np.ndarray:
    translation = (
        m
        * L
        / 420
        * np.array(
            [
                [156, 22 * L, 54, -13 * L],
                [22 * L, 4 * L**2, 13 * L, -3 * L**2],
                [54, 13 * L, 156, -22 * L],
                [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
            ]
        )
    )
    rotary = (
        rho_i
        / (30 * L)
        * np.array(
            [
                [36, 3 * L, -36, 3 * L],
                [3 * L, 4 * L**2, -3 * L, -(L**2)],
                [-36, -3 * L, 36, -3 * L],
                [3 * L, -(L**2), -3 * L, 4 * L**2],
            ]
        )
    )
    return translation + rotary


def local_matrices(bar: dict[str, Any], L: float, formulation: str) -> tuple[np.ndarray, np.ndarray]:
    """K and M of a bar in own axes; product moments stay in K as they are."""
    G, m = E / (2 * (1 + NU)), RHO * bar["A"] + bar["nsm"]
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    pair, rod = [0, 6], np.array([[1.0, -1.0], [-1.0, 1.0]])
    K[np.ix_(pair, pair)] += E * bar["A"] / L * rod
    K[np.ix_([3, 9], [3, 9])] += G * bar["J"] / L * rod
    y, z = [1, 5, 7, 11], [2, 4, 8, 10]
    turn = np.diag([1.0, -1.0, 1.0, -1.0])  # w' = -theta_y
    Kz = turn @ bending(1.0, L)  # rows of z against columns of y
    K[np.ix_(y, y)] += bending(E * bar["I1"], L)
    K[np.ix_(z, z)] += turn @ bending(E * bar["I2"], L) @ turn
    K[np.ix_(z, y)] += E * bar["I12"] * Kz
    K[np.ix_(y, z)] += E * bar["I12"] * Kz.T
    if formulation == "lumped":
        M[[0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8]] = m * L / 2
        return K, M
    if bar["I1"] == bar["I2"] == 0.0:  # a rod goes straight between its ends, however they turn
        along, across = (
            ((5 / 12, 1 / 12), (1 / 2, 0.0)) if formulation == "coupled" else ((1 / 3, 1 / 6),) * 2
        )
        for i, (same, other) in enumerate((along, across, across)):
            M[np.ix_([i, i + 6], [i, i + 6])] = m * L * np.array([[same, other], [other, same]])
        return K, M
    own = RHO if formulation == "consistent" else 0.0
    axial = (1 / 3, 1 / 6) if formulation == "consistent" else (5 / 12, 1 / 12)
    M[np.ix_(pair, pair)] += m * L * np.array([[axial[0], axial[1]], [axial[1], axial[0]]])
    M[np.ix_([3, 9], [3, 9])] += own * (bar["I1"] + bar["I2"]) * L / 6 * np.array([[2, 1], [1, 2]])
    M[np.ix_(y, y)] += bending_mass(m, own * bar["I1"], L)
    M[np.ix_(z, z)] += turn @ bending_mass(m, own * bar["I2"], L) @ turn
    cross = own * bar["I12"] * (bending_mass(0.0, 1.0, L))
    M[np.ix_(z, y)] += turn @ cross
    M[np.ix_(y, z)] += (turn @ cross).T
    return K, M


def motion(deck: RandomDeck, grid: int, arm: np.ndarray) -> np.ndarray:
    """Shift and turn of the point ``arm`` from ``grid`` in the freedoms of the free grids."""
    end = grid
    while end in deck.riders:
        end = deck.riders[end]
    arm = arm + deck.places[grid] - deck.places[end]
    out, at = np.zeros((6, 6 * len(deck.free))), 6 * deck.free.index(end)
    out[:, at : at + 6] = np.eye(6)
    out[:3, at + 3 : at + 6] = -skew(arm)
    return out


def textbook(deck: RandomDeck, formulation: str) -> tuple[np.ndarray, np.ndarray]:
    """K and M of the deck in the freedoms of its free grids."""
    K, M = (np.zeros((6 * len(deck.free),) * 2) for _ in range(2))
    for bar in deck.bars:
        a, b = (deck.places[n] + arm for n, arm in zip(bar["ends"], bar["arms"], strict=True))
        L = float(np.linalg.norm(b - a))
        x = (b - a) / L
        zz = np.cross(x, bar["up"])
        zz /= np.linalg.norm(zz)
        R = np.stack([x, np.cross(zz, x), zz])
        T = np.kron(np.eye(4), R) @ np.vstack(
            [motion(deck, n, arm) for n, arm in zip(bar["ends"], bar["arms"], strict=True)]
        )
        k, m = local_matrices(bar, L, formulation)
        K += T.T @ k @ T
        M += T.T @ m @ T
    for body in deck.bodies:
        T = motion(deck, body["grid"], body["arm"])
        own = np.zeros((6, 6))
        own[:3, :3], own[3:, 3:] = body["mass"] * np.eye(3), body["inertia"]
        M += T.T @ own @ T
    return K, M
