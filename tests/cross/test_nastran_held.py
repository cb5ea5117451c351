"""Random decks with springs, bushings, constraints and loads against the textbook's matrices."""

from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from nastran_decks import RandomDeck, card, components, motion, random_deck, textbook, turned
from repeats import repeats

DIGITS = 1e-6
EYE = np.eye(3)
SHIFT = 1e-6


class Held(NamedTuple):
    """A deck's text; stiffness of its ties, the rows that are held, and forces by load set."""

    text: str
    stiffness: np.ndarray
    held: np.ndarray
    forces: dict[int, np.ndarray]


def directions(deck, grid, cid):
    """Rows: unit vectors of the system ``cid`` at ``grid``."""
    return np.array([components(*deck.systems[cid], deck.places[grid], e) for e in EYE]).T


def held_deck(deck: RandomDeck, seed: int) -> Held:
    """More cards for ``deck``, and what they mean."""
    rng = np.random.default_rng([7, seed])
    size = 6 * len(deck.free)
    lines: list[str] = []
    K, zero = np.zeros((size, size)), np.zeros(3)

    def both(axes: np.ndarray) -> np.ndarray:
        return np.kron(np.eye(2), axes)

    names = list(deck.places)
    for k in range(3):
        a, b = (int(n) for n in rng.choice(deck.free, 2, replace=False))
        values = 10.0 ** rng.uniform(2, 5, 6) * (rng.random(6) < 0.7)
        lines += card(rng, "PBUSH", 40 + k, "K", *values)
        s = float(rng.choice([0.5, 0.2, 0.0]))
        along = deck.places[b] - deck.places[a]
        if k == 0:
            up = rng.standard_normal(3)
            shown = [*components(*deck.systems[deck.moves_in[a]], deck.places[a], up), None]
            x = along / np.linalg.norm(along)
            z = np.cross(x, up) / np.linalg.norm(np.cross(x, up))
            axes = np.array([x, np.cross(z, x), z])
        else:
            cid = int(rng.choice(list(deck.systems)))
            axes, shown = directions(deck, a, cid), [None, None, None, cid]
        ground, point = k == 2, zero if k == 2 else s * along
        if k and seed % 2:  # the elastic point in a system at its first grid
            turn, point = turned(rng), rng.uniform(-0.5, 0.5, 3)
            points = [deck.places[a], deck.places[a] + turn[:, 2], deck.places[a] + turn[:, 0]]
            lines += card(rng, "CORD2R", 90 + k, 0, *np.concatenate(points))
            shown += [s + k, 90 + k, *(turn.T @ point)]  # S means nothing beside it, whatever it is
        else:
            shown += [None if ground else s]
        lines += card(rng, "CBUSH", 700 + k, 40 + k, a, None if ground else b, *shown)
        T = motion(deck, a, point)
        if not ground:
            T = motion(deck, b, point - along) - T
        T = both(axes) @ T
        K += T.T @ np.diag(values) @ T
    for k in range(3):
        grid, c, stiffness = int(rng.choice(names)), int(rng.integers(1, 7)), 10.0 ** rng.uniform(2, 5)
        if k:
            lines += card(rng, "CELAS2", 800 + k, stiffness, grid, c)
        else:
            lines += card(rng, "PELAS", 60, stiffness) + card(rng, "CELAS1", 800, 60, None, None, grid, c)
        row = (both(directions(deck, grid, deck.moves_in[grid])) @ motion(deck, grid, zero))[c - 1]
        K += stiffness * np.outer(row, row)
    rows, sets = [], set[int]()
    for grid in rng.choice(deck.free, 3, replace=False):
        held = "".join(sorted(rng.choice(list("123456"), int(rng.integers(1, 7)), replace=False)))
        one = rng.random() < 0.5
        lines += card(rng, "SPC1", 71, held, int(grid)) if one else card(rng, "SPC", 70, int(grid), held)
        sets.add(71 if one else 70)
        own = both(directions(deck, grid, deck.moves_in[grid])) @ motion(deck, int(grid), zero)
        rows += [own[int(digit) - 1] for digit in held]
    lines += card(rng, "SPCADD", 72, *sorted(sets))
    forces: dict[int, np.ndarray] = {sid: np.zeros(size) for sid in (5, 6)}
    for sid, name in ((5, "FORCE"), (5, "MOMENT"), (6, "FORCE"), (6, "FORCE")):
        grid, cid, factor = int(rng.choice(names)), int(rng.integers(0, 6)), rng.uniform(-2.0, 2.0)
        vector = rng.standard_normal(3)
        lines += card(rng, name, sid, grid, cid, factor, *vector)
        T = motion(deck, grid, zero)[slice(0, 3) if name == "FORCE" else slice(3, 6)]
        forces[sid] += T.T @ directions(deck, grid, cid).T @ vector * factor
    lines += card(rng, "LOAD", 9, 2.0, 0.5, 5, -3.0, 6)
    forces[9] = forces[5] - 6.0 * forces[6]
    text = deck.text.replace("METHOD = 1", "spc 72").replace("ENDDATA", "\n".join([*lines, "ENDDATA"]))
    return Held(text, K, np.array(rows), forces)


def converted(tmp_path, text, formulation) -> Any:
    (tmp_path / "a.dat").write_text(text)
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), formulation, "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    (tmp_path / "e.toml").write_text(document_text(made.environment, "a"))
    return md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")


def frequencies(K, M):
    """By the inverse problem: some rotations have no mass, and their frequencies no end."""
    shift = SHIFT * np.linalg.norm(K) / np.linalg.norm(M)
    mu = scipy.linalg.eigh(M, K + shift * M, eigvals_only=True)[::-1]
    return np.sqrt(np.maximum(1.0 / mu[mu > 1e-13 * mu[0]] - shift, 0.0))


def work(deck, case):
    """The forces of a load case in the freedoms of the free grids."""
    found = np.zeros(6 * len(deck.free))
    for load in case.loads:
        T = motion(deck, int(load.frame[1:]), load.offset)
        found += T.T @ np.concatenate([load.force, load.moment])
    return found


@pytest.mark.parametrize("formulation", ["consistent", "coupled", "lumped"])
def test_held_decks_are_those_of_the_textbook(tmp_path, campaign, formulation):
    for seed in campaign(60):
        deck = random_deck(1000 + seed)
        held = held_deck(deck, seed)
        structure, environment = converted(tmp_path, held.text, formulation)
        K, M = textbook(deck, formulation)
        free = scipy.linalg.null_space(held.held)
        expected = frequencies(free.T @ (K + held.stiffness) @ free, free.T @ M @ free)
        omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
        count = min(len(omega), len(expected))
        assert count == len(omega)
        np.testing.assert_allclose(omega, expected[:count], rtol=DIGITS, err_msg=f"{seed}")
        for case in structure.load_cases:
            np.testing.assert_allclose(work(deck, case), held.forces[int(case.name[4:])], atol=1e-7)
        assert [case.name for case in structure.load_cases] == ["load5", "load6", "load9"]


def fit(deck, at, shares, size):
    """Weighted least squares of the motion at ``at``: turns with the mean distance squared (RBE3)."""
    rows, seen = [], []
    mean = np.mean([np.linalg.norm(deck.places[g] - at) for g, _, _ in shares])
    for grid, weight, digits in shares:
        own = np.kron(np.eye(2), directions(deck, grid, deck.moves_in[grid]))
        rigid = np.eye(6)
        rigid[:3, 3:] = np.array([np.cross(e, deck.places[grid] - at) for e in EYE]).T
        for c in (int(d) - 1 for d in digits):
            scale = np.sqrt(weight) * (1.0 if c < 3 else mean)
            rows.append(scale * own[c] @ rigid)
            seen.append(scale * np.pad(own[c] @ motion(deck, grid, np.zeros(3)), (0, size)))
    return np.linalg.lstsq(np.array(rows), np.array(seen), rcond=None)[0]


def linked_deck(deck: RandomDeck, text: str, seed: int) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """A mass on an average, one on a partial link with an equation: text, rows, stiffness and mass."""
    rng = np.random.default_rng([8, seed])
    size, names = 6 * len(deck.free), list(deck.places)
    at, zero = rng.uniform(-1.0, 1.0, 3), np.zeros(3)
    some = [int(g) for g in rng.choice(names, 4, replace=False)]
    moves = ["123", "123", "123456", str(rng.choice(["12", "3", "1235"]))]
    if seed % 3 == 0:  # shifts and turns of the same grids, each with a weight of its own
        some, moves = 2 * some, [*(m.strip("456") or "3" for m in moves), *("456", "4", "56", "5")]
    shares = [(g, float(rng.uniform(0.5, 2.0)), m) for g, m in zip(some, moves, strict=True)]
    carrier = int(rng.choice(names))
    place = deck.places[carrier] + rng.uniform(-0.5, 0.5, 3)
    cm = "".join(sorted(rng.choice(list("123456"), int(rng.integers(1, 5)), replace=False)))
    lines = card(rng, "GRID", 9001, 0, *at) + card(rng, "GRID", 9002, 0, *place)
    lines += card(rng, "RBE3", 9001, None, 9001, 123456, *(x for g, w, m in shares for x in (w, int(m), g)))
    lines += card(rng, "RBE2", 9002, carrier, int(cm), 9002)
    lines += card(rng, "CONM2", 9201, 9001, 0, 2.0, 0.0, 0.0, 0.0, None, 0.1, 0.0, 0.2, 0.0, 0.0, 0.3)
    lines += card(rng, "CONM2", 9202, 9002, 0, 3.0, 0.0, 0.0, 0.0, None, 0.3, 0.0, 0.2, 0.0, 0.0, 0.1)
    for c in range(1, 7):
        lines += card(rng, "CELAS2", 9100 + c, 1.0e4, 9002, c)
    K, M = np.zeros((2, size + 12, size + 12))
    K[size + 6 :, size + 6 :] = 1.0e4 * np.eye(6)
    M[size:, size:] = np.diag([2.0, 2.0, 2.0, 0.1, 0.2, 0.3, 3.0, 3.0, 3.0, 0.3, 0.2, 0.1])
    follow = -fit(deck, at, shares, 12)
    follow[:, size : size + 6] += np.eye(6)
    rigid = -np.pad(motion(deck, carrier, place - deck.places[carrier]), ((0, 0), (0, 12)))
    rigid[:, size + 6 :] += np.eye(6)
    free = next(c for c in "123456" if c not in cm)
    other, component, factors = int(rng.choice(names)), int(rng.integers(1, 7)), rng.uniform(0.5, 2.0, 2)
    lines += card(rng, "MPC", 77, 9002, int(free), factors[0], other, component, factors[1])
    own = np.kron(np.eye(2), directions(deck, other, deck.moves_in[other])) @ motion(deck, other, zero)
    equation = np.pad(factors[1] * own[component - 1], (0, 12))
    equation[size + 5 + int(free)] += factors[0]
    rows = np.vstack([follow, rigid[[int(c) - 1 for c in cm]], equation])
    text = text.replace("spc 72", "spc 72\nMPC = 77").replace("ENDDATA", "\n".join([*lines, "ENDDATA"]))
    return text, rows, K, M


def test_decks_with_averages_partial_links_and_equations_are_those_of_the_textbook(tmp_path, campaign):
    for seed in campaign(60):
        deck = random_deck(3000 + seed)
        held = held_deck(deck, seed)
        text, rows, more, mass = linked_deck(deck, held.text, seed)
        structure, environment = converted(tmp_path, text, "consistent")
        K, M = (np.pad(A, (0, 12)) for A in textbook(deck, "consistent"))
        K = K + more + np.pad(held.stiffness, (0, 12))
        free = scipy.linalg.null_space(np.vstack([np.pad(held.held, ((0, 0), (0, 12))), rows]))
        expected = frequencies(free.T @ K @ free, free.T @ (M + mass) @ free)
        omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
        count = min(len(omega), len(expected))
        assert count == len(omega)
        worst = np.abs(omega / expected[:count] - 1.0).max()
        assert worst < DIGITS, (seed, worst)


def split_deck(deck: RandomDeck, held: Held, seed: int) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """A mass on a bar whose independent components are at both its ends: text, rows, stiffness and mass."""
    rng = np.random.default_rng([10, seed])
    size, loose = 6 * len(deck.free), ~held.held.any(axis=0).reshape(-1, 6).any(axis=1)
    carrier = int(rng.choice(np.array(deck.free)[loose]))  # what depends may not be held too
    arm = rng.uniform(-0.5, 0.5, 3)
    own = np.kron(np.eye(2), directions(deck, carrier, deck.moves_in[carrier]))
    far = np.eye(6)
    far[:3, 3:] = np.array([np.cross(e, arm) for e in EYE]).T
    rigid = np.vstack([own, far])  # components of both ends in a motion as one body about the first
    while True:
        drawn = np.sort(rng.choice(12, 6, replace=False))
        if 0 < sum(drawn < 6) < 6 and np.linalg.cond(rigid[drawn]) < 1e3:
            break
    others = np.setdiff1d(np.arange(12), drawn)
    digits = [int("".join(str(c % 6 + 1) for c in s if c // 6 == k)) for s in (drawn, others) for k in (0, 1)]
    lines = card(rng, "GRID", 9003, 0, *(deck.places[carrier] + arm))
    lines += card(rng, "RBAR", 9003, carrier, 9003, *digits[: 2 if seed % 2 else 4])
    lines += card(rng, "CONM2", 9203, 9003, 0, 3.0, 0.0, 0.0, 0.0, None, 0.3, 0.0, 0.2, 0.0, 0.0, 0.1)
    for c in range(1, 7):
        lines += card(rng, "CELAS2", 9300 + c, 1.0e4, 9003, c)
    seen = np.zeros((12, size + 6))
    seen[:6, :size], seen[6:, size:] = own @ motion(deck, carrier, np.zeros(3)), np.eye(6)
    rows = seen[others] - rigid[others] @ np.linalg.solve(rigid[drawn], seen[drawn])
    K, M = np.zeros((2, size + 6, size + 6))
    K[size:, size:], M[size:, size:] = 1.0e4 * np.eye(6), np.diag([3.0, 3.0, 3.0, 0.3, 0.2, 0.1])
    return held.text.replace("ENDDATA", "\n".join([*lines, "ENDDATA"])), rows, K, M


def test_bars_with_independent_components_at_both_ends_are_those_of_the_textbook(tmp_path, campaign):
    for seed in campaign(60):
        deck = random_deck(5000 + seed)
        held = held_deck(deck, seed)
        text, rows, more, mass = split_deck(deck, held, seed)
        structure, environment = converted(tmp_path, text, "consistent")
        K, M = (np.pad(A, (0, 6)) for A in textbook(deck, "consistent"))
        K = K + more + np.pad(held.stiffness, (0, 6))
        free = scipy.linalg.null_space(np.vstack([np.pad(held.held, ((0, 0), (0, 6))), rows]))
        expected = frequencies(free.T @ K @ free, free.T @ (M + mass) @ free)
        omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
        worst = np.abs(omega / expected[: len(omega)] - 1.0).max()
        assert worst < DIGITS, (seed, worst)


@pytest.mark.parametrize("seed", repeats(range(12), 2))
def test_gravity_is_the_sum_of_its_cards(tmp_path, seed):
    """GRAV in turned systems, summed and scaled by LOAD with a force, in mm and tonnes."""
    deck, rng = random_deck(seed), np.random.default_rng([9, seed])
    turned = [n for n, (kind, _, _) in deck.systems.items() if kind == "R"]
    lines, g = [], np.zeros(3)
    whole, factors = rng.uniform(0.5, 2.0), rng.uniform(-2.0, 2.0, 3)
    for k, factor in enumerate(factors):
        cid, size, vector = int(rng.choice(turned)), rng.uniform(1.0, 9.0), rng.standard_normal(3)
        lines += card(rng, "GRAV", 40 + k, cid, size, *vector)
        g += whole * factor * size * deck.systems[cid][2] @ vector
    push = rng.standard_normal(3)
    lines += card(rng, "FORCE", 50, deck.free[0], 0, 1.0, *push)
    lines += card(rng, "LOAD", 60, whole, *(x for k in range(3) for x in (factors[k], 40 + k)), 1.0, 50)
    lines += card(rng, "SPC1", 71, "123456", deck.free[0])
    text = deck.text.replace("METHOD = 1", "SPC = 71\nLOAD = 60").replace(
        "ENDDATA", "\n".join([*lines, "ENDDATA"])
    )
    (tmp_path / "a.dat").write_text(text)
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("mm-t-s-N"), "consistent", "a")
    constants = made.environment["constants"]
    found = constants["gravity_m_s2"] * constants["gravity_direction"]
    np.testing.assert_allclose(found, 1e-3 * g, rtol=1e-6, atol=1e-9)
    (case,) = made.document["load_case"]
    np.testing.assert_allclose(case["load"][0]["force_n"], whole * push, rtol=1e-6, atol=1e-9)
