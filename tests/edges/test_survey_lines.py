"""Trace lines and headers of universal files: read, kept, written and drawn. The files are written here."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from middeck.errors import DataError
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.structure.correlation.survey_drawing import build_survey_drawing
from middeck.structure.model.article import AttachPoint, Bushing
from structure_builders import TURNING_TUBE, body, member, structure
from structure_builders import node as node_at

HEAD = [
    "wing 3", "as delivered", "modal lab 7", "27-NOV-26 10:11:12          1         2         0",
    "NONE", "modal lab 7", "27-NOV-26 10:11:12",
]  # fmt: skip


def data_set(number: int, lines: list[str]) -> list[str]:
    return ["    -1", f"{number:6d}", *lines, "    -1"]


def whole(*numbers: int) -> str:
    return "".join(f"{n:10d}" for n in numbers)


def survey(path: Path, ids: list[int], trace: list[list[int]], z: np.ndarray) -> Path:
    """Nodes 1 m apart on x in millimetres; ``z`` [node, mode] is what their modes move [m]."""
    lines = data_set(151, HEAD)
    lines += data_set(164, [f"{5:10d}{'mm':<20}{2:10d}", "".join(f"{x:25.17E}" for x in (1e3, 1.0, 1.0))])
    nodes = [
        t
        for k, i in enumerate(ids)
        for t in (whole(i, 1, 1, 11), "".join(f"{x:25.16E}" for x in (1e3 * k, 0.0, 0.0)))
    ]
    lines += data_set(2411, nodes)
    for k, path_of in enumerate(trace, 1):
        rows = [whole(*path_of[i : i + 8]) for i in range(0, len(path_of), 8)]
        lines += data_set(82, [whole(k, len(path_of), 7), f"line {k}", *rows])
    for mode in range(z.shape[1]):
        shape = [
            t
            for i, v in zip(ids, z[:, mode], strict=True)
            for t in (whole(i), "".join(f"{x:13.5E}" for x in (0.0, 0.0, 1e3 * v)))
        ]
        reported = [whole(1, 2, 2, 8, 2, 3), whole(2, 4, 1, mode + 1)]
        lines += data_set(
            55,
            [
                *["NONE"] * 5,
                *reported,
                "".join(f"{x:13.5E}" for x in (2.0 + 3.0 * mode, 1.0, 0.01, 0.0)),
                *shape,
            ],
        )
    path.write_text("\r\n".join([*lines, ""]), newline="")
    return path


IDS = [*range(10, 21)]
# A line of ten nodes (two rows of eight), the pen lifted, then one with a node (99) that is not in the model.
COARSE = ("--set", "mesh.elements_per_strut=2")
TRACE = [[*IDS[:9], 0, IDS[9], IDS[10]], [IDS[0], 99, IDS[2], IDS[3]]]
Z = np.column_stack([np.linspace(0.0, 1.0, 11) ** 2, np.linspace(0.0, 1.0, 11) ** 2 - 0.3])
Z[0] = 0.0  # a foot: it has no channel, but a line ends on it


def beam_modes() -> md.Modes:
    nodes = [
        node_at(f"n{i}", (float(k), 0.0, 0.0), body(0.1, inertia=(1e-4, 1e-4, 1e-4)))
        for k, i in enumerate(IDS)
    ]
    members = [member(f"n{i}", f"n{i + 1}", TURNING_TUBE, 1) for i in IDS[:-1]]
    return md.solve_modes(md.solve_equilibrium(structure(nodes, members), md.Environment.orbit()))


def test_trace_lines_and_header_are_read_kept_and_written(tmp_path: Path) -> None:
    found = md.load_measured_modes(survey(tmp_path / "a.unv", IDS, TRACE, Z))
    assert found.source == "wing 3; as delivered; modal lab 7; 27-NOV-26 10:11:12"
    message = (
        tuple(map(str, IDS[:9])),
        tuple(map(str, IDS[9:])),
        tuple(map(str, (IDS[0], 99, IDS[2], IDS[3]))),
    )
    assert found.lines == message
    md.files.write_measured_modes(tmp_path / "a.json", found)
    again = md.load_measured_modes(tmp_path / "a.json")
    assert (again.lines, again.source) == (found.lines, found.source)
    # Out: a line ends where a node has no channel, and the header keeps the source over two rounds.
    written = found
    for name in ("b.unv", "c.unv"):
        md.files.write_measured_modes(tmp_path / name, written)
        written = md.load_measured_modes(tmp_path / name)
        assert written.source == found.source
        assert written.lines == (message[0][1:], message[1], message[2][2:])


def test_lines_are_written_in_sets_of_250_entries(tmp_path: Path) -> None:
    """600 nodes in one line: whatever the cuts, the same neighbours are joined."""
    ids = [*range(1, 601)]
    found = md.load_measured_modes(survey(tmp_path / "a.unv", ids, [ids], np.ones((600, 1))))
    md.files.write_measured_modes(tmp_path / "b.unv", found)
    text = (tmp_path / "b.unv").read_text().splitlines()
    counts = [int(text[k + 1][10:20]) for k, line in enumerate(text) if line == "    82"]
    assert len(counts) == 3
    assert max(counts) <= 250
    again = md.load_measured_modes(tmp_path / "b.unv").lines
    joined = [pair for line in again for pair in pairwise(line)]
    assert joined == [(str(i), str(i + 1)) for i in ids[:-1]]


def test_a_survey_is_drawn_along_its_lines(tmp_path: Path) -> None:
    modes = beam_modes()
    found = md.load_measured_modes(survey(tmp_path / "a.unv", IDS, TRACE, Z))
    drawing = build_survey_drawing(modes, found)
    drawn = [(line.last - line.first) for line in drawing.lines]
    assert drawn == [9, 2, 2]  # the piece between the foot and 99 is a single node
    for line, ids in zip(drawing.lines, (IDS[:9], IDS[9:], IDS[2:4]), strict=True):
        at = np.array([ids]).T - IDS[0]
        np.testing.assert_allclose(drawing.drawn[line.first : line.last], at * [1.0, 0.0, 0.0], atol=1e-12)
        motion = drawing.motion[:, line.first : line.last]
        np.testing.assert_allclose(motion[..., 2], Z[at[:, 0]].T, atol=2e-5)
        assert not motion[..., :2].any()
    # Without lines of its own, along the members between measured nodes; complex shapes in their own phase.
    turned = replace(found, lines=(), shape=found.shape * np.exp(0.7j))
    plain = build_survey_drawing(modes, turned)
    assert len(plain.lines) == 9
    last = plain.motion[:, plain.lines[-1].last - 1, 2]
    np.testing.assert_allclose(np.abs(last), np.abs(Z[-1]), rtol=1e-4)


@pytest.mark.parametrize(
    ("key", "value"), [("lines", "n1"), ("lines", [["n1", 2]]), ("lines", ["n1"]), ("source", 3)]
)
def test_lines_and_source_of_a_document_are_checked(tmp_path: Path, key: str, value: object) -> None:
    found = md.load_measured_modes(survey(tmp_path / "a.unv", IDS, TRACE, Z))
    md.files.write_measured_modes(tmp_path / "a.json", found)
    document = json.loads((tmp_path / "a.json").read_text())
    (tmp_path / "a.json").write_text(json.dumps(document | {key: value}))
    with pytest.raises(DataError, match=key):
        md.load_measured_modes(tmp_path / "a.json")


def test_correlate_shows_the_test_beside_the_model(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The example's survey without trace lines, and as a universal file with a header and members."""
    page = tmp_path / "page.html"
    root = ROOT / "data" / "virtual-survey" / "mace-simple-lab.json"
    article = ROOT / "articles" / "mace-simple.toml"
    ended = middeck(capfd, "correlate", article, root, "--runs", 20, *COARSE, "--figure", page, "--json")
    document = json.loads(ended.out)
    data = json.loads(page.read_text().split('id="data">')[1].split("</script>")[0])
    assert [side["label"] for side in data["sides"]] == ["test", "model"]
    assert len(data["rows"]) == len(document["name"]) + len(document["unpaired_test_index"])
    for row, hz in zip(data["rows"], document["measured_hz"], strict=False):
        assert row[0]["hz"] == pytest.approx(hz, rel=1e-4)
    assert len(data["sides"][0]["lines"]) == 4  # the four struts between five nodes
    assert document["test_source"] == ""


def plane(places: dict[str, tuple[float, float]], ends: list[str]) -> md.Modes:
    """Nodes in a plane, each of one letter, and the members between them."""
    light = body(0.1, inertia=(1e-4, 1e-4, 1e-4))
    nodes = [node_at(name, (x, 0.0, z), light) for name, (x, z) in places.items()]
    members = [member(*two, TURNING_TUBE, 2) for two in ends]
    return md.solve_modes(md.solve_equilibrium(structure(nodes, members), md.Environment.orbit()))


def drawn_along(
    modes: md.Modes, moves: dict[str, float]
) -> dict[frozenset[tuple[float, float]], list[float]]:
    """The lines of a survey of y at some nodes, by the places that each joins, and how their points move."""
    test = MeasuredModes(
        frequency_hz=[1.0],
        damping=[0.01],
        node=tuple(moves),
        direction=("y",) * len(moves),
        shape=np.array([list(moves.values())]).T,
    )
    drawing = build_survey_drawing(modes, test)
    assert [mark.name for mark in drawing.marks] == list(moves)
    found = {}
    for line in drawing.lines:
        points = range(line.first, line.last)
        places = [tuple(drawing.drawn[k, ::2].tolist()) for k in points]
        order = sorted(points, key=lambda k: tuple(drawing.drawn[k].tolist()))
        found[frozenset(places)] = [float(drawing.motion[0, k, 1]) for k in order]
    return found


def test_measured_points_are_joined_along_the_members_between_them() -> None:
    """Two of five nodes on a beam: what lies between moves evenly, the rest of the beam is not drawn."""
    places = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (1.5, 0.0), "d": (3.0, 0.0), "e": (4.0, 0.0)}
    lines = drawn_along(plane(places, ["ab", "bc", "cd", "de"]), {"a": 1.0, "d": 4.0})
    expected = {("a", "b"): [1.0, 2.0], ("b", "c"): [2.0, 2.5], ("c", "d"): [2.5, 4.0]}
    assert lines == {
        frozenset(places[n] for n in ends): pytest.approx(z, abs=1e-12) for ends, z in expected.items()
    }
    assert lines.keys() == {frozenset((places[a], places[b])) for a, b in ("ab", "bc", "cd")}


def test_a_measured_mesh_node_bends_its_member() -> None:
    places = {"a": (0.0, 0.0), "b": (2.0, 0.0)}
    lines = drawn_along(plane(places, ["ab"]), {"a": 0.0, "a-b/1": 1.0, "b": 0.0})
    assert lines == {frozenset([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)]): pytest.approx([0.0, 1.0, 0.0])}


def test_a_ring_stays_closed_and_a_hub_is_the_mean_of_its_arms() -> None:
    """Arms of lengths 1, 1 and 2 to a hub that was not measured, and a boom beyond that hangs on it alone."""
    ring = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (1.0, 1.0), "d": (0.0, 1.0)}
    assert len(drawn_along(plane(ring, ["ab", "bc", "cd", "da"]), {"a": 0.0, "b": 1.0, "d": 1.0})) == 4
    star = {"h": (0.0, 0.0), "a": (1.0, 0.0), "b": (-1.0, 0.0), "c": (0.0, 2.0), "d": (0.0, -1.0)}
    lines = drawn_along(plane(star, ["ha", "hb", "hc", "hd"]), {"a": 1.0, "b": 0.0, "c": 4.0})
    hub = (1.0 * 1.0 + 1.0 * 0.0 + 0.5 * 4.0) / 2.5
    assert lines[frozenset((star["h"], star["a"]))] == pytest.approx([hub, 1.0])
    assert lines[frozenset((star["h"], star["b"]))] == pytest.approx([0.0, hub])
    assert frozenset((star["h"], star["d"])) not in lines
    # With one measured node nothing is joined: it is a mark.
    assert drawn_along(plane(star, ["ha", "hb", "hc", "hd"]), {"a": 1.0}) == {}


def test_a_bushing_joins_what_is_measured_on_both_its_sides() -> None:
    """A boom on an isolator, of which its tip was measured: it is drawn, not left afloat."""
    light, places = body(0.1, inertia=(1e-4, 1e-4, 1e-4)), {"a": 0.0, "b": 1.0, "c": 1.0, "d": 2.0}
    parts = structure(
        [node_at(name, (x, 0.0, 0.0), light) for name, x in places.items()],
        [member(*two, TURNING_TUBE, 2) for two in ("ab", "cd")],
        attach=[AttachPoint(name, name, np.zeros(3)) for name in "bc"],
    )
    isolator = Bushing(name="isolator", start="b", end="c", stiffness=np.diag([1e4] * 3 + [10.0] * 3))
    parts = replace(parts, bushings=(isolator,))
    modes = md.solve_modes(md.solve_equilibrium(parts, md.Environment.orbit()))
    lines = drawn_along(modes, {"a": 0.0, "d": 2.0})
    assert lines[frozenset([(0.0, 0.0), (1.0, 0.0)])] == pytest.approx([0.0, 1.0], abs=1e-5)
    assert lines[frozenset([(1.0, 0.0), (2.0, 0.0)])] == pytest.approx([1.0, 2.0], abs=1e-5)
