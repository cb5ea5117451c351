"""Surveys written here by the columns of the published data sets: units, large numbers, complex modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from middeck.errors import DataError
from middeck.structure.correlation.measured_modes import AXES, MeasuredModes
from middeck.structure.model.environment import Environment
from repeats import repeats
from structure_builders import TUBE, body, member, structure
from structure_builders import node as node_at

# Units of length in a metre with their codes, as programs print them.
UNITS = ((1.0, 1), (1e3, 5), (39.3701, 7), (1e2, 6), (3.28084, 2), (12.345, 9), (None, None))
DERIVATIVE = {8: 0, 0: 0, 11: 1, 12: 2}
SETS = ((2411, 55), (15, 55), (2411, 2414), (15, 2414))


class Survey:
    """Modes of nodes at places, drawn by lot, and its text; nothing here uses middeck."""

    def __init__(self, seed: int, *, axes: int = 1) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.complex, self.width = bool(seed % 2), 3 * int(rng.integers(1, 3))
        self.nodes, self.shapes = SETS[seed % 4]
        self.scale, code = UNITS[seed % len(UNITS)]
        self.quantity, self.axes = int(rng.choice(list(DERIVATIVE))), axes
        self.numbers = sorted(int(n) + 1 for n in rng.choice((20, 99_999, 10**9)[seed % 3], 5, replace=False))
        self.places = rng.uniform(-2.0, 2.0, (5, 3))
        self.hz, self.ratio = np.sort(rng.uniform(1.0, 80.0, 4)), rng.uniform(0.001, 0.05, 4)
        self.motion = rng.standard_normal((4, 5, self.width)) + 1j * self.complex * rng.standard_normal(
            (4, 5, self.width)
        )
        self.lines: list[str] = []
        self.put(151, ["model", "", "program", "27-NOV-26", "", "", ""])
        if code is not None:
            factors = "".join(f"{x:25.17E}" for x in (self.scale, 1.0, 1.0)).replace("E", "D")
            self.put(164, [f"{code:10d}{'of the test':<20}{2:10d}", factors, f"{273.15:25.17E}"])
        self.put(self.nodes, [line for k in range(5) for line in self.node(k)])
        self.put(82, [whole(1, 3, 7), "trace", whole(*self.numbers[:3])])
        for mode in rng.permutation(4):
            self.put(self.shapes, self.shape(int(mode)))

    def put(self, number: int, lines: list[str]) -> None:
        self.lines += ["    -1", f"{number:6d}", *lines, "    -1"]

    def node(self, k: int) -> list[str]:
        head, at = whole(self.numbers[k], self.axes, self.axes, 11), self.places[k] * (self.scale or 1.0)
        if self.nodes == 15:
            return [head + "".join(f"{x:13.5E}" for x in at)]
        return [head, "".join(f"{x:25.16E}" for x in at).replace("E", "D")]

    def shape(self, m: int) -> list[str]:
        omega = 2.0 * np.pi * self.hz[m]
        root = omega * (-self.ratio[m] + 1j * np.sqrt(1.0 - self.ratio[m] ** 2))
        lengths = np.array([self.scale or 1.0] * 3 + [1.0] * 3)[: self.width]
        values = self.motion[m] * lengths * (root if self.complex else omega) ** DERIVATIVE[self.quantity]
        kinds = (1, 3, 5) if self.complex else (1, 2, 2)
        reported = whole(*kinds[:2], self.width // 3 + 1, self.quantity, kinds[2], self.width)
        both = [root.real, root.imag] if self.complex else [0.0, 0.0]
        if self.shapes == 55:
            own = [*both, 1.0, 0.0, 0.0, 0.0] if self.complex else [self.hz[m], 1.0, self.ratio[m], 0.0]
            head = [*["NONE"] * 5, reported, whole(2, len(own), 1, m + 1), *reals(own)]
        else:
            head = [
                whole(m + 1),
                "mode",
                whole(1),
                *["NONE"] * 5,
                reported,
                whole(0, 0, 0, 0, 1, m + 1, 0, 0),
            ]
            head += [whole(0, 0), *reals([0.0, self.hz[m], omega**2, 1.0, self.ratio[m], 0.0])]
            head += reals([*both, 0.0, 0.0, 0.0, 0.0])
        for k in self.rng.permutation(5):
            row = values[k].view(float) if self.complex else values[k].real
            head += [whole(self.numbers[k]), *reals(list(row))]
        return head


def whole(*numbers: int) -> str:
    return "".join(f"{n:10d}" for n in numbers)


def reals(values: list[float]) -> list[str]:
    return ["".join(f"{x:13.5E}" for x in values[k : k + 6]) for k in range(0, len(values), 6)]


def compare(found: MeasuredModes, truth: Survey) -> None:
    six = 2e-5  # two roundings to six digits, of shapes over the largest
    order = np.argsort(found.frequency_hz)
    np.testing.assert_allclose(found.frequency_hz[order], truth.hz, rtol=six)
    np.testing.assert_allclose(found.damping[order], truth.ratio, rtol=six)
    assert len(found.node) == 5 * truth.width
    assert found.position_m is not None
    size = np.abs(truth.motion).max()
    for node, way, row, place in zip(
        found.node, found.direction, found.shape[:, order], found.position_m, strict=True
    ):
        k = truth.numbers.index(int(node))
        np.testing.assert_allclose(row / size, truth.motion[:, k, AXES.index(way)] / size, atol=six)
        np.testing.assert_allclose(place, truth.places[k], atol=2.0 * six)


@pytest.mark.parametrize("seed", repeats(range(28), 7))
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_survey_comes_in_and_goes_out(seed: int, end: str, tmp_path: Path) -> None:
    truth, path = Survey(seed), tmp_path / "a.unv"
    path.write_text(end.join([*truth.lines, ""]), newline="")
    found = md.load_measured_modes(path)
    compare(found, truth)
    assert any("lengths are taken as metres" in warning for warning in found.warnings) == (
        truth.scale is None
    )
    for sets in SETS:
        md.files.write_measured_modes(tmp_path / "b.unv", found, sets=sets)
        compare(md.load_measured_modes(tmp_path / "b.unv"), truth)


@pytest.mark.parametrize("axes", [np.eye(3)[[1, 2, 0]], np.eye(3)])
def test_places_and_motions_are_turned_into_global_axes(tmp_path: Path, axes: np.ndarray) -> None:
    truth, path = Survey(0, axes=7), tmp_path / "a.unv"
    rows = ["".join(f"{x:25.16E}" for x in row) for row in [*axes, np.zeros(3)]]
    truth.put(2420, [whole(1), "part", whole(7, 0, 8), "CS7", *rows])
    path.write_text("\n".join([*truth.lines, ""]))
    truth.places = truth.places @ axes
    truth.motion = (truth.motion.reshape(4, 5, -1, 3) @ axes).reshape(4, 5, -1)
    compare(md.load_measured_modes(path), truth)


def test_nodes_keep_their_numbers_beside_nodes_without_one(tmp_path: Path) -> None:
    names = ("g3", "bus", "g19", "p7", "q7", "g1")
    modes = MeasuredModes(
        frequency_hz=np.array([2.0]),
        damping=np.array([0.01]),
        node=names,
        direction=("x",) * 6,
        shape=np.ones((6, 1)),
        position_m=np.arange(18.0).reshape(6, 3),
    )
    md.files.write_measured_modes(tmp_path / "a.unv", modes)
    found = md.load_measured_modes(tmp_path / "a.unv")
    assert found.position_m is not None
    at = [names[int(x / 3.0)] for x in found.position_m[:, 0]]
    number = {name: int(n) for name, n in zip(at, found.node, strict=True)}
    assert number == {"g3": 3, "g19": 19, "g1": 1, "bus": 20, "p7": 21, "q7": 22}


@pytest.mark.parametrize("sets", SETS)
def test_the_modal_mass_is_that_of_the_shape(tmp_path: Path, sets: tuple[int, int]) -> None:
    """Two bodies on a spring without mass: the sum of m v^2 and J w^2 of the shape in the file."""
    masses, turns = (2.0, 0.5), ((0.3, 0.2, 0.1), (0.02, 0.03, 0.04))
    bodies = [body(m, inertia=j) for m, j in zip(masses, turns, strict=True)]
    light = replace(TUBE, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
    nodes = [node_at(f"n{k + 1}", (0.7 * k, 0.0, 0.0), one) for k, one in enumerate(bodies)]
    modes = md.solve_modes(
        md.solve_equilibrium(structure(nodes, [member("n1", "n2", light, 1)]), Environment.orbit())
    )
    at = [(one.name, way) for one in nodes for way in AXES]
    path = tmp_path / "a.unv"
    md.files.write_measured_modes(path, md.structure.measure_modes(modes, at), sets=sets)
    found = md.load_measured_modes(path)
    inertia = {("1", "2")[k]: [masses[k]] * 3 + list(turns[k]) for k in (0, 1)}
    own = np.array([inertia[n][AXES.index(way)] for n, way in zip(found.node, found.direction, strict=True)])
    rows = [block.splitlines() for block in path.read_text().split(f"    -1\n{sets[1]:6d}\n")[1:]]
    assert len(rows) == found.shape.shape[1] == 6
    stated = [float(row[7].split()[1] if sets[1] == 55 else row[11].split()[3]) for row in rows]
    np.testing.assert_allclose(stated, own @ np.abs(found.shape) ** 2, rtol=2e-5)


def test_a_modal_mass_comes_back_from_json_and_is_positive(tmp_path: Path) -> None:
    one, shape = np.array([1.0]), np.ones((1, 1))
    truth = MeasuredModes(
        frequency_hz=one, damping=0.01 * one, node=("a",), direction=("x",), shape=shape, modal_mass=2.5 * one
    )
    md.files.write_measured_modes(tmp_path / "a.json", truth)
    assert md.load_measured_modes(tmp_path / "a.json").modal_mass == [2.5]
    with pytest.raises(DataError, match="a modal mass of -1"):
        replace(truth, modal_mass=np.array([-1.0]))
