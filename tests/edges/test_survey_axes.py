"""Universal files as others write them: coordinate systems, conjugate modes, per cent, rigid modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import DataError
from middeck.files.measured.modes import load_measured_modes
from middeck.structure.correlation.measured_modes import MeasuredModes

NODES = {3: (0.0, 0.0, 0.0), 1: (1.0, 0.0, 0.0), 2: (2.0, 0.5, 0.0)}
SHAPE = {2: (0.0, 1.0, 0.2), 1: (0.0, 0.5, 0.0), 3: (0.1, 0.0, 0.0)}
EYE = np.vstack([np.eye(3), np.zeros(3)])
TURNED = np.vstack([[[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.zeros(3)])
SHIFTED = np.vstack([np.eye(3), [0.0, 0.0, 1.0]])
ROOT = 2.0 * np.pi * 10.0 * complex(-0.01, np.sqrt(1.0 - 1e-4))


def block(number: int, *lines: str) -> str:
    return "\n".join([f"{-1:6d}", f"{number:6d}", *lines, f"{-1:6d}", ""])


def whole(*values: int) -> str:
    return "".join(f"{v:10d}" for v in values)


def reals(values: Sequence[float], width: int = 13) -> str:
    digits = width - 8
    return "".join(f"{v:{width}.{digits}E}" for v in values)


def units() -> str:
    return block(164, f"{1:10d}{'SI':<20}{2:10d}", reals((1, 1, 1), 25), reals((273.15,), 25))


def places(defined: int = 1, displaced: int = 1) -> str:
    rows = [(whole(n, defined, displaced, 11), reals(x, 25)) for n, x in NODES.items()]
    return block(2411, *(line for row in rows for line in row))


def system(label: int, kind: int, matrix: np.ndarray) -> str:
    return block(2420, whole(1), "part", whole(label, kind, 8), "cs", *(reals(row, 25) for row in matrix))


def mode(root: complex = ROOT, kind: int = 5, quantity: int = 8, phase: complex = 1.0) -> str:
    """A complex mode; of kind 2 its values are real."""
    rows = []
    for node, x in SHAPE.items():
        z = phase * np.array(x)
        flat = np.real(z) if kind == 2 else z.view(float)
        rows += [whole(node), reals(flat.tolist())]
    head = [whole(1, 3, 2, quantity, kind, 3), whole(2, 6, 0, 1), reals((root.real, root.imag, 0, 0, 0, 0))]
    return block(55, *["NONE"] * 5, *head, *rows)


def normal(hz: float, ratio: float, shape: Mapping[int, Sequence[float]] = SHAPE) -> str:
    rows = [line for node, x in shape.items() for line in (whole(node), reals(x))]
    head = [whole(1, 2, 2, 8, 2, 3), whole(2, 4, 0, 1), reals((hz, 1.0, ratio, 0.0))]
    return block(55, *["NONE"] * 5, *head, *rows)


def survey(tmp_path: Path, *blocks: str) -> MeasuredModes:
    path = tmp_path / "survey.unv"
    path.write_text("".join(blocks))
    return load_measured_modes(path)


def expected(measured: MeasuredModes) -> np.ndarray:
    return np.array(
        [SHAPE[int(n)]["xyz".index(d)] for n, d in zip(measured.node, measured.direction, strict=True)]
    )


@pytest.mark.parametrize("label", [1, 7])
def test_systems_that_are_the_global_one_are_read(tmp_path: Path, label: int) -> None:
    found = survey(tmp_path, units(), system(label, 0, EYE), places(label, label), normal(10.0, 0.01))
    assert found.warnings == ()
    np.testing.assert_allclose(found.shape[:, 0], expected(found), atol=1e-9)
    assert found.position_m is not None
    np.testing.assert_allclose(found.position_m, [NODES[int(n)] for n in found.node])


@pytest.mark.parametrize(
    ("systems", "defined", "displaced", "message"),
    [
        (
            system(4, 1, TURNED),
            1,
            4,
            "node 3 has displacement axes .* its axis runs through it",
        ),
        (system(4, 2, SHIFTED), 1, 4, "displacement axes .* runs through it"),
        (system(4, 3, EYE), 4, 1, "coordinate axes .* unknown kind"),
        (system(4, 0, 2.0 * TURNED), 1, 4, "displacement axes"),
        (system(4, 0, -EYE), 1, 4, "displacement axes"),
        (system(4, 0, 1e200 * EYE), 1, 4, "displacement axes"),
        ("", 6, 1, "not in data set 2420"),
    ],
)
def test_other_systems_are_refused(
    tmp_path: Path, systems: str, defined: int, displaced: int, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        survey(tmp_path, units(), systems, places(defined, displaced), normal(10.0, 0.01))


@pytest.mark.parametrize("apart", [0.0, 1e-15, -2e-7])
def test_a_node_at_the_origin_of_round_axes_but_for_rounding_is_refused(tmp_path: Path, apart: float) -> None:
    """What rounding leaves between two printed places has a direction, but it means nothing."""
    at = np.array(NODES[2]) * (1.0 + apart)
    systems = system(4, 1, np.vstack([EYE[:3], at]))
    with pytest.raises(DataError, match=r"node 2 has displacement axes .* its axis runs through it"):
        survey(tmp_path, units(), systems, places(1, 4), normal(10.0, 0.01))


def test_motions_along_turned_axes_are_turned(tmp_path: Path) -> None:
    """By hand: the own x of system 4 is the global y, its own y the global -x."""
    found = survey(tmp_path, units(), system(4, 0, TURNED), places(1, 4), normal(10.0, 0.01))
    by_hand = {"3": (0.0, 0.1, 0.0), "1": (-0.5, 0.0, 0.0), "2": (-1.0, 0.0, 0.2)}
    for node, way, value in zip(found.node, found.direction, found.shape[:, 0], strict=True):
        assert value == pytest.approx(by_hand[node]["xyz".index(way)], rel=1e-4)
    assert len(found.node) == sum(np.count_nonzero(x) for x in by_hand.values())
    # Own axes that are askew: a node that was measured along one of them is known along none of the file's.
    c, s = np.cos(0.3), np.sin(0.3)
    askew = system(4, 0, np.vstack([[[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]], np.zeros(3)]))
    with pytest.raises(DataError, match=r"node \d moves along \d of the three axes of its system"):
        survey(tmp_path, units(), askew, places(1, 4), normal(10.0, 0.01))


def test_motions_along_cylindrical_axes_are_turned(tmp_path: Path) -> None:
    """An axis along z through (0.5, -1, 3): directions are the ray from it to the node, and across."""
    rng, at = np.random.default_rng(2), np.array([0.5, -1.0])
    moves = {n: rng.uniform(0.1, 1.0, 3) for n in NODES}
    axis = np.vstack([TURNED[:3], [*at, 3.0]])
    shape = {n: x.tolist() for n, x in moves.items()}
    found = survey(tmp_path, units(), system(4, 1, axis), places(1, 4), normal(10.0, 0.01, shape))
    for node, way, value in zip(found.node, found.direction, found.shape[:, 0], strict=True):
        out = (np.array(NODES[int(node)][:2]) - at) / np.linalg.norm(np.array(NODES[int(node)][:2]) - at)
        radial, tangential, axial = moves[int(node)]
        x, y = radial * out + tangential * np.array([-out[1], out[0]])
        assert value == pytest.approx({"x": x, "y": y, "z": axial}[way], abs=1e-5)
    assert len(found.node) == 9


@pytest.mark.parametrize("number", [15, 2411])
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_places_and_motions_in_systems_of_their_own(tmp_path: Path, number: int, kind: int) -> None:
    """From the definition: a place by its own coordinates, a motion as how the place moves with them."""
    rng = np.random.default_rng(kind)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes *= np.linalg.det(axes)
    origin = rng.normal(size=3)

    def place(own: np.ndarray) -> np.ndarray:
        a, b, c = own
        b, c = (b, c) if kind == 0 else np.deg2rad([b, c]) if kind == 2 else (np.deg2rad(b), c)
        local = {
            0: [a, b, c],
            1: [a * np.cos(b), a * np.sin(b), c],
            2: [a * np.sin(b) * np.cos(c), a * np.sin(b) * np.sin(c), a * np.cos(b)],
        }[kind]
        return np.array(local) @ axes + origin

    owned = {n: np.round([rng.uniform(1, 3), rng.uniform(20, 160), rng.uniform(-170, 170)], 2) for n in NODES}
    moves = {n: rng.uniform(0.1, 1.0, 3) for n in NODES}
    rows = [(whole(n, 4, 4, 11), own.tolist()) for n, own in owned.items()]
    lines = [
        *(
            line
            for head, own in rows
            for line in ([head + reals(own)] if number == 15 else [head, reals(own, 25)])
        )
    ]
    shape = {n: x.tolist() for n, x in moves.items()}
    turned = system(4, kind, np.vstack([axes, origin]))
    found = survey(tmp_path, units(), turned, block(number, *lines), normal(10.0, 0.01, shape))
    assert any("system 4" in w for w in found.warnings) == (number == 2411)
    assert found.position_m is not None
    for row, (node, way) in enumerate(zip(found.node, found.direction, strict=True)):
        own = owned[int(node)]
        np.testing.assert_allclose(found.position_m[row], place(own), atol=1e-4)
        slopes = np.array([place(own + 1e-5 * e) - place(own - 1e-5 * e) for e in np.eye(3)])
        units_of = slopes / np.linalg.norm(slopes, axis=1)[:, None]
        moved = moves[int(node)] @ units_of
        assert found.shape[row, 0] == pytest.approx(moved["xyz".index(way)], abs=1e-5)
    assert len(found.node) == 9


def test_a_mode_and_its_conjugate_are_one(tmp_path: Path) -> None:
    phase = np.exp(0.7j)
    both = survey(
        tmp_path, units(), places(), mode(phase=phase), mode(ROOT.conjugate(), phase=np.conj(phase))
    )
    assert both.frequency_hz == pytest.approx([10.0], rel=1e-5)
    assert both.damping == pytest.approx([0.01], rel=1e-5)
    np.testing.assert_allclose(both.shape[:, 0], phase * expected(both), atol=1e-5)


@pytest.mark.parametrize("root", [ROOT, 1j * ROOT.imag])
def test_real_velocities_of_a_complex_mode_keep_their_shape(tmp_path: Path, root: complex) -> None:
    """Over an imaginary eigenvalue a real shape has no real part."""
    found = survey(tmp_path, units(), places(), mode(root, kind=2, quantity=11))
    np.testing.assert_allclose(found.shape[:, 0] * abs(ROOT), expected(found), rtol=1e-3)


def test_per_cent_and_rigid_modes_are_reported(tmp_path: Path) -> None:
    found = survey(tmp_path, units(), places(), normal(0.0, 0.0), normal(10.0, 1.5))
    assert found.frequency_hz.tolist() == [10.0]
    assert any("per cent" in w for w in found.warnings)
    assert any("1 modes at 0 Hz" in w for w in found.warnings)


def test_points_between_thousands_are_no_decimal_points(tmp_path: Path) -> None:
    path = tmp_path / "survey.csv"
    path.write_text("frequency [Hz];damping\n1.234;0,01\n")
    with pytest.raises(DataError, match=r"survey.csv:2: '1.234' beside decimal commas"):
        load_measured_modes(path)
    path.write_text("frequency [Hz];damping\n1234,5;0,8\n")
    found = load_measured_modes(path)
    assert found.frequency_hz.tolist() == [1234.5]
    assert any("per cent" in w for w in found.warnings)


def trace(*nodes: int, stated: int | None = None) -> str:
    return block(82, whole(1, len(nodes) if stated is None else stated, 8), "NONE", whole(*nodes))


def test_a_mode_without_a_node_that_others_have_is_reported(tmp_path: Path) -> None:
    lacking = {n: x for n, x in SHAPE.items() if n != 1}
    whole_survey = (units(), places(), trace(1, 2, 0, 2, 3), normal(10.0, 0.01))
    assert survey(tmp_path, *whole_survey, normal(20.0, 0.01)).warnings == ()
    found = survey(tmp_path, *whole_survey, normal(20.0, 0.01, lacking))
    assert found.warnings == (
        "the mode of 20 Hz leaves out 1 of 3 nodes: they are taken to stand still in it (is the file whole?)",
    )


def test_trace_lines_tell_of_lost_nodes(tmp_path: Path) -> None:
    found = survey(tmp_path, units(), places(), trace(1, 2, 3, 4), normal(10.0, 0.01))
    assert found.warnings == ("trace lines join nodes without coordinates (4): is the file whole?",)
    filled = survey(tmp_path, units(), places(), trace(1, 2, 3, 0, 0, stated=3), normal(10.0, 0.01))
    assert filled.warnings == ()
    with pytest.raises(DataError, match="3 of the 9 nodes of a trace line"):
        survey(tmp_path, units(), places(), trace(1, 2, 3, stated=9), normal(10.0, 0.01))


def test_a_node_at_two_places_in_two_data_sets_is_refused(tmp_path: Path) -> None:
    moved = block(15, whole(1, 1, 1, 11) + reals((1.0, 0.0, 0.2)))
    with pytest.raises(DataError, match="node 1 stands at two places"):
        survey(tmp_path, units(), places(), moved, normal(10.0, 0.01))
