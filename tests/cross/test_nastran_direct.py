"""Matrices by direct input (K2GG, M2GG): half a beam given as textbook matrices is the beam given as bars."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from cli_runner import middeck
from middeck.structure.model.component import WAYS

E, A, I2, J, G, RHO, L = 7e10, 4e-4, 2e-8, 4e-8, 2.6e10, 2700.0, 0.4
GRIDS = "".join(f"GRID,{k},,{L * (k - 1)},0.,0.\n" for k in range(1, 6))
PROPERTIES = f"PBAR,1,1,{A:.3E},{I2:.3E},{I2:.3E},{J:.3E}\nMAT1,1,{E:.3E},{G:.3E},,{RHO}\n"


def bar(k: int) -> str:
    return f"CBAR,{k},1,{k},{k + 1},0.,1.,0.\n"


def beam_stiffness() -> np.ndarray:
    """Euler-Bernoulli along x (Przemieniecki 1968, eq. 5.116 without shear)."""
    K = np.zeros((12, 12))
    for i, k in ((0, E * A / L), (3, G * J / L)):
        K[np.ix_([i, i + 6], [i, i + 6])] = k * np.array([[1, -1], [-1, 1]])
    bend = np.array([[12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2],
                     [-12, -6 * L, 12, -6 * L], [6 * L, 2 * L**2, -6 * L, 4 * L**2]])  # fmt: skip
    for at, sign in (([1, 5, 7, 11], 1.0), ([2, 4, 8, 10], -1.0)):
        flip = np.diag([1.0, sign, 1.0, sign])
        K[np.ix_(at, at)] = E * I2 / L**3 * flip @ bend @ flip
    return K


def half(bars: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness, and halves of the mass at the ends."""
    K, M = np.zeros((6 * bars + 6,) * 2), np.zeros((6 * bars + 6,) * 2)
    for k in range(bars):
        at = slice(6 * k, 6 * k + 12)
        K[at, at] += beam_stiffness()
        M[at, at] += np.diag(np.tile([0.5 * RHO * A * L] * 3 + [0.0] * 3, 2))
    return K, M


def punch(name: str, matrix: np.ndarray, points: list[tuple[int, int]], form: str = "16.9E") -> str:
    """One triangle, large fields."""
    lines = [f"DMIG    {name:8}{0:8d}{6:8d}{2:8d}{0:8d}"]
    for j, (g, c) in enumerate(points):
        rows = [(i, *points[i]) for i in range(j, len(points)) if matrix[i, j]]
        if rows:
            lines.append(f"DMIG*   {name:16}{g:16d}{c:16d}")
            lines += [f"*       {p:16d}{d:16d}{matrix[i, j]:{form}}" for i, p, d in rows]
    return "\n".join(lines) + "\n"


def converted(folder: Path, capfd: pytest.CaptureFixture[str], name: str, case: str, bulk: str, *more: str):
    (folder / f"{name}.dat").write_text(f"SOL 103\nCEND\n{case}BEGIN BULK\n{bulk}ENDDATA\n")
    ask = ("convert", folder / f"{name}.dat", "--units", "m-kg-s-N", "--mass-formulation", "lumped")
    return middeck(capfd, *ask, "-o", folder / f"{name}.toml", *more)


def frequencies(folder: Path, name: str) -> np.ndarray:
    structure, around = md.load_setup(folder / f"{name}.toml", folder / f"{name}-held.toml")
    return md.solve_modes(md.solve_equilibrium(structure, around), 8).frequency_hz[:8]


@pytest.mark.parametrize("moves_in", [0, 6])
def test_half_a_cantilever_by_matrices(tmp_path, capfd, moves_in):
    """The matrices in the basic axes, and in those of the system in which GRDSET has all grids move."""
    held = GRIDS + PROPERTIES + "SPC1,1,123456,1\n"
    K, M = half(2)
    if moves_in:  # its axes along basic y, z, x
        held += "GRDSET,,,,,,6\nCORD2R,6,0,0.,0.,0.,1.,0.,0.\n,0.,1.,0.\n"
        own = np.concatenate([6 * k + np.array([1, 2, 0, 4, 5, 3]) for k in range(3)])
        K, M = K[np.ix_(own, own)], M[np.ix_(own, own)]
    points = [(g, c) for g in (3, 4, 5) for c in range(1, 7)]
    direct = punch("KHALF", K, points) + punch("MHALF", M, points) + punch("KIDLE", K, points)
    whole = held + "".join(map(bar, (1, 2, 3, 4)))
    parts = held + bar(1) + bar(2) + direct
    for name, case, bulk in (
        ("whole", "SPC = 1\n", whole),
        ("parts", "SPC = 1\nPARAM,CK2,1.0\nK2GG = KHALF\nM2GG = MHALF\n", parts),
    ):
        ended = converted(tmp_path, capfd, name, case, bulk, "--environment", tmp_path / f"{name}-held.toml")
        assert ended.code == 0, ended.err
    assert "not selected" in ended.out  # KIDLE
    np.testing.assert_allclose(frequencies(tmp_path, "parts"), frequencies(tmp_path, "whole"), rtol=1e-8)


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("M2GG = KHALF\n", "a mass between grids 3 and 4 without a stiffness"),
        ("K2GG = KSKEW\n", "the stiffness is not symmetric"),
        ("K2GG = KSOFT\n", "the stiffness is not symmetric"),
        ("K2GG = KCOND\n", "do to each other is no stiffness"),
        ("K2GG = KPOINT\n", "scalar point 9 in a matrix that stands alone"),
        ("K2GG = KHALF\nM2GG = NONE\n", "no DMIG NONE"),
        ("K2GG = KHALF\nM2GG = 2.0*MHALF\n", "a factor"),
        ("K2GG = KHALF\nM2GG = MHALF\nA2GG = KHALF\n", "A2GG"),
        ("K2GG = MHALF\nM2GG = KHALF\n", "mass"),
        ("K2GG = KHALF\nM2GG = MCUT\n", "DMIG MCUT: a column without entries"),
        ("K2GG = KHALF\nM2GG = MLOSS\n", "DMIG MLOSS: type TIN = 4, form IFO = 6: real matrices (TIN 1, 2)"),
        ("PARAM,CK2,2.\nK2GG = KHALF\nM2GG = MHALF\n", "PARAM CK2 = 2.: scales matrices"),
    ],
)
def test_matrices_that_are_no_component(tmp_path, capfd, case, message):
    K, M = half(2)
    points = [(g, c) for g in (3, 4, 5) for c in range(1, 7)]
    bulk = GRIDS + PROPERTIES + bar(1) + bar(2) + punch("KHALF", K, points) + punch("MHALF", M, points)
    bulk += "DMIG,KSKEW,0,1,2,0\nDMIG,KSKEW,3,1,,3,1,1.\n,4,1,1.\nSPOINT,9\n"
    bulk += "DMIG,MCUT,0,6,2,0\nDMIG,MCUT,3,1,,3,1,1.\nDMIG,MCUT,4,1\n"
    bulk += "DMIG,MLOSS,0,6,4,0\nDMIG,MLOSS,3,1,,3,1,1.,.1\n"
    # Soft between two grids, on one side of the diagonal only, beside a stiff turn.
    bulk += "DMIG,KSOFT,0,1,2,0\nDMIG,KSOFT,3,1,,3,1,5.\n,4,1,-5.\nDMIG,KSOFT,4,1,,4,1,5.\n"
    bulk += "DMIG,KSOFT,3,4,,3,4,1.+9\n"
    # Flexible between its ends too: no sum of what two grids do to each other.
    H = np.linalg.inv(np.linalg.inv(K[6:, 6:]) + 1e-9 * np.eye(12))
    R = -np.vstack([carried(L), carried(2.0 * L)])
    whole = np.block([[R.T @ H @ R, R.T @ H], [H @ R, H]])
    bulk += punch("KCOND", whole, points) + punch("KPOINT", np.eye(1), [(9, 0)])
    ended = converted(tmp_path, capfd, "bad", case, bulk)
    assert ended.code in (2, 3, 4)
    assert message in ended.err
    assert not list(tmp_path.glob("*.toml"))
    assert not list(tmp_path.glob("*.npz"))


def stiffly_tied(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Stiffness of about 1e9 N/m between two bodies, their masses, the places, and cards without the tie."""

    def arm(x: float, y: float, z: float) -> np.ndarray:
        return np.block([[np.eye(3), np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])],
                         [np.zeros((3, 3)), np.eye(3)]])  # fmt: skip

    at = np.round(rng.uniform(-1.5, 1.5, (2, 3)), 4)
    turn = np.kron(np.eye(2), np.linalg.qr(rng.standard_normal((3, 3)))[0])
    middle = 0.3 * at[0] + 0.7 * at[1]
    between = np.hstack([-arm(*(middle - at[0])), arm(*(middle - at[1]))])
    k = 10.0 ** rng.uniform([8.7] * 3 + [7.0] * 3, [9.3] * 3 + [8.0] * 3)
    masses = np.diag([40.0] * 3 + [6.0, 5.0, 4.0] + [10.0] * 3 + [0.5, 0.4, 0.6])
    cards = "".join("GRID,{},,{},{},{}\n".format(n, *map(float, p)) for n, p in enumerate(at, 1))
    cards += "CONM2,51,1,,40.\n,6.,,5.,,,4.\nCONM2,52,2,,10.\n,.5,,.4,,,.6\n"
    return between.T @ turn @ np.diag(k) @ turn.T @ between, masses, at, cards


HOLD = "PBUSH,9,K,200.,200.,200.,100.,100.,100.\nCBUSH,9,9,1,,,,,0\n"
SOFT = np.diag([200.0] * 3 + [100.0] * 3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("within", [False, True])
def test_a_soft_hold_of_what_is_tied_stiffly_is_all_that_holds_it(tmp_path, capfd, seed, within):
    """Ten digits tell 200 N/m beside 1e9: no spring to the ground comes of roundings, none is lost."""
    K, M, _, cards = stiffly_tied(np.random.default_rng(seed))
    held = K + np.pad(SOFT, (0, 6))
    cards += "" if within else HOLD
    bulk = cards + punch("KTIED", held if within else K, POINTS)
    around = tmp_path / "soft-held.toml"
    ended = converted(tmp_path, capfd, "soft", "K2GG = KTIED\n", bulk, "--environment", around)
    assert ended.code == 0, ended.err
    assert around.read_text().count("[[bushing]]") == 1
    expected = np.sqrt(scipy.linalg.eigh(held, M, eigvals_only=True)[:6]) / (2.0 * np.pi)
    np.testing.assert_allclose(frequencies(tmp_path, "soft")[:6], expected, rtol=RTOL[within])


RTOL = {False: 1e-4, True: 2e-2}  # roundings of the printed matrix: 0.5 N/m of 200
POINTS = [(g, c) for g in (1, 2) for c in range(1, 7)]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("form", ["16.7E", "16.6E", "16.5E"])
@pytest.mark.parametrize("hold", ["", HOLD])
def test_digits_that_cannot_show_a_spring_to_the_ground_are_reported(tmp_path, capfd, seed, form, hold):
    """Refused with the cause, or converted with nothing else to the ground: never held by roundings."""
    K, _, _, cards = stiffly_tied(np.random.default_rng(seed))
    around = tmp_path / "few-held.toml"
    bulk = cards + hold + punch("KTIED", K, POINTS, form)
    ended = converted(tmp_path, capfd, "few", "K2GG = KTIED\n", bulk, "--environment", around)
    if ended.code == 0:
        assert form == "16.7E"
        assert around.read_text().count("[[bushing]]") == bool(hold)
    else:
        assert f"too few digits, {int(form[3]) + 1} here" in ended.err
        assert "16.9E" in ended.err
        assert "SPC" not in ended.err


@pytest.mark.parametrize("seed", range(4))
def test_places_of_fewer_digits_than_the_matrix_hold_nothing(tmp_path, capfd, seed):
    """Grids as a field of eight columns has them, seven digits, beside a matrix of the exact places."""
    rng = np.random.default_rng(seed)
    K, _, at, cards = stiffly_tied(rng)
    moved = at + rng.uniform(-5e-8, 5e-8, at.shape)
    for old, new in zip(at.ravel(), moved.ravel(), strict=True):
        cards = cards.replace(f",{float(old)}", f",{float(new)!r}", 1)
    ended = converted(tmp_path, capfd, "free", "K2GG = KTIED\n", cards + punch("KTIED", K, POINTS))
    assert ended.code == 0 or "those of the grids' places" in ended.err
    assert "SPC" not in ended.err


@pytest.mark.parametrize(("tie", "ground"), [(1e6, 1e6), (3e5, 2e4), (1000.0, 1.0)])
@pytest.mark.parametrize("form", ["#16.0f", "16.3E", "16.9E"])
def test_numbers_written_by_hand_are_exact(tmp_path, capfd, tie, ground, form):
    """Two masses in one place, tied and grounded alike in all directions: 2 by 2 by hand."""
    cards = (
        "GRID,1,,0.,0.,0.\nGRID,2,,0.,0.,0.\nCONM2,51,1,,40.\n,6.,,6.,,,6.\nCONM2,52,2,,10.\n,.5,,.5,,,.5\n"
    )
    K = np.kron([[tie + ground, -tie], [-tie, tie]], np.eye(6))
    bulk = cards + punch("KHAND", K, POINTS, form)
    around = tmp_path / "hand-held.toml"
    ended = converted(tmp_path, capfd, "hand", "K2GG = KHAND\n", bulk, "--environment", around)
    assert ended.code == 0, ended.err
    structure, environment = md.load_setup(tmp_path / "hand.toml", around)
    found = md.solve_modes(md.solve_equilibrium(structure, environment)).frequency_hz
    pairs = [np.linalg.eigvals(K[::6, ::6] / np.array([[a], [b]])) for a, b in ((40.0, 10.0), (6.0, 0.5))]
    expected = np.sort(np.sqrt(np.repeat(np.concatenate(pairs), 3))) / (2.0 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("form", ["16.9E", "16.8E", "16.7E"])
def test_what_slides_freely_between_two_grids_is_not_held_by_digits(tmp_path, capfd, seed, form):
    """A tie without stiffness one way, skew to all axes: seven motions of no stiffness, or told."""
    rng = np.random.default_rng(seed)
    _, M, at, cards = stiffly_tied(rng)
    x, y, z = at[1] - at[0]
    lever = np.eye(6)
    lever[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    between, axes = np.hstack([-lever, np.eye(6)]), np.linalg.qr(rng.standard_normal((6, 6)))[0]
    K = between.T @ axes @ np.diag([0.0, 1e7, 1e8, 1e9, 1e8, 1e7]) @ axes.T @ between
    around = tmp_path / "loose-held.toml"
    bulk = cards + punch("KLOOSE", K, POINTS, form)
    ended = converted(tmp_path, capfd, "loose", "K2GG = KLOOSE\n", bulk, "--environment", around)
    if ended.code:
        assert form == "16.7E"
        assert "too few digits, 8 here" in ended.err
        return
    found = frequencies(tmp_path, "loose")
    expected = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[7]) / (2.0 * np.pi)
    np.testing.assert_allclose(found[7], expected, rtol=1e-5)
    assert found[6] <= 1e-5 * expected


def carried(x: float) -> np.ndarray:
    """Motion at ``x`` along the beam of one that moves as a rigid body about its start."""
    T = np.eye(6)
    T[1, 5], T[2, 4] = x, -x
    return T


def bodies() -> tuple[np.ndarray, str, str]:
    """Mass matrices of a body on each of grids 2 to 5, as one matrix, as DMIG and as CONM2."""
    rng = np.random.default_rng(5)
    M, cards = np.zeros((24, 24)), ""
    for k in range(4):
        m, *xyz = rng.uniform(1.0, 2.0), *rng.uniform(-0.1, 0.1, 3).tolist()
        (x, y, z), d = xyz, rng.uniform(0.01, 0.015, 3).tolist()
        arm = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        M[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = np.block(
            [[m * np.eye(3), m * arm], [m * arm.T, np.diag(d) + m * arm.T @ arm]]
        )
        cards += f"CONM2,{80 + k},{k + 2},,{m!r},{x!r},{y!r},{z!r}\n,{d[0]!r},,{d[1]!r},,,{d[2]!r}\n"
    return M, punch("MBODY", M, [(g, c) for g in (2, 3, 4, 5) for c in range(1, 7)]), cards


@pytest.mark.parametrize(("alone", "grounded"), [("K2GG", False), ("K2GG", True), ("M2GG", False)])
def test_a_matrix_that_stands_alone(tmp_path, capfd, alone, grounded):
    """A cantilever of four bars with bodies on its grids; some of it as matrices, its tip on a full 6x6."""
    rng = np.random.default_rng(6)
    K, points = np.zeros((30, 30)), [(g, c) for g in (3, 4, 5) for c in range(1, 7)]
    for k in range(4):
        K[6 * k : 6 * k + 12, 6 * k : 6 * k + 12] += beam_stiffness()
    part = half(2)[0]
    if grounded:
        draw = rng.standard_normal((6, 6)) * 100.0
        K[24:, 24:] += draw @ draw.T
        part[12:, 12:] += draw @ draw.T
    M, direct, cards = bodies()
    bulk = GRIDS + PROPERTIES.replace("2700.0", "") + "SPC1,1,123456,1\n" + bar(1) + bar(2)
    case = "SPC = 1\n"
    if alone == "M2GG":
        bulk, case = bulk + bar(3) + bar(4) + direct, f"{case}M2GG = MBODY\n"
    else:
        bulk, case = bulk + cards + punch("KPART", part, points), f"{case}K2GG = KPART\n"
    ended = converted(tmp_path, capfd, "lone", case, bulk, "--environment", tmp_path / "lone-held.toml")
    assert ended.code == 0, ended.err
    expected = np.sqrt(scipy.linalg.eigh(K[6:, 6:], M, eigvals_only=True)[:8]) / (2.0 * np.pi)
    np.testing.assert_allclose(frequencies(tmp_path, "lone"), expected, rtol=1e-7)


@pytest.mark.parametrize("way", range(6))
def test_a_line_of_grids_that_is_grounded_is_no_component(tmp_path, capfd, way):
    """Lumped masses on a line have no inertia about it: as one body that turn has no energy."""
    K, M = half(2)
    K[12 + way, 12 + way] *= 1.01
    points = [(g, c) for g in (3, 4, 5) for c in range(1, 7)]
    bulk = GRIDS + PROPERTIES + "SPC1,1,123456,1\n" + bar(1) + bar(2) + punch("KHALF", K, points)
    case = "SPC = 1\nK2GG = KHALF\nM2GG = MHALF\n"
    ended = converted(tmp_path, capfd, "bad", case, bulk + punch("MHALF", M, points))
    assert ended.code == 4
    assert "resists a motion as one body" in ended.err
    assert f"most at grid 5 {WAYS[way]}: is it grounded" in ended.err
    assert "invalid value" not in ended.err


def test_matrices_on_a_grid_that_follows_another(tmp_path, capfd):
    """Half a cantilever whose first grid follows the end of the other half by a rigid link."""
    K, M = half(2)
    points = [(g, c) for g in (6, 4, 5) for c in range(1, 7)]
    bulk = GRIDS + PROPERTIES + "SPC1,1,123456,1\n" + bar(1) + bar(2)
    bulk += (
        f"GRID,6,,{2.0 * L},0.,0.\nRBE2,9,3,123456,6\n"
        + punch("KHALF", K, points)
        + punch("MHALF", M, points)
    )
    held = GRIDS + PROPERTIES + "SPC1,1,123456,1\n" + "".join(map(bar, (1, 2, 3, 4)))
    matrices = "SPC = 1\nK2GG = KHALF\nM2GG = MHALF\n"
    for name, case, text in (("whole", "SPC = 1\n", held), ("parts", matrices, bulk)):
        ended = converted(tmp_path, capfd, name, case, text, "--environment", tmp_path / f"{name}-held.toml")
        assert ended.code == 0, ended.err
    np.testing.assert_allclose(frequencies(tmp_path, "parts"), frequencies(tmp_path, "whole"), rtol=1e-8)


TWO = "".join(f"GRID,{k + r},,{L * (k - 1)},{0.03 * r},0.\n" for r in (0, 10) for k in (1, 2, 3))
TWO += "".join(bar(k) for k in (1, 2, 11, 12)) + PROPERTIES + "SPC1,1,123456,1,11\nCELAS2,90,1.E3,2,2,12,2\n"
CHOSEN = "SPC = 1\nMPC = 7\n"
PINNED = "MPC,7,13,2,1.,3,2,-1.\n"


@pytest.mark.parametrize(
    "constraints",
    [
        "MPC,7,50,2,1.,3,2,-1.\nMPC,7,13,2,1.,50,2,-1.\n",
        "RBE3,60,,50,123,1.,123,3\nMPC,7,13,2,1.,50,2,-1.\n",
        "RBE2,60,3,123,50\nMPC,7,13,2,1.,50,2,-1.\n",
        "RBE2,60,3,123456,50\nMPC,7,13,2,1.,50,2,-1.\n",
    ],
)
def test_constraints_that_meet_at_a_bare_grid_join_what_they_name(tmp_path, capfd, constraints):
    """Two cantilevers whose tips move up together, told in one equation or by way of a grid of no body."""
    for name, bulk in (("one", TWO + PINNED), ("two", TWO + f"GRID,50,,{2 * L},0.,0.\n" + constraints)):
        ended = converted(
            tmp_path, capfd, name, CHOSEN, bulk, "--environment", tmp_path / f"{name}-held.toml"
        )
        assert ended.code == 0, ended.err
    np.testing.assert_allclose(frequencies(tmp_path, "two"), frequencies(tmp_path, "one"), rtol=1e-8)


def test_hinges_of_a_truss_that_constraints_name_do_not_turn(tmp_path, capfd):
    """A rod to a grid of two, the other by an equation: sqrt(k / (m + M)) along it, all else is held."""
    bulk = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.,,23\nGRID,3,,2.,0.,0.,,23\nCROD,1,1,1,2\nPROD,1,1,1.E-4\n"
    bulk += "MAT1,1,7.E10,,.3,0.\nCONM2,8,2,0,2.\nCONM2,9,3,0,3.\nSPC1,1,123,1\nMPC,7,3,1,1.,2,1,-1.\n"
    ended = converted(tmp_path, capfd, "rod", CHOSEN, bulk, "--environment", tmp_path / "rod-held.toml")
    assert ended.code == 0, ended.err
    structure, around = md.load_setup(tmp_path / "rod.toml", tmp_path / "rod-held.toml")
    omega = md.solve_modes(md.solve_equilibrium(structure, around)).omega
    np.testing.assert_allclose(omega, [np.sqrt(7e6 / 5.0)], rtol=1e-9)


@pytest.mark.parametrize("released", ["5", "56", "456", "26"])
def test_a_pinned_end_is_a_row_of_its_own(tmp_path, capfd, released):
    """Two bars between walls, the second pinned to the first: its released components are unknowns apart."""
    pinned = bar(2).rstrip() + f",,+P\n+P,{released}\n"
    bulk = GRIDS.split("GRID,4")[0] + PROPERTIES + "SPC1,1,123456,1,3\n" + bar(1) + pinned
    ended = converted(tmp_path, capfd, "pin", "SPC = 1\n", bulk, "--environment", tmp_path / "pin-held.toml")
    assert ended.code == 0, ended.err
    K = np.zeros((6 + len(released),) * 2)
    K[:6, :6] = beam_stiffness()[6:, 6:]
    own = [int(c) - 1 for c in released]
    rows = [6 + own.index(k) if k in own else k for k in range(6)]
    K[np.ix_(rows, rows)] += beam_stiffness()[:6, :6]
    if released == "456":  # nothing holds its twist
        K[6, 6] = 1.0
    rigid = np.linalg.inv(np.linalg.inv(K)[:3, :3])
    expected = np.sqrt(np.linalg.eigvalsh(rigid) / (RHO * A * L)) / (2.0 * np.pi)
    structure, around = md.load_setup(tmp_path / "pin.toml", tmp_path / "pin-held.toml")
    found = md.solve_modes(md.solve_equilibrium(structure, around), 3).frequency_hz[:3]
    np.testing.assert_allclose(found, expected, rtol=1e-7)


LOOSE = [("456,456", "456,56"), ("23456,23456", "456,56"), ("26,26", "26,"), ("1,1", "1,"), ("2356,2356", "")]


@pytest.mark.parametrize(("released", "alike"), LOOSE)
def test_a_bar_released_until_it_is_loose_bears_what_its_ends_can(tmp_path, capfd, released, alike):
    """A brace beside a cantilever: a mechanism by its pins gives no mode. Without bending it is a rod."""
    both = GRIDS + PROPERTIES + f"SPC1,1,123456,1,9\nGRID,9,,{2 * L},.7,.4\n"
    both += "".join(bar(k) for k in (1, 2, 3, 4))
    rod = f"CROD,8,2,9,4\nPROD,2,1,{A:.3E},{J:.3E}\n"
    found = []
    for name, pins in (("loose", released), ("held", alike)):
        brace = f"CBAR,8,1,9,4,0.,0.,1.,,+P\n+P,{pins}\n" if pins else rod
        around = tmp_path / f"{name}-held.toml"
        ended = converted(tmp_path, capfd, name, "SPC = 1\n", both + brace, "--environment", around)
        assert ended.code == 0, ended.err
        found.append(frequencies(tmp_path, name))
    np.testing.assert_allclose(*found, rtol=1e-7)
    assert found[0][0] > 0.0
