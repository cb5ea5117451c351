"""Names of modes of articles that are not one beam, against the motion of their cross-sections."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import middeck as md
from middeck.structure.eigenproblem.repeated import repeated
from middeck.structure.model.article import Section, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.modes.motions.equivalent_beam import beam_motion, on_one_line
from middeck.structure.modes.motions.strained_parts import member_parts, strained_parts
from middeck.structure.modes.names.kinds import find_kinds
from middeck.structure.modes.names.naming import name_modes
from repeats import repeats
from structure_builders import TUBE, TURNING_TUBE, body, member, node, straight_beam, structure
from trusses import bar, rod_mast, truss


def solved(article: Structure, clamped: bool = False, count: int = 16) -> md.Modes:
    nodes = [n.name for n in article.nodes[:4]] if clamped else []
    where = md.Environment.clamped(*nodes, gravity=0.0) if clamped else md.Environment.orbit()
    return md.solve_modes(md.solve_equilibrium(article, where), count)


def character(article: Structure, modes: md.Modes, m: int) -> tuple[dict[str, float], float]:
    """Truth: the four nodes of each station moved as one body, by least squares, station by station."""
    x = np.array([n.position for n in article.nodes]).reshape(-1, 4, 3)
    u = modes.shapes[: 6 * len(article.nodes), m].reshape(-1, 4, 6)[:, :, :3]
    share, fitted = dict.fromkeys(("axial", "torsion", "bending x-y", "bending x-z"), 0.0), 0.0
    for r, moved in zip(x - x.mean(axis=1, keepdims=True), u, strict=True):
        turns = np.stack([np.cross(a, r) for a in np.eye(3)], axis=2)
        B = np.concatenate([np.tile(np.eye(3), (4, 1, 1)), turns], axis=2).reshape(12, 6)
        c = np.linalg.lstsq(B, moved.ravel(), rcond=None)[0]
        parts = [np.sum((B[:, i] * c[i]) ** 2) for i in range(6)]  # orthogonal: the section is symmetric
        fitted += sum(parts)
        for name, own in (("axial", [0]), ("torsion", [3]), ("bending x-y", [1, 5]), ("bending x-z", [2, 4])):
            share[name] += sum(parts[i] for i in own)
    return {name: s / fitted for name, s in share.items()}, fitted / float(np.sum(u**2))


@pytest.mark.parametrize("seed", repeats(range(60), 3))
def test_a_truss_is_named_by_the_motion_of_its_sections(seed: int) -> None:
    """Wherever the sections move clearly in one way the name says which."""
    rng = np.random.default_rng([9, seed])
    depth = float(rng.uniform(0.3, 0.6))
    width = depth * float(rng.uniform(0.7, 1.4))
    article = truss(int(rng.integers(7, 12)), float(rng.uniform(0.45, 0.7)), width, depth, rng)
    modes = solved(article, clamped=bool(seed % 2))
    clear = 0
    for m in (m for m, kind in enumerate(modes.kind) if kind == "flexible"):
        share, fit = character(article, modes, m)
        best = max(share, key=lambda name: share[name])
        others = max(s for name, s in share.items() if name != best)
        if fit > 0.75 and others < 0.5 * share[best]:
            assert modes.name[m].partition(" ")[2] == best, (m, modes.name[m], share, fit)
            clear += 1
        elif fit < 0.45:
            assert modes.name[m].startswith(("local: ", "first overall ", "second overall ")), modes.name[m]
    assert clear >= 3


@pytest.mark.parametrize("length", [0.5, 1.0])  # the first is the 72-bar truss: twice as long as wide
def test_a_mast_of_rods_is_named_by_the_motion_of_its_sections(length: float) -> None:
    """Its members work axially in every mode: their strain says nothing of the whole."""
    article = rod_mast(4, length, 1.0)
    held = tuple(Clamp(node=n.name, along="xyz" if n.name[0] == "0" else "") for n in article.nodes)
    supports = md.Environment(title="rods turn no node", gravity=np.zeros(3), clamps=held)
    modes = md.solve_modes(md.solve_equilibrium(article, supports))
    named: list[str] = []
    for m, name in enumerate(modes.name):
        share, fit = character(article, modes, m)
        best = max(share, key=lambda word: share[word])
        if fit > 0.95 and share[best] > 0.95:
            assert name.partition(" ")[2] == best
            named.append(name)
    firsts = {"first bending x-y", "first bending x-z", "first torsion", "first axial"}
    assert firsts | {"second bending x-y", "second bending x-z"} <= set(named)


@pytest.fixture(scope="module")
def square() -> Structure:
    """The same from all four sides: bending has pairs of equal frequency."""
    return truss(8, 0.5, 0.5, 0.5, np.random.default_rng(4))


@pytest.fixture(scope="module")
def oblong() -> Structure:
    return truss(8, 0.5, 0.4, 0.6, np.random.default_rng(5))


def test_of_a_pair_of_equal_frequency_each_bends_in_one_plane(square):
    """Any basis of the pair is a solution: the one is taken that the planes of the article give."""
    modes = solved(square)
    pair = [m for m, name in enumerate(modes.name) if name in ("first bending x-y", "first bending x-z")]
    assert len(pair) == 2
    assert modes.omega[pair[0]] == modes.omega[pair[1]]
    for m in pair:
        share, _ = character(square, modes, m)
        other = share["bending x-y"] + share["bending x-z"] - share[modes.name[m].removeprefix("first ")]
        assert other < 0.01 * share[modes.name[m].removeprefix("first ")]


@pytest.mark.parametrize("held", [False, True])
def test_the_basis_of_a_pair_does_not_hang_on_the_solver(square, held):
    modes = solved(square, clamped=held)
    rest, M, lam = modes.equilibrium, modes.mass, modes.omega**2
    turned, rng = modes.shapes.copy(), np.random.default_rng(3)
    rigid = modes.kind.count("rigid")
    clusters = [c for c in repeated(lam) if c[0] >= rigid]
    assert clusters
    for c in clusters:
        turned[:, c] = turned[:, c] @ np.linalg.qr(rng.standard_normal((len(c), len(c))))[0]
    again = find_kinds(rest, M, lam, turned, rigid)
    names = name_modes(rest, M, again.lam, again.shapes, again.kind, modes.name[:rigid])
    assert names == modes.name
    parts, strain = strained_parts(rest, again.shapes), strained_parts(rest, modes.shapes)
    np.testing.assert_allclose(parts[1], strain[1], atol=1e-6)


def test_a_round_beam_bends_in_one_plane_a_mode():
    modes = solved(straight_beam(TUBE, 2.0, 6))
    assert {"first bending x-y", "first bending x-z", "second bending x-z"} <= set(modes.name)


def test_names_do_not_depend_on_units_or_order(oblong):
    names = solved(oblong).name
    shuffled = dataclasses.replace(oblong, members=oblong.members[::-1])
    assert solved(shuffled).name == names
    millimetres = dataclasses.replace(
        oblong,
        nodes=tuple(dataclasses.replace(n, position=1e3 * n.position) for n in oblong.nodes),
        members=tuple(dataclasses.replace(m, section=_in_mm(m.section)) for m in oblong.members),
    )
    assert solved(millimetres).name == names


def _in_mm(section: Section) -> Section:
    """Lengths in mm and forces in mN: the same frequencies."""
    by = {"EA": 1e3, "GJ": 1e9, "EI_y": 1e9, "EI_z": 1e9, "rho_A": 1e-3}
    return dataclasses.replace(section, **{k: factor * getattr(section, k) for k, factor in by.items()})


def test_letters_follow_the_axes(oblong):
    """With x, y, z turned into y, z, x every name has the letters of its new plane."""
    turned = dataclasses.replace(
        oblong,
        nodes=tuple(dataclasses.replace(n, position=np.roll(n.position, 1)) for n in oblong.nodes),
        members=tuple(dataclasses.replace(m, up=np.roll(m.up, 1)) for m in oblong.members),
    )
    planes = {"x-y": "y-z", "x-z": "x-y", "y-z": "x-z"}
    for old, new in zip(solved(oblong).name, solved(turned).name, strict=True):
        head, _, plane = old.rpartition(" ")
        if plane in planes and " bending" in old and not old.startswith("local"):
            assert new == f"{head} {planes[plane]}"


def test_an_axis_between_the_letters_is_named_by_what_has_one(oblong):
    c = np.sqrt(0.5)
    R = np.array([[c, -c, 0.0], [c, c, 0.0], [0.0, 0.0, 1.0]])
    turned = dataclasses.replace(
        oblong,
        nodes=tuple(dataclasses.replace(n, position=R @ n.position) for n in oblong.nodes),
        members=tuple(dataclasses.replace(m, up=R @ m.up) for m in oblong.members),
    )
    names = solved(turned).name
    assert {"first bending x-y", "first bending along z"} <= set(names)
    across = np.linalg.qr(np.column_stack([np.ones(3), [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]))[0]
    R = across * np.sign(np.linalg.det(across))
    skewed = dataclasses.replace(
        oblong,
        nodes=tuple(dataclasses.replace(n, position=R @ n.position) for n in oblong.nodes),
        members=tuple(dataclasses.replace(m, up=R @ m.up) for m in oblong.members),
    )
    assert "first bending" in solved(skewed).name


def test_a_beam_keeps_the_names_of_its_strain():
    beam = straight_beam(TUBE, 2.0, 6)
    modes = solved(beam, count=12)
    assert on_one_line(modes.equilibrium)
    assert "first bending x-y and bending x-z" not in modes.name
    assert {"first bending x-y", "first bending x-z"} <= set(modes.name)


def test_parts_are_name_stems_or_straight_lines():
    numbered = truss(2, 1.0, 1.0, 1.0, np.random.default_rng(0))
    assert set(member_parts(numbered)) == {"batten", "longeron", "diagonal"}
    bare = dataclasses.replace(
        numbered,
        members=tuple(dataclasses.replace(m, name=f"bar{i}") for i, m in enumerate(numbered.members)),
    )
    parts = member_parts(bare)
    lines = [[i for i, own in enumerate(parts) if own == part] for part in dict.fromkeys(parts)]
    longest = [line for line in lines if len(line) == 2]
    assert len(longest) == 4  # four longerons of two bays each; nothing else runs on
    assert all(numbered.members[i].name.startswith("longeron") for line in longest for i in line)


def test_parts_of_a_grid_do_not_hang_on_what_its_nodes_are_called() -> None:
    """Three lines of two members each way; numbers of the nodes are none of the members."""

    def parts(names: str, reverse: bool) -> set[frozenset[int]]:
        called = dict(zip(((i, j) for i in range(3) for j in range(3)), names.split(), strict=True))
        places = list(called)
        ends = [(a, b) for a in places for b in places if b in ((a[0] + 1, a[1]), (a[0], a[1] + 1))]
        ends = [end[::-1] if reverse and end[0] == (1, 1) else end for end in ends]
        grid = structure(
            [node(called[at], (0.5 * at[0], 0.0, 0.4 * at[1])) for at in places],
            [member(called[a], called[b], TUBE, 1) for a, b in ends],
        )
        found = member_parts(grid)
        return {frozenset(np.flatnonzero(np.array(found) == part).tolist()) for part in found}

    numbered = parts("g00 g01 g02 g10 g11 g12 g20 g21 g22", reverse=False)
    assert len(numbered) == 6
    assert numbered == parts("g00 g01 g02 g10 g11 g12 g20 g21 g22", reverse=True)
    assert numbered == parts("a b c d e f g h i", reverse=False)


def test_a_soft_appendage_is_local():
    """A boom across the end of a stiff truss moves alone, and is named with its deformation."""
    article = truss(8, 0.5, 0.5, 0.5, np.random.default_rng(6))
    soft = Section(EA=1e5, GJ=0.5, EI_y=0.5, EI_z=0.5, rho_A=0.2, rho_I_y=0.0, rho_I_z=0.0)
    tip = node("tip", (4.0, 1.75, 0.25), body(0.2))
    boom = dataclasses.replace(bar("boom", "82", "tip", soft, (1.0, 0.0, 0.0)), elements=4)
    grown = dataclasses.replace(article, nodes=(*article.nodes, tip), members=(*article.members, boom))
    modes = solved(grown, clamped=True, count=4)
    assert [name.partition(",")[0] for name in modes.name[:2]] == ["local: boom"] * 2
    parts, share = strained_parts(modes.equilibrium, modes.shapes)
    assert share[0, parts.index("boom")] > 0.9


def test_what_nods_on_a_still_truss_is_local(campaign):
    """Wherever the turning of one body has most of the kinetic energy, the name is of no beam."""
    seen = 0
    for seed in campaign(40):
        rng = np.random.default_rng([21, seed])
        article = truss(8, 0.5, 0.4, float(rng.uniform(0.3, 0.5)), rng)
        soft = Section(EA=1e6, GJ=0.3, EI_y=0.3, EI_z=0.3, rho_A=0.02, rho_I_y=0.0, rho_I_z=0.0)
        at, turn = int(rng.integers(2, 7)), float(10.0 ** rng.uniform(-3.0, -1.5))
        box = node("box", (0.5 * at + 0.02, 0.0, 0.0), body(0.02, (0, 0, 0), (turn, 1.3 * turn, 1.7 * turn)))
        arms = [bar(f"arm {c}", f"{at}{c}", "box", soft, (1.0, 0.2, 0.0)) for c in range(4)]
        members = (*article.members, *arms)
        bars = tuple(dataclasses.replace(m, name=f"bar{i}") for i, m in enumerate(members))
        grown = dataclasses.replace(article, nodes=(*article.nodes, box), members=bars)
        modes = solved(grown, count=20)
        frame = modes.equilibrium.model.frames.index("box")
        for m in (m for m, kind in enumerate(modes.kind) if kind == "flexible"):
            share = modes.shapes[6 * frame + 3 : 6 * frame + 6, m] ** 2 @ box.body.inertia.diagonal()
            if share > 0.8:
                assert modes.name[m].startswith("local: "), (seed, m, modes.name[m], share)
                seen += 1
    assert seen >= 2


@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0])
def test_bendings_are_counted_in_their_own_plane(degrees):
    """The same truss at any angle about its axis: each order twice, in planes across each other."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    R = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    article = truss(11, 0.6, 0.40, 0.43, np.random.default_rng(8))
    turned = dataclasses.replace(
        article,
        nodes=tuple(dataclasses.replace(n, position=R @ n.position) for n in article.nodes),
        members=tuple(dataclasses.replace(m, up=R @ m.up) for m in article.members),
    )
    bent = [name for name in solved(turned, count=16).name if " bending" in name and "local" not in name]
    assert [name.split()[0] for name in bent] == ["first", "first", "second", "second"]


def test_a_part_is_a_section_where_names_say_nothing():
    article = truss(3, 1.0, 1.0, 1.0, np.random.default_rng(0))
    pid = {"batten": 1, "longeron": 2, "diagonal": 3}
    deck = tuple(
        dataclasses.replace(m, name=f"bar{i}", section_name=f"pbar{pid[m.name.split()[0]]}")
        for i, m in enumerate(article.members)
    )
    assert set(member_parts(dataclasses.replace(article, members=deck))) == {"pbar1", "pbar2", "pbar3"}
    tapers = tuple(
        dataclasses.replace(m, section_name=f"{m.section_name}_1", stations=((1.0, m.section),)) for m in deck
    )
    assert set(member_parts(dataclasses.replace(article, members=tapers))) == {"pbar1", "pbar2", "pbar3"}
    one = tuple(dataclasses.replace(m, section_name="pbar1") for m in deck)
    alone = dataclasses.replace(one[0], name="rod7", section_name="prod2")
    assert "bar" not in member_parts(dataclasses.replace(article, members=(alone, *one[1:])))


def boom_on_a_box(corner: bool, length: float = 6.0, elements: int = 12) -> Structure:
    """A cube of stiff bars and 3 t, with a thin boom at the middle of a face or at a corner."""
    stiff = dataclasses.replace(TUBE, EA=1e3 * TUBE.EA, EI_y=1e4 * 100.0, EI_z=1e4 * 100.0, GJ=1e4 * TUBE.GJ)
    at = {
        f"c{i}{j}{k}": np.array([i - 1.0, j - 0.5, k - 0.5]) for i in (0, 1) for j in (0, 1) for k in (0, 1)
    }
    nodes = [node(name, tuple(x), body(375.0)) for name, x in at.items()]
    pairs = [(a, b) for a in at for b in at if a < b and np.abs(at[a] - at[b]).sum() <= 2.0]
    members = [member(a, b, stiff, 1, up=(0.1, 0.3, 0.9)) for a, b in pairs]
    root = "c111" if corner else "root"
    start = at[root] if corner else np.zeros(3)
    if not corner:
        nodes.append(node("root", (0.0, 0.0, 0.0), body(0.1)))
        members += [member("root", name, stiff, 1) for name in at if name[1] == "1"]
    for k in range(1, elements + 1):
        place = start + np.array([length * k / elements, 0.0, 0.0])
        nodes.append(node(f"b{k}", tuple(place), body(0.0)))
        members.append(member(root if k == 1 else f"b{k - 1}", f"b{k}", TUBE, 1))
    return structure(nodes, members)


@pytest.mark.parametrize("corner", [True, False])
def test_a_boom_on_a_heavy_box_bends(corner):
    """Each name twice, and its frequency that of the clamped beam of that number: 1.875, 4.694 ..."""
    modes = solved(boom_on_a_box(corner), count=14)
    found = [(hz, name) for hz, name, kind in zip(modes.frequency_hz, modes.name, modes.kind, strict=True)
             if kind == "flexible"][:8]  # fmt: skip
    across = ("bending x-y and bending x-z",) * 2 if corner else ("bending x-y", "bending x-z")
    expected = [f"{order} {words}" for order in ("first", "second", "third", "fourth") for words in across]
    assert [name for _, name in found] == expected
    beta = np.repeat([1.87510407, 4.69409113, 7.85475744, 10.99554073], 2) / 6.0
    exact = beta**2 * np.sqrt(TUBE.EI_y / TUBE.rho_A) / (2.0 * np.pi)
    # A box a thousand times as heavy gives way by some thousandths; elements and rotary inertia by as much.
    np.testing.assert_allclose([hz for hz, _ in found], exact, rtol=0.02)


def test_members_without_any_body_have_modes_and_names():
    """A bent line of members, slender as one beam: no body turns beside its sections."""
    places = [(0, 0, 0), (1.0, 0.2, 0), (2.1, 0.1, 0.2), (3.0, 0.3, 0.1)]
    nodes = [node(f"n{k}", at) for k, at in enumerate(places)]
    arms = [member(f"n{k}", f"n{k + 1}", TUBE, 2, up=(0.1, 0.2, 1)) for k in range(3)]
    modes = solved(structure(nodes, arms))
    assert np.sum(modes.omega < 1e-3 * modes.omega[6]) == 6
    assert "bending" in modes.name[6]


def boom_on_a_ring(turned: float) -> Structure:
    """A body with three struts to a ring, a mast and a tip beside its line; turned about x as a whole."""
    c, s = np.cos(turned), np.sin(turned)
    R = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    places = {
        "bus": (0.0, 0.0, 0.0),
        **{"a": (0.5, 0.2, 0.0), "b": (0.5, -0.12, 0.18), "c": (0.5, -0.12, -0.18)},
        **{"knee": (0.8, 0.02, 0.0), "mast": (1.6, 0.05, 0.0), "tip": (2.8, 0.0, 0.1)},
    }
    masses = {"bus": body(22.0, inertia=(0.9, 0.7, 0.8)), "tip": body(3.5, inertia=(0.03, 0.02, 0.02))}
    nodes = [node(n, R @ at, masses.get(n, body(0.4, inertia=(1e-3,) * 3))) for n, at in places.items()]
    ends = [
        "bus-a",
        "bus-b",
        "bus-c",
        "a-b",
        "b-c",
        "c-a",
        "a-knee",
        "b-knee",
        "c-knee",
        "knee-mast",
        "mast-tip",
    ]
    return structure(nodes, [member(*e.split("-"), TURNING_TUBE, 8, up=R[:, 1]) for e in ends])


@pytest.mark.parametrize("degrees", [3.0, 9.4, 20.0])
def test_shares_of_a_beams_motion_turn_with_the_article(degrees: float) -> None:
    """Few points lie beside the axis; what fits them as torsion and bending has no share of rounding."""
    found = []
    for turned in (0.0, np.radians(degrees)):
        modes = solved(boom_on_a_ring(turned))
        moved = beam_motion(modes.equilibrium, modes.shapes[:, 6:12])
        assert moved is not None
        found.append(np.column_stack([moved.share[:, :2], moved.share[:, 2:].sum(axis=1), moved.fit]))
    assert np.allclose(*found, atol=0.03)
    assert found[0][:, 1].max() > 0.8


def test_names_do_not_hang_on_the_mesh():
    """A stout tube of a telescope on four feet."""
    tube = Section(EA=67e6, GJ=21e3, EI_y=27e3, EI_z=27e3, rho_A=0.86, rho_I_y=0.0, rho_I_z=0.0)
    low, high = (
        ((0.46, 0.46), (-0.46, 0.46), (-0.46, -0.46), (0.46, -0.46)),
        ((0.6, 0), (0, 0.6), (-0.6, 0), (0, -0.6)),
    )
    nodes = [node(f"foot{i}", (x, y, 0.0)) for i, (x, y) in enumerate(low)]
    nodes += [node(f"top{i}", (x, y, 1.9), body(9.0)) for i, (x, y) in enumerate(high)]
    ends = [(f"foot{i}", f"top{k % 4}") for i in range(4) for k in (i, i + 1)]
    ends += [(f"top{i}", f"top{(i + 1) % 4}") for i in range(4)]
    ring = dataclasses.replace(tube, EI_y=5e5, EI_z=5e5, GJ=5e5)
    bars = [bar(f"bar {k}", *p, tube if k < 8 else ring, (0.0, 0.1, 1.0)) for k, p in enumerate(ends)]
    names = []
    for elements in (1, 4):
        article = structure(nodes, [dataclasses.replace(b, elements=elements) for b in bars])
        names.append(solved(article, clamped=True, count=3).name)
    assert names[0] == names[1]
    assert sorted(names[0]) == ["first bending x-z", "first bending y-z", "first torsion"]
