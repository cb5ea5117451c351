"""Random tapered beams against integrals along them: flexibility, mass, frequencies."""

import numpy as np
import pytest
import scipy.linalg

from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.files.nastran.members.section_shapes import section_shape
from middeck.files.setups import load_structure
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.summary.summary import summarise
from nastran_decks import NU, RHO, E, card, local_matrices, skew, turned
from structure_builders import clamped_matrices

G = E / (2.0 * (1.0 + NU))
NAMES = ("A", "I1", "I2", "I12", "J", "nsm", "nsi", "m1", "m2", "n1", "n2")
OWN = 6  # of them at every station
DIGITS = 1e-6  # of the deck's fields


class Taper:
    """A beam of length ``L`` whose numbers are linear between ``x``; ``k`` are its shear factors."""

    def __init__(self, rng, steep=0.5):
        self.L, self.turn = rng.uniform(1.0, 3.0), turned(rng)
        self.x = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0.1, 0.9, rng.integers(0, 3))])).round(3)
        a = 1e-4 * rng.uniform(2.0, 6.0)
        i1, i2 = rng.uniform(1e-8, 9e-8, 2)
        i12 = rng.choice([0.0, 0.4]) * np.sqrt(i1 * i2)
        start = np.array([a, i1, i2, i12, 0.7 * (i1 + i2), rng.choice([0.0, 0.5])])
        more = np.array([2e-4, *rng.uniform(-0.03, 0.03, 4)]) * rng.choice([0.0, 1.0], 5)
        shrink = 1.0 - steep * rng.uniform(0.2, 1.0, (len(self.x), 1)) * (self.x > 0.0)[:, None]
        own = start * shrink ** np.array([1.0, 2.0, 2.0, 2.0, 2.0, 1.0])
        ends = np.array([more, more * rng.choice([1.0, rng.uniform(0.3, 1.0)])])
        lines = ends[0] + self.x[:, None] * (ends[1] - ends[0])
        self.k = tuple(rng.choice([[1.0, 1.0], [0.0, 0.0], [0.6, 0.8]]))
        self.blank = rng.random((len(self.x), OWN)) < 0.3
        self.blank[:, 1:4] = self.blank[:, 1:2]  # else I12 may be too large for I1 and I2
        self.blank[0] = False
        own[-1] = np.where(self.blank[-1], own[0], own[-1])
        straight = own[0] + self.x[:, None] * (own[-1] - own[0])
        own = np.where(self.blank, straight, own)
        self.numbers = np.hstack([own, lines])

    def at(self, x):
        return {n: np.interp(x, self.x, c) for n, c in zip(NAMES, self.numbers.T, strict=True)}

    def deck(self, rng, body=""):
        rows = []
        order = rng.permutation(np.arange(1, len(self.x)))
        for i in order:
            so = str(rng.choice(["YES", "YESA", "NO"]))
            own = [None if b else v for b, v in zip(self.blank[i], self.numbers[i, :OWN], strict=True)]
            rows += [so, self.x[i], *own, *([None] * 8 if so == "YES" else [])]
        a, b = self.at(0.0), self.at(1.0)
        end = [None if a[n] == b[n] else b[n] for n in ("nsi", "m1", "m2", "n1", "n2")]
        rows += [*self.k, None, None, a["nsi"] or None, end[0], None, None]
        rows += [a["m1"], a["m2"], *end[1:3], a["n1"], a["n2"], *end[3:]]
        points = [None] * 8 if rng.random() < 0.5 else [0.01] * 8
        up = self.turn[:, 1]
        lines = card(rng, "PBEAM", 7, 3, *self.numbers[0, :OWN], *points, *rows)
        lines += card(rng, "MAT1", 3, E, None, NU, RHO)
        lines += card(rng, "GRID", 1, None, 0.0, 0.0, 0.0)
        lines += card(rng, "GRID", 2, None, *(self.L * self.turn[:, 0]))
        lines += card(rng, "CBEAM", 5, 7, 1, 2, *up, "BGG")
        return "\n".join(["CEND", "BEGIN BULK", *lines, body, "ENDDATA", ""])

    def compliance(self, x):
        """Strains (extension, shears, twist, curvatures) on the shear axis per section force, at points x."""
        p = self.at(x)
        C = np.zeros((len(x), 6, 6))
        bend = E * np.moveaxis(np.array([[p["I2"], -p["I12"]], [-p["I12"], p["I1"]]]), 2, 0)
        own = np.zeros((len(x), 3, 3))
        own[:, 0, 0], own[:, 1:, 1:] = 1.0 / (E * p["A"]), np.linalg.inv(bend)
        # Moments about the centroid of an axial force on the axis; the extension there of curvatures.
        T = np.tile(np.eye(3), (len(x), 1, 1))
        T[:, 1, 0], T[:, 2, 0] = -p["n2"], p["n1"]
        C[:, [[0], [4], [5]], [0, 4, 5]] = T.mT @ own @ T
        C[:, 3, 3] = 1.0 / (G * p["J"])
        for i, k in zip((1, 2), self.k, strict=True):
            C[:, i, i] = 1.0 / (k * G * p["A"]) if k else 0.0
        return C

    def mass(self, x):
        """6x6 of shift and turn of the shear axis, per length, at points x."""
        p = self.at(x)
        M = np.zeros((len(x), 6, 6))
        bend = RHO * np.array([[p["I2"], -p["I12"]], [-p["I12"], p["I1"]]])
        bare = 0.5 * p["nsi"] * np.eye(2)[:, :, None]
        for m, y, z, own in ((RHO * p["A"], p["n1"], p["n2"], bend), (p["nsm"], p["m1"], p["m2"], bare)):
            T = np.zeros((len(x), 3, 6))
            T[:, :, :3] = np.eye(3)
            T[:, 0, 4], T[:, 0, 5], T[:, 1, 3], T[:, 2, 3] = z, -y, -z, y
            M += m[:, None, None] * (T.mT @ T)
            M[:, 4:, 4:] += np.moveaxis(own, 2, 0)
            M[:, 3, 3] += own[0, 0] + own[1, 1]
        return M

    def quadrature(self, cells):
        """Points and weights of a rule that sees every station."""
        edges = np.unique(np.concatenate([np.linspace(0.0, 1.0, cells + 1), self.x]))
        points, weights = np.polynomial.legendre.leggauss(8)
        middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        return (middle[:, None] + half[:, None] * points).ravel(), (half[:, None] * weights).ravel()


@pytest.mark.parametrize("end", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_beam_that_nearly_ends_in_a_point_turns_by_the_logarithm(tmp_path, end):
    """E I (1 - (1 - e) x / L) under a moment M at its end: M L ln(1 / e) / (E I (1 - e)) in rotation.

    Under a force F it shifts by F L^3 / (E I) times the integral of s^2 / (e + a s) over 0 to 1, a = 1 - e.
    """
    start, L, E = 1e-8, 1.0, 7e10
    text = (
        "SOL 103\nCEND\nBEGIN BULK\nGRID,1\nGRID,2,,1.\nMAT1,1,7.+10,,.3,2700.\n"
        f"PBEAM,1,1,1.-4,{start:.1e},1.-8,,2.-8\n,\n,YES,1.,1.-4,{end * start:.1e},1.-8,,2.-8\n"
        "CBEAM,1,1,1,2,0.,1.,0.\nSPC1,1,123456,1\nENDDATA\n"
    )
    structure, _ = article(tmp_path, text)
    K, _, keep = clamped_matrices(mesh_structure(structure))
    found = np.linalg.inv(K)[np.ix_(*2 * [np.searchsorted(keep, np.arange(6, 12))])]
    a, log = 1.0 - end, np.log(1.0 / end)
    assert found[5, 5] * E * start / L == pytest.approx(log / a, rel=1e-5)
    shift = 0.5 / a - end / a**2 + end**2 / a**3 * log
    assert found[1, 1] * E * start / L**3 == pytest.approx(shift, rel=0.03)


def forces(arm):
    """Forces of a section under unit loads at each ``arm`` beyond it."""
    B = np.tile(np.eye(6), (len(arm), 1, 1))
    B[:, 4, 2], B[:, 5, 1] = -arm, arm
    return B


def flexibility(taper):
    """Motion of end B under loads there, in own axes, with end A clamped."""
    x, w = taper.quadrature(20)
    B = forces(taper.L * (1.0 - x))
    return np.einsum("p,pij->ij", taper.L * w, B.mT @ taper.compliance(x) @ B)


def article(tmp_path, text, formulation="consistent"):
    (tmp_path / "a.dat").write_text(text)
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), formulation, "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    return load_structure(tmp_path / "a.toml"), made


def own_axes(taper):
    return np.kron(np.eye(2), taper.turn)


def test_tip_flexibility_is_the_integral(tmp_path, campaign):
    for seed in campaign(100):
        rng = np.random.default_rng(seed)
        taper = Taper(rng)
        structure, _ = article(tmp_path, taper.deck(rng))
        K, _, keep = clamped_matrices(mesh_structure(structure))
        found = np.linalg.inv(K)[np.ix_(*2 * [np.searchsorted(keep, np.arange(6, 12))])]
        R = own_axes(taper)
        exact = flexibility(taper)
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        assert np.abs((R.T @ found @ R - exact) / scale).max() < DIGITS


@pytest.mark.parametrize(("end", "off"), [(1e-1, 1e-6), (1e-2, 1e-3), (3e-3, 0.02), (1.3e-4, 0.05)])
@pytest.mark.parametrize("of", [range(OWN), [1], [4]], ids=["all", "I1", "J"])
def test_a_steep_taper_has_no_hinge(tmp_path, end, off, of):
    """Constants that keep three integrals are negative where a beam changes steeply: means, and a note."""
    taper = Taper(np.random.default_rng(0), steep=0.0)
    taper.x, taper.blank = np.array([0.0, 1.0]), np.zeros((2, OWN), dtype=bool)
    taper.numbers = np.tile(taper.numbers[0], (2, 1))
    taper.numbers[:, [3, *range(OWN, len(NAMES))]] = 0.0
    taper.numbers[1, of] *= end
    structure, made = article(tmp_path, taper.deck(np.random.default_rng(1)))
    K, _, keep = clamped_matrices(mesh_structure(structure))
    found = np.linalg.inv(K)[np.ix_(*2 * [np.searchsorted(keep, np.arange(6, 12))])]
    R = own_axes(taper)
    taper.quadrature = lambda cells, rule=taper.quadrature: rule(50 * cells)
    exact = flexibility(taper)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert np.abs((R.T @ found @ R - exact) / scale).max() < off
    assert any("divide the beam in the deck" in note for note in made.notes) == (off > 1e-3)


@pytest.mark.parametrize("formulation", ["consistent", "coupled", "lumped"])
def test_mass_is_the_integral(tmp_path, campaign, formulation):
    for seed in campaign(40):
        rng = np.random.default_rng(seed)
        taper = Taper(rng)
        structure, _ = article(tmp_path, taper.deck(rng), formulation)
        summary = summarise(structure)
        x, w = taper.quadrature(4)
        T = np.tile(np.eye(6), (len(x), 1, 1))
        T[:, 2, 4], T[:, 1, 5] = -taper.L * x, taper.L * x
        whole = np.einsum("p,pij->ij", taper.L * w, T.mT @ taper.mass(x) @ T)
        R = own_axes(taper)
        whole = R @ whole @ R.T
        assert summary.mass == pytest.approx(whole[0, 0], rel=DIGITS)
        centre = np.array([whole[5, 1], whole[3, 2], whole[4, 0]]) / whole[0, 0]
        np.testing.assert_allclose(summary.centre, centre, atol=DIGITS)


def frequencies(taper, cells=12, count=4):
    """Of the beam clamped at A, by the integral equation of its motion under its own inertia (Nystrom)."""
    x, w = taper.quadrature(cells)
    order = np.argsort(x)
    x, w = taper.L * x[order], taper.L * w[order]
    n = len(x)
    # Integrals of C, C s and C s^2 from A up to each point.
    ends = np.concatenate([[0.0], x])
    points, weights = np.polynomial.legendre.leggauss(2)
    half = 0.5 * np.diff(ends)[:, None]
    s = (ends[:-1, None] + half * (1.0 + points)).ravel()
    C = (half * weights).ravel()[:, None, None] * taper.compliance(s / taper.L)
    parts = np.array([C, s[:, None, None] * C, (s * s)[:, None, None] * C])
    powers = np.cumsum(parts.reshape(3, n, 2, 6, 6).sum(axis=2), axis=1)
    c0, c1, c2 = powers[:, np.minimum.outer(np.arange(n), np.arange(n))]
    B, arm = forces(x), (forces(np.ones(1)) - forces(np.zeros(1)))[0]
    F = B.mT[:, None] @ (c0 @ B - c1 @ arm) - arm.T @ (c1 @ B - c2 @ arm)
    size, axes = np.linalg.eigh(w[:, None, None] * taper.mass(x / taper.L))
    root = axes * np.sqrt(np.maximum(size, 0.0))[:, None]
    A = (root.mT[:, None] @ F @ root).transpose(0, 2, 1, 3).reshape(6 * n, 6 * n)
    return 1.0 / np.sqrt(np.linalg.eigvalsh(A)[::-1][:count]) / (2.0 * np.pi)


def test_frequencies_are_those_of_the_integral_equation(tmp_path, campaign):
    for seed in campaign(20):
        rng = np.random.default_rng(seed)
        taper = Taper(rng)
        structure, _ = article(tmp_path, taper.deck(rng))
        K, M, _ = clamped_matrices(mesh_structure(structure))
        exact = frequencies(taper)
        found = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[: len(exact)]) / (2.0 * np.pi)
        np.testing.assert_allclose(found[:2], exact[:2], rtol=2e-4)
        np.testing.assert_allclose(found, exact, rtol=5e-3)


# Midlines of thin walls as in the guides' figures, y up and z to the right: where the shear flow starts and
# ends, and the thickness; flows that end at a point go on in the walls that start there.
t = 1e-3
WALLS = {
    ("T", (2.0, 3.0, t, t)): [((3, -1), (3, 0)), ((3, 1), (3, 0)), ((3, 0), (0, 0))],
    ("T2", (2.0, 3.0, t, t)): [((0, -1), (0, 0)), ((0, 1), (0, 0)), ((0, 0), (3, 0))],
    ("T1", (2.0, 3.0, t, t)): [((1, 3), (0, 3)), ((-1, 3), (0, 3)), ((0, 3), (0, 0))],
    ("CHAN", (2.0, 3.0, t, t)): [((3, 2), (3, 0)), ((3, 0), (0, 0)), ((0, 0), (0, 2))],
    ("CHAN1", (2.0, t, 3.0, 3.0 + 2 * t)): [((3, 2), (3, 0)), ((3, 0), (0, 0)), ((0, 0), (0, 2))],
    ("CHAN2", (t, t, 3.0, 2.0)): [((3, 0), (0, 0)), ((0, 0), (0, 2)), ((0, 2), (3, 2))],
    ("I", (3.0, 2.0, 1.0, t, t, t)): [
        ((0, -1), (0, 0)), ((0, 1), (0, 0)), ((0, 0), (3, 0)), ((3, -0.5), (3, 0)), ((3, 0.5), (3, 0)),
    ],
}  # fmt: skip


def shear_flow_centre(walls):
    """The centroid from the shear centre, by the moment of the shear flow of a force along y and along z."""
    ends = np.array(walls, dtype=float)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middle = ends.mean(axis=1)
    centroid = length @ middle / length.sum()
    ends = ends - centroid
    n = 2000
    s = (np.arange(n) + 0.5) / n
    torque = np.zeros(2)
    inertia = np.zeros(2)
    lines = [a + s[:, None] * (b - a) for a, b in ends]
    for line, L in zip(lines, length, strict=True):
        inertia += t * L * np.mean(line**2, axis=0)
    for axis in (0, 1):
        flow_at: dict[tuple[float, ...], float] = {}
        for (a, b), line, L in zip(ends, lines, length, strict=True):
            growth = -t * line[:, axis] * L / n / inertia[axis]
            q = flow_at.get(tuple(a.round(9)), 0.0) + np.cumsum(growth) - 0.5 * growth
            flow_at[tuple(b.round(9))] = flow_at.get(tuple(b.round(9)), 0.0) + q[-1] + 0.5 * growth[-1]
            along = (b - a) / L
            torque[axis] += np.mean(q * (line[:, 0] * along[1] - line[:, 1] * along[0])) * L
    return -np.array([torque[1], -torque[0]])


@pytest.mark.parametrize(("name", "dims"), WALLS)
def test_centroids_are_off_the_centre_of_shear_flow(name, dims):
    shape = section_shape(name, list(dims))
    np.testing.assert_allclose(shape.centroid, shear_flow_centre(WALLS[name, dims]), atol=4e-3)


def test_a_pbeaml_is_the_pbeam_of_its_shapes(tmp_path):
    """Stations in any order, blanks at the end and between; the centroid of a channel is off its axis."""
    sizes = [
        (0.04, 0.06, 0.004, 0.003, 0.2),
        (0.035, 0.05, 0.003, 0.003, 0.15),
        (0.03, 0.04, 0.002, 0.003, 0.1),
    ]
    rows, axes = [], []
    for *dims, nsm in sizes:
        shape = section_shape("CHAN", dims)
        numbers = (shape.area, shape.i1, shape.i2, 0.0, shape.j, nsm)
        rows.append(",".join(f"{x:.12E}" for x in numbers))
        axes.append(shape.centroid)
    beam = ["MAT1,1,7.+10,,.3,2700.", "GRID,1", "GRID,2,,1.", "CBEAM,5,1,1,2,0.,1.,0."]
    long = "PBEAML,1,1,,CHAN\n,.04,.06,.004,.003,.2,NO,1.,.03\n,.04,.002,,.1,,.5,.035,.05\n,.003,,.15"
    deck = "CEND\nBEGIN BULK\n{}\nENDDATA\n"
    _, made = article(tmp_path, deck.format("\n".join([*beam, long])))
    found = made.document["section"]
    short = f"PBEAM,1,1,{rows[0]}\n,NO,.5,{rows[1]}\n,NO,1.,{rows[2]}\n,0.,0.\n,,,,,"
    short += ",".join(f"{x:.12E}" for x in (*axes[0], *axes[2]))
    _, made = article(tmp_path, deck.format("\n".join([*beam, short])))
    for name, table in made.document["section"].items():
        for key, value in table.items():
            if key not in ("mass", "stiffness", "centroid_m", "mass_centre_m"):
                assert found[name][key] == pytest.approx(value, rel=2e-2), (name, key)  # N1 is a line
    ends = [found[f"pbeam1_{k}"]["centroid_m"] for k in (1, len(found))]
    assert ends[0][1] > ends[1][1] > 0.0
    assert abs(ends[0][0]) < 1e-12


def two_lines(count, nsm, m1, m2):
    """Lowest frequencies of a cantilever of ``count`` bars, each with a massless one rigidly beside it."""
    size = 6 * (count + 1)
    K, M = np.zeros((2, size, size))
    own = {"A": 3e-4, "I1": 4e-8, "I2": 6e-8, "I12": 0.0, "J": 9e-8, "nsm": 0.0}
    aside = np.eye(6)
    aside[:3, 3:] = -skew(np.array([0.0, m1, m2]))
    T = np.kron(np.eye(2), aside)
    for i in range(count):
        at = np.ix_(*2 * [np.arange(6 * i, 6 * i + 12)])
        k, m = local_matrices(own, 1.0 / count, "coupled")
        _, beside = local_matrices(own | {"A": 0.0, "nsm": nsm}, 1.0 / count, "coupled")
        K[at] += k
        M[at] += m + T.T @ beside @ T
    return 1.0 / np.sqrt(scipy.linalg.eigh(M[6:, 6:], K[6:, 6:], eigvals_only=True)[::-1][:4])


def test_coupled_mass_on_two_lines_tends_to_that_of_two_bars(tmp_path):
    """Turns carry the mass beside the axis by the slope of the beam there, not by those of its ends."""
    off = []
    for count in (4, 8, 16):
        grids = "".join(f"GRID,{i + 1},,{i / count}\n" for i in range(count + 1))
        beams = "".join(f"CBEAM,{i + 1},7,{i + 1},{i + 2},0.,1.,0.\n" for i in range(count))
        text = (
            f"CEND\nBEGIN BULK\n{grids}{beams}MAT1,3,7.+10,,.3,2700.\n"
            "PBEAM,7,3,3.-4,4.-8,6.-8,,9.-8,.5\n,,,,,,,,\n,0.,0.\n,.02\nENDDATA\n"
        )
        structure, _ = article(tmp_path, text, "coupled")
        K, M, _ = clamped_matrices(mesh_structure(structure))
        found = 1.0 / np.sqrt(scipy.linalg.eigh(M, K, eigvals_only=True)[::-1][:4])
        off.append(np.abs(found / two_lines(count, 0.5, 0.02, 0.0) - 1.0))
    np.testing.assert_array_less(off[0], [1e-5, 1e-5, 2e-4, 1e-4])
    np.testing.assert_array_less(off[1], 0.3 * off[0])
    np.testing.assert_array_less(off[2], 0.3 * off[1])
