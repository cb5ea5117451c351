"""Reduced components: exact force and tangent, no strain as one body, weight, and what they came from."""

import dataclasses
import re

import numpy as np
import pytest
from reduced import bent_beam, with_component

import middeck as md
from middeck.cli.shown.screen import ScreenTable, without_stiffness
from middeck.errors import ConfigError
from middeck.files.articles.components import load_component, write_component
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.elements.component_element import ComponentElement, component_state
from middeck.structure.elements.frames import move, rigid_columns
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.component import (
    Component,
    body_of,
    component_faults,
    rigid_mass,
    warnings_on_component,
)
from middeck.structure.model.finer_mesh import refine_mesh
from middeck.structure.modes.motions.left_out_stiffness import felt_stiffness, left_out
from middeck.structure.modes.reduction_error import estimate_reduction_error
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from middeck.structure.sensitivity.rest import differentiate_rest
from middeck.structure.summary.summary import summarise
from repeats import repeats
from structure_builders import GRAVITY, TUBE, clamped_matrices, member, node, structure


def _element(rng, grids, modal):
    size = 6 * grids + modal
    K, M, X = rng.normal(size=(size, size)), rng.normal(size=(size, size)), rng.normal(size=(grids, 3))
    return ComponentElement(
        point=np.arange(grids),
        joint=np.arange(modal),
        basis=np.eye(size),
        stiffness=K @ K.T,
        mass=M @ M.T,
        arms=X - X.mean(axis=0),
        weights=np.column_stack([np.ones(grids), np.full(grids, 0.1)]),
        moment=rng.normal(size=3),
    )


@pytest.mark.parametrize(("grids", "modal"), [(3, 2), (2, 1), (1, 2)])
def test_force_and_tangent_are_the_differences_of_the_energy(grids, modal):
    """At a state turned and strained by as much as one likes."""
    rng = np.random.default_rng(grids)
    part, size = _element(rng, grids, modal), 6 * grids + modal
    turned = rotation_exp(1.5 * rng.normal(size=3))
    x0 = (part.arms + 0.3 * rng.normal(size=part.arms.shape)) @ turned.T
    R0 = turned @ rotation_exp(0.3 * rng.normal(size=(grids, 3)))
    q0, gravity = rng.normal(size=modal), rng.normal(size=3)

    def at(step):
        s = step[: 6 * grids].reshape(grids, 6)
        x, R = x0 + s[:, :3], rotation_exp(s[:, 3:]) @ R0
        return component_state(part, x, x - part.arms, R - np.eye(3), q0 + step[6 * grids :], gravity)

    here, axes = at(np.zeros(size)), np.eye(size)
    g = np.array([(at(1e-5 * e).energy - at(-1e-5 * e).energy) / 2e-5 for e in axes])
    np.testing.assert_allclose(here.gradient, g, atol=1e-8 * np.abs(g).max())
    # Differences of the gradient have half of the commutator of two turns too, which is antisymmetric.
    H = np.array([(at(1e-5 * e).gradient - at(-1e-5 * e).gradient) / 2e-5 for e in axes])
    K = here.material + here.geometric
    np.testing.assert_allclose(K, 0.5 * (H + H.T), atol=1e-7 * np.abs(K).max())


def test_nothing_strains_as_one_body(campaign):
    for seed in campaign(60):
        rng = np.random.default_rng(seed)
        article = with_component(*bent_beam(rng), count=4)
        model = mesh_structure(article)
        turn = rng.normal(size=3)
        step = np.zeros(model.tree.size)
        x = model.rest.x - model.rest.x[0]
        roots = step[: 6 * model.tree.roots].reshape(-1, 6)
        roots[:, 3:], shift = turn, rng.normal(size=3)
        roots[:, :3] = x @ (rotation_exp(turn) - np.eye(3)).T + shift
        here = assemble(model, move(model.tree, model.rest, step), no_loads())
        drawn = assemble(model, model.rest, no_loads())
        assert here.energy < 1e-20 * abs(drawn.tangent).max()
        assert np.abs(here.gradient).max() < 1e-12 * abs(drawn.tangent).max()


def test_as_drawn_nothing_is_strained_by_rounding(campaign):
    """Stiffness times rounding would be a force, whose geometric stiffness makes a free body unstable."""
    for seed in campaign(400):
        rng = np.random.default_rng([7, seed])
        part = _element(rng, 2, 1)
        still = np.zeros_like(part.arms), np.zeros((2, 3, 3))
        state = component_state(part, part.arms, *still, np.zeros(1), np.zeros(3))
        assert np.abs(state.deformation).max() < 1e-25


@pytest.mark.parametrize("seed", repeats(range(3)))
def test_the_error_falls_with_the_modes_kept(seed):
    """From above (Rayleigh and Ritz), to nothing where all are kept."""
    whole, part = bent_beam(np.random.default_rng(seed))
    orbit = md.Environment.orbit()
    full = md.solve_modes(md.solve_equilibrium(whole, orbit)).frequency_hz[6:14]
    errors = []
    for count in (0, 4, 10, 1000):
        modes = md.solve_modes(md.solve_equilibrium(with_component(whole, part, count=count), orbit))
        assert modes.kind[:6] == ("rigid",) * 6
        errors.append(modes.frequency_hz[6:14] / full - 1.0)
    assert np.all(np.min(errors, axis=1) > -1e-9)
    assert np.all(np.diff(np.array(errors), axis=0) < 1e-9)
    assert np.abs(errors[-1]).max() < 1e-9
    assert np.abs(errors[2][:4]).max() < 1e-3 < np.abs(errors[0]).max()


@pytest.mark.parametrize(
    "reduction", [{"count": 2}, {"count": 6}, {"count": 2, "residual": ["m"]}, {"count": 16}]
)
def test_what_a_reduction_leaves_out_is_reported_mode_by_mode(reduction, tmp_path):
    """Against the whole article: a bound to first order, close where modes are low."""
    orbit = md.Environment.orbit()
    for seed in repeats(range(40, 50), 2):
        whole, part = bent_beam(np.random.default_rng(seed))
        article = with_component(whole, part, **reduction)
        modes = md.solve_modes(md.solve_equilibrium(article, orbit), 16)
        count = len(modes.omega)
        true = md.solve_modes(md.solve_equilibrium(whole, orbit)).frequency_hz[6:count]
        off = modes.frequency_hz[6:] / true - 1.0
        (stated,) = estimate_reduction_error(modes, count)
        assert np.all(stated[:6] == 0.0)
        # Modes that lie close exchange some of their shares, to second order.
        assert np.all(off < 1.25 * stated[6:] + 1e-6)
        # What residual vectors leave is of higher modes than the lowest left out: twice its share at most.
        low = modes.frequency_hz[6:] < 0.3 * article.components[0].next_hz
        assert np.all(stated[6:][low] < 2.0 * off[low] + 1e-6)
        lines = [line for line in modes.warnings if "lacks its modes" in line]
        assert bool(lines) == bool(np.any(stated[: modes.judged] > 1e-3))
    made = article.components[0]
    write_component(tmp_path / "part.npz", made)
    again = dataclasses.replace(article, components=(load_component(tmp_path / "part.npz"),))
    found = md.solve_modes(md.solve_equilibrium(again, orbit), count)
    np.testing.assert_array_equal(estimate_reduction_error(found, count)[0], stated)


def _environments(rng):
    clamps = (
        (Clamp(node="a"),),
        (Clamp(node="a"), Clamp(node="b", about="")),
        (Clamp(node="a", about="x"), Clamp(node="c", about="")),
    )
    held = clamps[rng.integers(3)]
    return md.Environment(title="held", gravity=GRAVITY, clamps=held)


def test_weight_and_what_the_geometric_stiffness_costs(campaign):
    """Soft beams sag by centimetres: where a frequency is off by a thousandth, a warning has the number."""
    for seed in campaign(60):
        rng = np.random.default_rng(seed)
        whole, part = bent_beam(rng, 10.0 ** rng.uniform(1.0, 3.0))
        environment = _environments(rng)
        full = md.solve_modes(md.solve_equilibrium(whole, environment))
        rest = md.solve_equilibrium(with_component(whole, part, count=20), environment)
        modes = md.solve_modes(rest)
        pulled = sum(r.force for r in rest.reactions)
        np.testing.assert_allclose(pulled, -whole.mass * GRAVITY, atol=1e-6)
        error = np.abs(modes.frequency_hz[:8] / full.frequency_hz[:8] - 1.0)
        cost = left_out(rest, modes.omega**2, modes.shapes)[0]
        warned = any("no geometric stiffness" in w for w in modes.warnings)
        worst = int(np.argmax(error))
        assert error[worst] < 1e-3 or (warned and error[worst] < min(3.0 * cost.max(), 5.0 * cost[worst]))


def test_rows_of_modes_without_geometric_stiffness_are_marked():
    """The worst is that of the warning; in a table each mode has its own, and none where all are small."""
    rng = np.random.default_rng(5)
    whole, part = bent_beam(rng, 30.0)
    modes = md.solve_modes(md.solve_equilibrium(with_component(whole, part, count=20), _environments(rng)))
    felt = felt_stiffness(modes.equilibrium, modes.omega**2, modes.shapes)
    (warning,) = [text for text in modes.warnings if "no geometric stiffness" in text]
    assert f"up to {100.0 * felt.max():.2g} %" in warning
    assert f"mode {felt.argmax()} " in warning
    assert np.any(felt == 0.0)
    marked = without_stiffness(ScreenTable("", ["f"], [[f"{f:.1f}"] for f in modes.frequency_hz]), felt)
    assert [row[1] != "" for row in marked.rows] == (felt > 1e-3).tolist()
    plain = ScreenTable("", ["f"], [["1.0"]])
    assert without_stiffness(plain, [0.0]) is plain


def test_a_stiff_article_has_no_warning():
    rng = np.random.default_rng(3)
    whole, part = bent_beam(rng, 1e5)
    environment = _environments(rng)
    rest = md.solve_equilibrium(with_component(whole, part, count=20), environment)
    full = md.solve_equilibrium(whole, environment)
    modes = md.solve_modes(rest)
    assert modes.stated_warnings == ()
    np.testing.assert_allclose(modes.frequency_hz[:6], md.solve_modes(full).frequency_hz[:6], rtol=2e-4)
    sag = full.config.x[2] - full.model.rest.x[2]
    found = rest.config.x[1] - rest.model.rest.x[1]
    np.testing.assert_allclose(found, sag, atol=1e-3 * np.abs(sag).max() + 1e-12)


def test_frequencies_do_not_depend_on_how_the_laboratory_is_turned():
    rng = np.random.default_rng(7)
    whole, part = bent_beam(rng, 60.0)
    article = with_component(whole, part, count=6)
    R = rotation_exp(np.array([2.0, -1.0, 0.7]))
    first = dataclasses.replace(article.members[0], up=R @ article.members[0].up)
    nodes = [dataclasses.replace(n, position=R @ n.position, body=_turned(n.body, R)) for n in article.nodes]
    turned = dataclasses.replace(
        article,
        nodes=tuple(nodes),
        members=(first,),
        components=(dataclasses.replace(article.components[0], axes=R),),
    )
    found = []
    for one, gravity in ((article, GRAVITY), (turned, R @ GRAVITY)):
        environment = md.Environment(title="held", gravity=gravity, clamps=(Clamp(node="a"),))
        found.append(md.solve_modes(md.solve_equilibrium(one, environment)).frequency_hz)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8)
    measures = [summarise(one) for one in (article, turned, whole)]
    assert [m.mass for m in measures] == pytest.approx([whole.mass] * 3)
    np.testing.assert_allclose(measures[0].centre, measures[2].centre, atol=1e-12)
    np.testing.assert_allclose(measures[0].inertia, measures[2].inertia, rtol=1e-3)
    np.testing.assert_allclose(measures[1].inertia, R @ measures[0].inertia @ R.T, atol=1e-9)


def _turned(part, R):
    return dataclasses.replace(part, cg=R @ part.cg, inertia=np.round(R @ part.inertia @ R.T, 15))


def _good():
    return with_component(*bent_beam(np.random.default_rng(1)), count=3).components[0]


def _pair(matrix, i, j, by):
    out = matrix.copy()
    out[i, j] += by
    if i != j:
        out[j, i] += by
    return out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"stiffness": c.stiffness + np.triu(c.stiffness, 1)}, "is not symmetric: .* grid a"),
        (lambda c: {"stiffness": _pair(c.stiffness, 0, 0, 10.0)}, "resists a motion as one body .*grid a x"),
        (lambda c: {"stiffness": _pair(c.stiffness, 13, 2, 10.0)}, "resists a motion|indefinite"),
        (lambda c: {"stiffness": _pair(c.stiffness, 12, 12, -1e6)}, "negative stiffness|indefinite"),
        (lambda c: {"mass": _pair(c.mass, 1, 1, 0.1)}, "mass differs by direction"),
        (lambda c: {"mass": _pair(c.mass, 12, 12, -3.0)}, "indefinite"),
        (lambda c: {"mass": -c.mass}, "its mass is -"),
        (lambda c: {"positions": 1.1 * c.positions}, "do the places of its grids"),
        (lambda c: {"positions": c.positions[:1], "grids": ("a",)}, "matrices of 15 rows|resists|2 frames"),
        (lambda c: {"mass": c.mass * np.nan}, "not finite at grid a x"),
    ],
)  # fmt: skip
def test_what_no_component_can_be_is_named(change, message):
    good = _good()
    assert not [*component_faults(good)]
    bad = dataclasses.replace(good, **change(good))
    faults = "; ".join(component_faults(bad))
    assert re.search(message, faults), faults


@pytest.mark.parametrize("tie", [0.0, 1e9, 1e12])
def test_a_mass_is_symmetric_however_stiffly_its_grids_are_tied(tie):
    """A rod from grid to grid, and a thousandth of two masses on one side of the diagonal."""
    good = _good()
    rod = np.zeros(len(good.mass))
    rod[6:9] = good.positions[1] - good.positions[0]
    rod[:3] = -rod[6:9]
    tied = dataclasses.replace(good, stiffness=good.stiffness + tie * np.outer(rod, rod))
    assert not [*component_faults(tied)]
    mass = good.mass.copy()
    mass[0, 7] += 1e-3 * np.sqrt(mass[0, 0] * mass[7, 7])
    faults = "; ".join(component_faults(dataclasses.replace(tied, mass=mass)))
    assert "its mass is not symmetric" in faults


def test_places_and_frames_must_fit():
    article = with_component(*bent_beam(np.random.default_rng(1)), count=1)
    swapped = dataclasses.replace(article.components[0], frames=("b", "a"))
    with pytest.raises(ConfigError, match=r"grid b stands .* m from frame 'a'"):
        mesh_structure(dataclasses.replace(article, components=(swapped,)))
    lost = dataclasses.replace(article.components[0], frames=("a", "z"))
    with pytest.raises(ConfigError, match="names frame 'z'"):
        mesh_structure(dataclasses.replace(article, components=(lost,)))


def test_modal_mass_that_is_rounding():
    """Residual vectors without mass: their coordinates are static, and the frequencies those without them."""
    article = with_component(*bent_beam(np.random.default_rng(1)), count=3)
    part = article.components[0]
    n = len(part.mass)
    K, M = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
    K[:n, :n], M[:n, :n] = part.stiffness, part.mass
    K[n:, n:], M[n:, n:] = np.diag([1e6, 3e9]), 1e-17 * np.array([[1.0, 2.0], [2.0, -1.0]])
    more = dataclasses.replace(part, stiffness=K, mass=M)
    orbit = md.Environment.orbit()
    both = [dataclasses.replace(article, components=(c,)) for c in (part, more)]
    found = [md.solve_modes(md.solve_equilibrium(one, orbit)).frequency_hz for one in both]
    assert len(found[0]) == len(found[1])
    np.testing.assert_allclose(found[1][6:], found[0][6:], rtol=1e-9)


def test_derivatives_of_an_article_with_a_component_are_those_of_the_whole_solved_again():
    """Hung, so that gravity bends it; all parameters at once, each by a part of its size."""
    rng = np.random.default_rng(1)
    article = with_component(*bent_beam(rng, 300.0), count=4)
    lab = md.Environment(title="lab", gravity=0.3 * GRAVITY, clamps=(Clamp(node="a"),))
    both = article, lab
    wanted = ["node.c.mass", "node.c.cg.z", "node.c.position.y", "member.b-c.EI_y", "environment.gravity.*"]
    parameters = find_parameters(*both, wanted)

    def lam(article, lab) -> np.ndarray:
        return md.solve_modes(md.solve_equilibrium(article, lab)).omega[:6] ** 2

    def along(step: float) -> np.ndarray:
        out = both
        for p, w in zip(parameters, way, strict=True):
            out = set_parameter(*out, p, p.value + step * w)
        return lam(*out)

    way = np.array([0.1, 0.1, 0.1, 30.0, 1.0, 2.0, -1.0])
    found = differentiate_frequencies(md.solve_modes(md.solve_equilibrium(*both)), parameters, 6)
    assert np.all(np.abs(found.d_lambda).max(axis=1) > 0.0)
    h = 1e-3
    want = (along(-2 * h) - 8.0 * along(-h) + 8.0 * along(h) - along(2 * h)) / (12.0 * h)
    np.testing.assert_allclose(way @ found.d_lambda, want, rtol=1e-6, atol=1e-6 * np.abs(want).max())
    with pytest.raises(ConfigError, match=r"node.b.position.x: it moves grids of component 'part' apart"):
        differentiate_rest(md.solve_equilibrium(*both), find_parameters(*both, ["node.b.position.x"]))


@pytest.mark.parametrize("finer", [1, 20])
@pytest.mark.parametrize("count", range(3))
def test_a_boundary_that_holds_nothing_has_no_stiffness(count, finer):
    """One node: its six motions strain nothing, whatever they are computed from."""
    _, part = bent_beam(np.random.default_rng(2))
    part = md.reduce_structure(refine_mesh(part, finer), ["a"], count=count).component
    assert np.all(part.stiffness[:6] == 0.0)


@pytest.mark.parametrize("modes", [1, 3])
def test_few_modes_on_one_grid_whose_stiffness_is_rounding(modes, campaign):
    """Of matrices condensed elsewhere: rounding of 1e9 N/m on the boundary is no stiffness, 1 N/m less is."""
    for seed in campaign(100):
        rng = np.random.default_rng([modes, seed])
        arm, count = np.array([0.3, -0.2, 0.4]), 6 + modes
        R = np.hstack([np.eye(3), -np.cross(np.eye(3), arm).T])
        K, M = (
            np.diag(np.concatenate([np.zeros(6), (2.0 * np.pi * rng.uniform(2, 30, modes)) ** 2])),
            np.eye(count),
        )
        M[:6, :6] = 5.0 * R.T @ R + np.diag([0.0] * 3 + [0.1, 0.2, 0.25])
        M[:6, 6:] = 0.05 * rng.normal(size=(6, modes))
        M[6:, :6] = M[:6, 6:].T
        noise = 1e-7 * rng.normal(size=(6, 6))
        K[:6, :6] += noise + noise.T
        part = Component(
            name="c", grids=("b",), frames=("n",), positions=np.zeros((1, 3)), stiffness=K, mass=M
        )
        assert not [*component_faults(part)]
        K[2, 2] -= 1.0
        assert any(
            "indefinite" in fault for fault in component_faults(dataclasses.replace(part, stiffness=K))
        )


def test_what_is_seldom_meant_is_doubted():
    good = with_component(*bent_beam(np.random.default_rng(1)), count=8).components[0]
    assert not [*warnings_on_component(good)]
    heavy = dataclasses.replace(good, mass=_pair(good.mass, 14, 14, 0.0625))
    stiff = dataclasses.replace(good, stiffness=_pair(good.stiffness, 14, 14, 1e20))
    for bad, warning in ((heavy, "modal mass of 1.0625"), (stiff, "modal coordinate 3 at")):
        for unit in (1.0, 1e-3):  # modal masses are one in the units of a file, 1e-6 in those of mm
            modal = np.diag(np.append(np.ones(12), np.full(bad.modal, unit)))
            bad = dataclasses.replace(
                bad, mass=modal @ bad.mass @ modal, stiffness=modal @ bad.stiffness @ modal
            )
            assert not [*component_faults(bad)]
            (doubt,) = warnings_on_component(bad)
            assert (warning if unit == 1.0 else warning.replace("1.0625", "1.0625e-06")) in doubt


def test_mass_as_one_body():
    whole, part = bent_beam(np.random.default_rng(2))
    made = with_component(whole, part, count=2).components[0]
    summary = summarise(part)
    assert body_of(made).mass == pytest.approx(summary.mass, rel=1e-12)
    np.testing.assert_allclose(body_of(made).cg, summary.centre, atol=1e-12)
    assert isinstance(made, Component)
    model = mesh_structure(part)
    rigid = rigid_columns(model.tree, model.rest, np.zeros(3))
    M = mass_matrix(model, model.rest)
    np.testing.assert_allclose(rigid_mass(made), rigid.T @ (M @ rigid), atol=1e-12)


def test_a_rigid_component_is_a_body_on_its_gimbal():
    """The payload of a gimbal as six rows of a rigid mass matrix: the same rest, torques and modes in 1-g."""
    article = md.load_structure("articles/mace-simple.toml")
    lab = md.load_environment("environments/lab.toml")
    joint = next(j for j in article.joints if j.name == "pri_z")
    body, (x, y, z) = joint.body, joint.body.mass * joint.body.cg
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    about = body.inertia + body.mass * (body.cg @ body.cg * np.eye(3) - np.outer(body.cg, body.cg))
    part = Component(
        name="payload",
        grids=("1",),
        frames=("pri_z",),
        positions=np.zeros((1, 3)),
        stiffness=np.zeros((6, 6)),
        mass=np.block([[body.mass * np.eye(3), -cross], [cross, about]]),
        axes=_attitude(article, "pri_z"),
    )
    bare = dataclasses.replace(joint, body=dataclasses.replace(body, mass=0.0, inertia=np.zeros((3, 3))))
    joints = tuple(bare if j.name == "pri_z" else j for j in article.joints)
    hung = dataclasses.replace(article, joints=joints, components=(part,))
    rests = [md.solve_equilibrium(one, lab) for one in (article, hung)]
    np.testing.assert_allclose(rests[1].holding_torque, rests[0].holding_torque, atol=1e-7)
    np.testing.assert_allclose(rests[1].suspension.reaction, rests[0].suspension.reaction, rtol=1e-9)
    true, found = (md.solve_modes(rest).frequency_hz for rest in rests)
    np.testing.assert_allclose(found[:30], true[:30], rtol=1e-7)


def _attitude(article, frame):
    model = mesh_structure(article)
    return model.drawn.R[model.frames.index(frame)]


def test_grids_with_some_coordinates_and_arms():
    """Rows of zeros for what a grid has not, and a grid at an offset from its node."""
    whole, part = bent_beam(np.random.default_rng(9))
    good = with_component(whole, part, count=4)
    made = good.components[0]
    orbit = md.Environment.orbit()
    true = md.solve_modes(md.solve_equilibrium(good, orbit)).frequency_hz[6:16]
    shift = np.array([0.1, -0.05, 0.2])
    moved = dataclasses.replace(made, positions=made.positions + 0.7)  # its own origin is anywhere
    arms = dataclasses.replace(moved, offsets=np.array([np.zeros(3), shift]))
    nodes = [dataclasses.replace(n, position=n.position - shift) if n.name == "b" else n for n in good.nodes]
    member = dataclasses.replace(good.members[0], start_offset=shift)
    offset = dataclasses.replace(good, nodes=tuple(nodes), members=(member,), components=(arms,))
    found = md.solve_modes(md.solve_equilibrium(offset, orbit)).frequency_hz[6:16]
    np.testing.assert_allclose(found, true, rtol=1e-9)
    # A fifth grid with nothing but a translation, which has neither stiffness nor mass, is refused.
    K, M = (np.zeros((len(made.mass) + 6,) * 2) for _ in range(2))
    keep = np.r_[0:12, 18 : len(K)]
    K[np.ix_(keep, keep)], M[np.ix_(keep, keep)] = made.stiffness, made.mass
    more = dataclasses.replace(
        made,
        grids=("a", "b", "c"),
        frames=("a", "b", "c"),
        positions=np.vstack([made.positions, whole.nodes[3].position]),
        stiffness=K,
        mass=M,
        present=np.array([[True] * 6, [True] * 6, [True] + [False] * 5]),
    )
    assert any("neither stiffness nor mass" in fault for fault in component_faults(more))
    none = dataclasses.replace(more, present=np.array([[True] * 6, [True] * 6, [False] * 6]))
    assert not [*component_faults(none)]
    same = dataclasses.replace(good, components=(none,))
    found = md.solve_modes(md.solve_equilibrium(same, orbit)).frequency_hz[6:16]
    np.testing.assert_allclose(found, true, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_of_grids_may_turn_about_itself_without_inertia(seed):
    """Lumped masses on a bar in any direction: taken where free, refused where a stiffness is grounded."""
    rng = np.random.default_rng(seed)
    R = rotation_exp(rng.standard_normal(3)) if seed else np.eye(3)
    section = dataclasses.replace(TUBE, rho_A=1e-12)
    ends = [node(n, R @ [0.5 * k, 0.0, 0.0]) for k, n in enumerate("abc")]
    bars = [member(*pair, section, 1, up=R @ [0.0, 1.0, 0.0]) for pair in ("ab", "bc")]
    K = clamped_matrices(mesh_structure(structure(ends, bars)), fixed=())[0]
    M = np.diag(np.tile(np.repeat([1.0, 0.0], 3), 3)) * rng.uniform(0.1, 1.0)
    names, places = tuple("abc"), np.array([n.position for n in ends])
    part = Component(name="bar", grids=names, frames=names, positions=places, stiffness=K, mass=M)
    assert list(component_faults(part)) == []
    for way in range(6):
        grounded = dataclasses.replace(part, stiffness=_pair(K, 6 + way, 6 + way, 0.01 * K[6 + way, 6 + way]))
        assert any("resists a motion as one body" in fault for fault in component_faults(grounded))
