"""What is proved of an adaptive gain holds: against loops closed here, sampled densely, and run."""

from __future__ import annotations

import dataclasses
import itertools
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as sla

from engine_campaigns import seeds_of
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.gate.adaptive import prove_gain
from middeck.realtime.gate.gain_loop import closed_at, form_gain_loop
from middeck.realtime.gate.gain_metric import Metric
from middeck.realtime.gate.gain_path import bound_fade, bound_joints, bound_piece, join_metrics
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.norm_bound import bound_norm, is_below, is_positive, is_proved_to_grow
from middeck.realtime.gate.steps_without_rig import GateMargins
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section, static_gain
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from packaged_laws import PERIOD_S, ports, random_law


def gain_of(maximum=2.0, rate=0.05, sensor="y0", **more):
    return AdaptiveGain(
        maximum=maximum, rate=rate, sensor=sensor, band_hz=(1.0, 9.0), quiet_rms=0.1, loud_rms=0.2, **more
    )


def beam(rng, modes=3, inputs=2, outputs=2):
    """Light modes between inputs and outputs."""
    omega = 2.0 * np.pi * np.geomspace(2.0, 19.0, modes)
    A = sla.block_diag(*([[0.0, w], [-w, -0.02 * w]] for w in omega))
    B, C = np.zeros((2 * modes, inputs)), np.zeros((outputs, 2 * modes))
    B[1::2], C[:, ::2] = rng.standard_normal((modes, inputs)), rng.standard_normal((outputs, modes))
    y, u = ports(0, outputs, inputs)
    return Plant(dynamics=StateSpace(A, B, C, np.zeros((outputs, inputs))), inputs=u, outputs=y)


def scaled_law(rng, states, size, inputs=2, outputs=2, applied=False):
    law = random_law(rng, states, inputs, outputs, applied=applied, radii=(0.9, 0.99))
    s = law.sampled
    quiet = SampledStateSpace(s.A, s.B, size * s.C, size * s.D, period_s=PERIOD_S)
    return dataclasses.replace(law, dynamics=quiet)


def packaged(law, **more):
    return package_law(law, "law", input_range=1.0, limit=1.0, **more)


def held(system, period_s=PERIOD_S):
    """exp(A T) and its integral times B, by an exponential of its own."""
    n, m = system.B.shape
    both = sla.expm(np.block([[system.A, system.B], [np.zeros((m, n + m))]]) * period_s)
    return both[:n, :n], both[:n, n:]


def closed_radius(system, law, gain):
    """Largest pole of the sampled loop u[k] = gain times law(y[k]), without a direct term of the plant."""
    A, B = held(system)
    C, k = system.C, law.sampled
    loop = np.block([[A + gain * B @ k.D @ C, gain * B @ k.C], [k.B @ C, k.A]])
    return float(np.abs(np.linalg.eigvals(loop)).max())


def test_what_is_proved_of_random_loops_is_so():
    """Dense sampling finds every proved loop stable with the decay; what grows is said to, at its gain."""
    proved = grown = 0
    for seed in seeds_of("adaptive gains of random loops"):
        rng = np.random.default_rng(seed)
        plant, law = beam(rng), scaled_law(rng, 6, 10.0 ** rng.uniform(-3.5, -0.3))
        found = prove_gain(packaged(law), gain_of(), {"beam": plant})[0]
        radii = [closed_radius(plant.dynamics, law, g) for g in np.linspace(0.0, 2.0, 101)]
        if found.constant:
            proved += 1
            assert max(radii) < 1.0
            assert found.decay_per_s <= -np.log(max(radii)) / PERIOD_S
            assert found.proved == (found.rate_limit is None or found.rate_limit >= 0.05)
        else:
            assert "not decided" in found.said or found.unstable_gain is not None
        if found.unstable_gain is not None:
            grown += 1
            assert closed_radius(plant.dynamics, law, found.unstable_gain) > 1.0
        # Undecided is at most what is within a millionth of the circle: one of the whole campaign.
        assert found.constant == (max(radii) < 1.0) or abs(max(radii) - 1.0) < 1e-6
    assert proved > 3
    assert grown >= 1


def single_mode(zeta, stiffening):
    """x'' + 2 zeta w x' + w^2 x = -w^2 stiffening g x at w = 2 pi: its law is a gain of the position."""
    w = 2.0 * np.pi
    A, B = [[0.0, w], [-w, -2.0 * zeta * w]], [[0.0], [w]]
    y, u = (Port("y0", "m"),), (Port("u0", "N"),)
    plant = Plant(dynamics=StateSpace(A, B, [[1.0, 0.0]], [[0.0]]), inputs=u, outputs=y)
    none = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-stiffening]], period_s=PERIOD_S
    )
    return plant, Compensator(none, y, u)


def test_a_gain_that_pumps_a_mode_is_refused_and_a_slow_one_proved():
    """Stable at each constant gain; moved at twice its frequency the mode grows (Mathieu)."""
    plant, law = single_mode(0.01, 1.0)
    fast, slow = gain_of(maximum=1.0, rate=6.0), gain_of(maximum=1.0, rate=0.05)
    pumped, moved = (prove_gain(packaged(law), gain, {"mode": plant})[0] for gain in (fast, slow))
    assert pumped.constant
    assert not pumped.proved
    assert "not 6 1/s" in pumped.said
    assert moved.proved
    assert moved.rate_limit > 0.05
    # Stiff while the mode moves outwards, soft on its way back, as far as the rate allows: the run itself.
    A, B = held(plant.dynamics)
    for rate, grows in ((6.0, True), (moved.rate_limit, False)):
        x, g, size = np.array([1.0, 0.0]), 0.0, []
        for _ in range(int(20.0 / PERIOD_S)):
            size.append(float(np.linalg.norm(x)))
            after = A @ x + B[:, 0] * (-g * x[0])
            way = 1.0 if abs(after[0]) > abs(x[0]) else -1.0
            g, x = min(max(g - way * rate * PERIOD_S, 0.0), 1.0), after
        first, last = max(size[:1000]), max(size[-1000:])
        assert last > 10.0 * first if grows else last < first


def test_the_norm_falls_along_every_move():
    """The corners bound all that lies between, by powers of matrices that know no corners."""
    rng = np.random.default_rng(2)
    plant, law = beam(rng), scaled_law(rng, 4, 1e-2)
    loop = form_gain_loop(packaged(law), plant)
    n = len(loop.A)

    def metric():
        T = np.eye(n) + 0.2 * rng.standard_normal((n, n))
        return Metric(T, np.linalg.inv(T))

    spans = (0.3, 0.5), (0.5, 0.9)
    pieces = [join_metrics(low, high, metric(), metric()) for low, high in spans]
    pieces[1] = join_metrics(0.5, 0.9, _upper(pieces[0]), _upper(pieces[1]))
    step, joint = 0.07, bound_joints(pieces)
    assert 1.0 <= joint < 1.0 + 1e-9
    bound = joint * max(bound_piece(loop, piece, (0.0, 2.0), step) for piece in pieces)

    def norm_at(g):
        """A square root of P(g), the geodesic by matrix powers."""
        piece = pieces[0] if g <= 0.5 else pieces[1]
        first = piece.metric.T.T @ piece.metric.T
        upper = _upper(piece)
        second = upper.T.T @ upper.T
        root = sla.sqrtm(first).real
        t = (g - piece.low) / (piece.high - piece.low)
        middle = sla.fractional_matrix_power(np.linalg.inv(root) @ second @ np.linalg.inv(root), t).real
        return sla.sqrtm(root @ middle @ root).real

    worst = 0.0
    for _ in range(300):
        g = rng.uniform(0.3, 0.9)
        after = np.clip(g + rng.uniform(-step, step), 0.3, 0.9)
        factor = norm_at(after) @ closed_at(loop, g) @ np.linalg.inv(norm_at(g))
        worst = max(worst, float(np.linalg.norm(factor, 2)))
    assert worst <= bound
    assert worst > 0.5 * bound  # and not by far
    grown = []
    for way in (1, -1):
        norms = [norm_at(g) for g in np.linspace(0.3, 0.9, 7)[::way]]
        steps = [other @ np.linalg.inv(one) for one, other in itertools.pairwise(norms)]
        grown.append(np.prod([np.linalg.norm(step, 2) for step in steps]))
        assert np.linalg.norm(norms[-1] @ np.linalg.inv(norms[0]), 2) <= bound_fade(pieces)
    assert max(grown) <= bound_fade(pieces) < 1.5 * max(grown)


def _upper(piece):
    grown = np.exp(piece.bend)
    return Metric(grown[:, None] * piece.metric.T, piece.metric.S / grown)


def test_norms_are_bounded_against_rounding():
    """Exact rational arithmetic never finds a matrix above a bound that is called proved."""
    rng = np.random.default_rng(0)
    orthogonal = (
        np.array([[1, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]]) / 2.0
    )  # norm 1, exact
    assert not is_below(orthogonal, 1.0)
    assert not is_below(orthogonal, 1.0 - 1e-15)
    assert is_below(orthogonal, 1.0 + 1e-13)
    assert 1.0 < bound_norm(orthogonal) < 1.0 + 1e-12
    for _ in range(200):
        matrix = rng.integers(-9, 10, (4, 4)).astype(float)
        bound = np.linalg.norm(matrix, 2) * (
            1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-17.0, -12.0)
        )
        if is_below(matrix, bound):
            square = Fraction(float(bound)) ** 2
            exact = [[Fraction(int(v)) for v in row] for row in matrix]
            gap = [[(square if i == j else 0) - sum(row[i] * row[j] for row in exact) for j in range(4)]
                   for i in range(4)]  # fmt: skip
            assert _is_positive(gap)
    assert not is_below(np.array([[np.nan]]), 1.0)
    assert bound_norm(np.array([[np.inf]])) == np.inf
    assert not is_positive(np.diag([1.0, 1e-17]), np.zeros((2, 2)))


def _is_positive(matrix):
    """By elimination in fractions."""
    rows = [list(row) for row in matrix]
    for k in range(len(rows)):
        if rows[k][k] <= 0:
            return False
        for i in range(k + 1, len(rows)):
            share = rows[i][k] / rows[k][k]
            rows[i] = [a - share * b for a, b in zip(rows[i], rows[k], strict=True)]
    return True


def test_the_loop_is_the_package_at_that_gain():
    """Poles of a sample that is run from each unit state, with filters, inner loop and path E."""
    rng = np.random.default_rng(7)
    section = Section(np.array([0.9, -0.4, 0.1]), np.array([-0.5, 0.2]))
    law = scaled_law(rng, 5, 0.2, applied=True)
    package = packaged(law, filters=(InputFilter(1, section),), ramp_s=0.1)
    package = dataclasses.replace(package, paths=(LoopPath(0, 1, section), LoopPath(1, 0, static_gain(0.1))))
    package = dataclasses.replace(
        package, lower=np.full(2, -1e9), upper=np.full(2, 1e9), input_range=np.full(2, 1e9), vectors=None
    )
    plant = beam(rng)
    late = delay_plant(plant, PERIOD_S)
    loop = form_gain_loop(package, late)
    A, B = held(plant.dynamics)
    n, c = 6, len(package.core.A)
    states = n + 2 + c + 2 * 3  # and the delayed commands, and two of each section

    def sample(z, gain):
        reference = ReferenceLaw(package)
        reference.fade = lambda: gain
        x, waiting, rest = z[:n], z[n : n + 2], z[n + 2 :]
        reference.x = rest[:c]
        for k, each in enumerate((*reference.filters, *reference.paths)):
            each.s1, each.s2 = rest[c + 2 * k], rest[c + 2 * k + 1]
        u = reference.step(plant.dynamics.C @ x)
        sections = [s for each in (*reference.filters, *reference.paths) for s in (each.s1, each.s2)]
        return np.concatenate([A @ x + B @ waiting, u, reference.x, sections])

    for gain in (0.0, 0.3, 1.0, 1.7):
        own = np.array([sample(unit, gain) for unit in np.eye(states)]).T
        both = [np.poly(m) for m in (own, closed_at(loop, gain))]
        points = np.exp(1j * np.linspace(0.1, 3.0, 7))
        values = [np.polyval(p, points) for p in both]
        both_sizes = [values[0], values[1] * points ** (len(own) - len(loop.A))]
        assert np.abs(both_sizes[0] - both_sizes[1]).max() < 1e-9 * np.abs(values[0]).max()


def test_a_delay_counts():
    """Position feedback with a delay pumps the mode at once: the gain at which it grows is named."""
    plant, law = single_mode(0.01, 0.1)
    sound = prove_gain(packaged(law), gain_of(maximum=1.0), {"mode": plant})[0]
    assert sound.constant
    late = prove_gain(packaged(law), gain_of(maximum=1.0), {"mode": delay_plant(plant, 0.1)})[0]
    assert not late.constant
    assert not late.fades
    assert late.unstable_gain is not None
    assert "grows" in late.said


def test_a_free_body_needs_a_hold():
    """Nothing holds it at a gain of zero, which fades reach, with a least gain too; an inner loop does."""
    y, u = (Port("y0", "rad"), Port("y1", "rad/s")), (Port("u0", "N m"),)
    body = Plant(
        dynamics=StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1))),
        inputs=u, outputs=y,
    )  # fmt: skip
    none = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[-1.0, -1.5]], period_s=PERIOD_S
    )
    package = packaged(Compensator(none, y, u))
    free = prove_gain(package, gain_of(), {"body": body})[0]
    assert not free.constant
    assert "at a gain of 0" in free.said
    assert "does not decay" in free.said
    least = prove_gain(package, gain_of(minimum=0.2), {"body": body})[0]
    assert least.constant
    assert not least.fades
    assert not least.proved
    assert "a fade passes every gain from zero, and those are not proved to decay: not decided" in least.said
    inner = tuple(LoopPath(k, 0, static_gain(-0.4)) for k in (0, 1))
    holding = add_test_vectors(dataclasses.replace(package, paths=inner, vectors=None))
    assert prove_gain(holding, gain_of(), {"body": body})[0].proved
    above = prove_gain(holding, gain_of(minimum=0.2), {"body": body})[0]
    assert above.proved
    assert above.fades
    assert "so does every gain from zero, as fades pass them" in above.said
    assert above.fade_growth < np.inf


def test_what_grows_below_the_least_gain_between_two_fades_is_refused():
    """By Hurwitz's condition it grows for |g - 0.35| < 0.02 only, between fades of 0.3 and 0.4."""
    constant = 1.0 - 0.35**2 + 0.02**2
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-constant, -1.0, -1.0]]
    (y, u), none = ports(0, 1, 1), (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)))
    hump = StateSpace(A, [[0.0], [0.0], [1.0]], [[2.7, 1.0, 1.0]], [[0.0]])
    models = {"hump": Plant(dynamics=hump, inputs=u, outputs=y)}
    law = packaged(Compensator(SampledStateSpace(*none, [[-1.0]], period_s=PERIOD_S), y, u))
    gain = gain_of(maximum=1.0, minimum=0.6, rate=1e-3)
    *others, step = examine_package(law, models, GateMargins(gain_db=0.0, phase_deg=0.0), gain=gain).steps
    assert all(other.passed for other in others)
    assert (step.name, step.passed) == ("adaptive gain hump", False)
    assert "those are not proved to decay: unstable at a gain of 0.3" in step.said
    (proof,) = prove_gain(law, gain, models)
    assert (proof.constant, proof.fades, proof.proved) == (True, False, False)
    assert abs(proof.unstable_gain - 0.35) < 0.02


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_direct_term_bends_the_gain(way):
    """Feedback of an acceleration within the sample: u = -g d (D u + ...), poles by a loop of its own."""
    w = 2.0 * np.pi * 3.0
    A, B = np.array([[0.0, 1.0], [-w * w, -0.04 * w]]), np.array([[0.0], [1.0]])
    y, u = (Port("y0", "m/s^2"),), (Port("u0", "N"),)
    plant = Plant(dynamics=StateSpace(A, B, A[1:], [[1.0]]), inputs=u, outputs=y)
    none = SampledStateSpace([[0.9]], [[0.02]], [[way]], [[-0.2]], period_s=PERIOD_S)
    law = Compensator(none, y, u)
    found = prove_gain(packaged(law), gain_of(), {"mode": plant})[0]
    Ad, Bd = held(plant.dynamics)
    radii = []
    for g in np.linspace(0.0, 2.0, 101):
        through = 1.0 / (1.0 + 0.2 * g)
        row = g * through * np.hstack([-0.2 * A[1:], [[way]]])  # u by x and by the law's state
        y_row = np.hstack([A[1:], [[0.0]]]) + row
        loop = np.vstack([np.hstack([Ad, np.zeros((2, 1))]) + Bd @ row, 0.02 * y_row])
        loop[2, 2] += 0.9
        radii.append(float(np.abs(np.linalg.eigvals(loop)).max()))
    assert found.constant == (max(radii) < 1.0) == (way < 0.0)
    if found.constant:
        assert found.decay_per_s <= -np.log(max(radii)) / PERIOD_S
    else:
        assert found.unstable_gain is not None
        assert found.unstable_gain <= 2.0
    singular = packaged(Compensator(dataclasses.replace(none, D=[[0.6]]), y, u))
    assert "no solution at a gain of 1.667" in prove_gain(singular, gain_of(), {"mode": plant})[0].said
    two = beam(np.random.default_rng(3))
    lively = dataclasses.replace(two, dynamics=dataclasses.replace(two.dynamics, D=0.1 * np.eye(2)))
    several = packaged(scaled_law(np.random.default_rng(3), 4, 1e-3))
    assert "within a sample" in prove_gain(several, gain_of(), {"two": lively})[0].said


def test_units_change_nothing():
    """Outputs in other units, states in any scale: the same proof, and nearly the same rate."""
    rng = np.random.default_rng(5)
    plant, law = beam(rng), scaled_law(rng, 6, 10.0**-1.2)
    s, k = plant.dynamics, law.sampled
    found = prove_gain(packaged(law), gain_of(), {"beam": plant})[0]
    assert found.constant
    y, u, x, z = (np.diag(10.0 ** rng.uniform(-4.0, 4.0, size)) for size in (2, 2, 6, 6))
    per_y, per_u, per_x, per_z = (np.linalg.inv(unit) for unit in (y, u, x, z))
    other = Plant(
        dynamics=StateSpace(x @ s.A @ per_x, x @ s.B @ per_u, y @ s.C @ per_x, s.D),
        inputs=plant.inputs, outputs=plant.outputs,
    )  # fmt: skip
    scaled = SampledStateSpace(
        z @ k.A @ per_z, z @ k.B @ per_y, u @ k.C @ per_z, u @ k.D @ per_y,
        period_s=PERIOD_S,
    )  # fmt: skip
    again = prove_gain(packaged(Compensator(scaled, law.inputs, law.outputs)), gain_of(), {"beam": other})[0]
    assert again.proved == found.proved
    assert again.decay_per_s == pytest.approx(found.decay_per_s, rel=0.2)  # metrics start from other units


def test_a_loop_of_the_study_s_size_is_proved():
    """30 states of a plant with a delay of one and a half samples, 60 of a law."""
    rng = np.random.default_rng(11)
    plant, law = beam(rng, modes=15), scaled_law(rng, 60, 1e-3)
    found = prove_gain(packaged(law), gain_of(), {"beam": delay_plant(plant, 1.5 * PERIOD_S)})[0]
    assert found.proved


def test_growth_is_proved_only_where_it_is():
    rng = np.random.default_rng(1)
    for radius in (0.999, 0.99999, 1.00001, 1.001):
        A = random_law(rng, 6, 1, 1, radii=(0.9, 0.95)).sampled.A
        A = A * (radius / np.abs(np.linalg.eigvals(A)).max())
        assert is_proved_to_grow(A, np.abs(A), 1e-12) == (radius > 1.0)
    assert not is_proved_to_grow(np.diag([1.0 + 1e-14, 0.5]), np.eye(2), 1e-12)  # within the error


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"maximum": -1.0}, "gains from"), ({"minimum": 3.0}, "gains from"),
        ({"maximum": np.inf}, "gains from"),
        ({"minimum": 1.1}, "gains from"),
        ({"rate": 0.0}, "a rate of"), ({"rate": np.nan}, "a rate of"),
        ({"band_hz": (9.0, 1.0)}, "a band from"), ({"band_hz": (1.0, 2.0, 3.0)}, "a band of"),
        ({"band_hz": 1.0}, "a band of"),
        ({"quiet_rms": 0.3}, "an rms"), ({"loud_rms": np.nan}, "an rms"),
    ],
)  # fmt: skip
def test_a_gain_that_makes_no_sense_is_refused(wrong, said):
    with pytest.raises(ConfigError, match=said):
        dataclasses.replace(gain_of(), **wrong)


def test_the_gate_proves_the_gain_last_and_on_every_model():
    plant, law = single_mode(0.1, 0.1)
    package, least = packaged(law), GateMargins(gain_db=0.0, phase_deg=0.0)
    models = {"one": plant, "other": delay_plant(plant, 2e-4)}
    verdict = examine_package(package, models, least, gain=gain_of())
    assert verdict.passed
    assert [step.name for step in verdict.steps[-4:-2]] == ["adaptive gain one", "adaptive gain other"]
    assert [proof.model for proof in verdict.proofs] == ["one", "other"]
    wide = examine_package(package, {"one": plant}, least, gain=gain_of(maximum=1e5))
    assert not wide.passed
    assert "unstable at a gain of" in wide.steps[-1].said
    assert [step.passed for step in wide.steps[:-1]] == [True] * 8


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"sensor": "y9"}, "no input 'y9'"), ({"band_hz": (1.0, 300.0)}, "a band up to 300 Hz")],
)
def test_a_gain_that_does_not_fit_the_package_is_refused_first(wrong, said):
    plant, law = single_mode(0.1, 0.1)
    gain = dataclasses.replace(gain_of(), **wrong)
    refused = examine_package(packaged(law), {"one": plant}, gain=gain)
    assert refused.steps[-1].name == "adaptive gain"
    assert said in refused.steps[-1].said
    assert refused.proofs == ()
    with pytest.raises(ConfigError, match=said):
        prove_gain(packaged(law), gain, {"one": plant})
