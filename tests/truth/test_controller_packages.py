"""What a package computes: the law, the observer that sees limits, and single precision within its bound."""

from __future__ import annotations

import dataclasses
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as sla
import scipy.signal

from engine_campaigns import cases_of, seeds_of
from middeck.control.law.compensator import Compensator, arrange_ports
from middeck.control.law.pd_loops import PDLoops
from middeck.control.lqg.design import design_lqg
from middeck.control.sampled.emulation import emulate
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError
from middeck.files.exchange.named_system import as_compensator
from middeck.files.exchange.python_control import from_control
from middeck.files.exchange.scipy_signal import from_scipy
from middeck.realtime.gate.steps_without_rig import check_error_bound, check_vectors
from middeck.realtime.generate.c_source import generate_c
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.l1_norms import bound_peaks
from middeck.realtime.package.modal_form import to_modal
from middeck.realtime.package.overflow import ANYTHING, OWN_COMMANDS, when_nothing_overflows
from middeck.realtime.package.package_law import package_law, without_applied
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.single_precision import bound_error, to_single
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from packaged_laws import PERIOD_S, compile_law, ports, random_law, replay, worst_error, worst_signs
from plant_builders import unit_weights
from repeats import repeats
from study_compensators import study_law

pytestmark = pytest.mark.usefixtures("compiler")


def run(package, y, fast=False):
    law = ReferenceLaw(package, fast=fast)
    return np.array([law.step(row) for row in y])


@pytest.mark.parametrize(("form", "allowed"), [("dense", 1e-12), ("modal", 1e-10)])
def test_the_law_is_the_compensator(form, allowed, tmp_path):
    """C, and the fast law, beside a simulation of A, B, C, D: over 1e5 steps in the long form."""
    rng = np.random.default_rng(11)
    law = random_law(rng, 60, 14, 5)
    package = package_law(law, "law", form=form)
    y = rng.standard_normal((cases_of("samples of a law beside its compensator"), 14))
    truth = simulate(law.sampled, y, np.zeros(60))[0]
    scale = np.abs(truth).max()
    assert np.abs(compile_law(package, tmp_path)(y) - truth).max() < allowed * scale
    assert np.abs(run(package, y, fast=True) - truth).max() < allowed * scale


def observed_beam():
    """Two modes with position sensors, and their observers."""
    A = sla.block_diag([[0.0, 6.0], [-6.0, -0.12]], [[0.0, 20.0], [-20.0, -0.4]])
    plant = StateSpace(
        A, np.array([[0.0], [1.0], [0.0], [0.7]]), np.array([[1.0, 0.0, 0.8, 0.0]]), np.zeros((1, 1))
    )
    way, push = (Port("way", "m"),), (Port("push", "N"),)
    named = Plant(dynamics=plant, inputs=push, outputs=way, w=("push",), u=("push",), z=("way",), y=("way",))
    weights = unit_weights(("push",), 1e-4)  # fmt: skip
    return named, weights


def observe(plant, law, gain, y, limit):
    """x+ = A x + B v + L (y - C x), u = -K x with v = u within the limits: written from the textbook."""
    x, out = np.zeros(len(plant.A)), []
    for row in y:
        v = np.clip(law.C @ x, -limit, limit)
        out.append(v)
        x = plant.A @ x + plant.B @ v + gain @ (row - plant.C @ x)
    return np.array(out)


def test_an_observer_sees_the_torque_really_applied():
    named, weights = observed_beam()
    law = design_sampled_lqg(named, weights, 1e3, 0.01)
    held = sample_dynamics(named.system, 0.01)
    gain = law.sampled.B  # the predictor's injection
    y = 0.3 * np.random.default_rng(2).standard_normal((400, 1))
    expected = observe(held, law.sampled, gain, y, 0.5)
    for form in ("dense", "modal"):
        found = run(package_law(law, "law", limit=0.5, form=form), y)
        assert np.abs(found - expected).max() < 1e-9
    assert np.mean(np.abs(expected) == 0.5) > 0.2
    blind = run(package_law(dataclasses.replace(law, applied=None), "law", limit=0.5), y)
    assert np.abs(blind - expected).max() > 0.1


def test_what_is_applied_elsewhere_can_be_told():
    """`commit` with another command than `compute` gave: the estimate follows the plant."""
    named, weights = observed_beam()
    law = design_sampled_lqg(named, weights, 1e3, 0.01)
    held, package = sample_dynamics(named.system, 0.01), package_law(law, "law")
    y = 0.3 * np.random.default_rng(4).standard_normal((200, 1))
    reference, x = ReferenceLaw(package), np.zeros(4)
    for k, row in enumerate(y):
        u = reference.compute(row)
        assert np.abs(u - law.sampled.C @ x).max() < 1e-9
        v = u if k % 7 else np.array([0.2])
        reference.commit(v)
        x = held.A @ x + held.B @ v + law.sampled.B @ (row - held.C @ x)


@pytest.mark.parametrize("rule", ["hold", "tustin"])
def test_a_continuous_observer_keeps_its_path_when_it_is_sampled(rule):
    """Held measurements and a missing command, against the continuous law integrated between the samples."""
    named, weights = observed_beam()
    law = design_lqg(named, weights, 1e2)
    s, T = law.system, 0.0005
    package = package_law(emulate(law, T, rule), "law")
    reference, x = ReferenceLaw(package), np.zeros(len(s.A))
    both = np.zeros((len(s.A) + 2, len(s.A) + 2))
    both[: len(s.A)] = np.hstack([s.A, s.B, law.applied])
    step = sla.expm(both * T)[: len(s.A)]
    worst = 0.0
    for k in range(4000):
        y = np.array([np.sin(0.02 * k)])
        u = reference.compute(y)
        e = np.array([0.3 * np.sin(0.011 * k + 1.0)])
        reference.commit(u + e)
        worst = max(worst, float(np.abs(u - (s.C @ x + s.D @ y)).max()))
        x = step @ np.concatenate([x, y, e])
    peak = float(np.abs(s.C @ x).max())
    # The hold is exact; Tustin's rule takes the mean of two samples, half a sample apart from a hold.
    assert worst < (1e-9 if rule == "hold" else 0.05 * max(peak, 0.1))


def test_ports_in_another_order_keep_the_path():
    law = random_law(np.random.default_rng(1), 6, 2, 3)
    turned = arrange_ports(law, law.inputs[::-1], law.outputs[::-1])
    y = np.random.default_rng(2).standard_normal((200, 2))
    first = run(package_law(law, "law", limit=0.4, form="dense"), y)
    second = run(package_law(turned, "law", limit=0.4, form="dense"), y[:, ::-1])
    assert np.abs(first - second[:, ::-1]).max() < 1e-9


def test_filters_and_inner_loop():
    """Filters before the law, a PD loop beside it that does not fade: against SciPy's sections."""
    rng = np.random.default_rng(3)
    dynamics = SampledStateSpace([[0.8]], [[1.0, 0.5]], [[0.3]], [[0.1, -0.2]], period_s=PERIOD_S)
    reads = (Port("pri", "rad"), Port("pri_rate", "rad/s"))
    law = Compensator(dynamics, reads, (Port("pri", "N m"),))
    notch = Section(np.array([0.9, -1.2, 0.8]), np.array([-1.1, 0.7]))
    pd = PDLoops(("pri",), np.array([2.0]), np.array([0.1]))
    package = package_law(
        law, "law", ramp_s=0.1, inner=pd, filters=(InputFilter(0, notch), InputFilter(0, notch))
    )
    y = rng.standard_normal((300, 2))
    sos = np.array([[*notch.b, 1.0, *notch.a]] * 2)
    filtered = np.column_stack([scipy.signal.sosfilt(sos, y[:, 0]), y[:, 1]])
    c = simulate(dynamics, filtered, np.zeros(1))[0]
    s = np.minimum(np.arange(300) / package.ramp, 1.0)[:, None]
    expected = s * s * (3.0 - 2.0 * s) * c - y @ np.array([[2.0], [0.1]])
    assert np.abs(run(package, y) - expected).max() < 1e-12


def test_modal_form_is_the_same_law_and_refuses_poles_that_coincide():
    law = random_law(np.random.default_rng(8), 9, 2, 2)
    dense = package_law(law, "law", form="dense").core
    modal = to_modal(dense)
    z = np.exp(2j * np.pi * np.linspace(0.01, 0.49, 50))[:, None, None]
    responses = [
        m.C @ np.linalg.solve(z * np.eye(9) - m.A, np.hstack([m.B, m.E])[None]) for m in (dense, modal)
    ]
    assert np.abs(responses[0] - responses[1]).max() < 1e-10 * np.abs(responses[0]).max()
    jordan = dataclasses.replace(dense, A=0.5 * np.eye(9) + np.eye(9, k=1))
    assert to_modal(jordan) is None
    assert package_law(twice(), "law").core.pairs is None
    with pytest.raises(ConfigError, match="nearly coincide"):
        package_law(twice(), "law", form="modal")


def twice() -> Compensator:
    """Two samples of delay in a row: a defective pole at zero."""
    shift = SampledStateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], period_s=0.01)
    return Compensator(shift, *ports(2, 1, 1))


def test_laws_of_other_programs():
    control = pytest.importorskip("control")
    a, b = [1.0, -1.5, 0.9], [0.2, 0.1, 0.05]
    y = np.random.default_rng(0).standard_normal((500, 1))
    expected = scipy.signal.lfilter(b, a, y[:, 0])
    for plant in (from_control(control.tf(b, a, 0.01)), from_scipy(scipy.signal.dlti(b, a, dt=0.01))):
        found = run(package_law(as_compensator(plant), "law"), y)[:, 0]
        assert np.abs(found - expected).max() < 1e-10
        turned = run(package_law(as_compensator(plant, negative_feedback=True), "law"), y)[:, 0]
        assert np.abs(turned + expected).max() < 1e-10


def test_laws_of_several_channels_of_other_programs():
    """State spaces of two inputs and three outputs; those of python-control keep the names of their ports."""
    control = pytest.importorskip("control")
    law = random_law(np.random.default_rng(3), 5, 2, 3, applied=False)
    s, y = law.sampled, np.random.default_rng(4).standard_normal((300, 2))
    expected = simulate(s, y, np.zeros(5))[0]
    reads, drives = ["angle", "rate"], ["x", "y", "z"]
    named = control.ss(s.A, s.B, s.C, s.D, PERIOD_S, inputs=reads, outputs=drives)
    for plant in (from_control(named), from_scipy(scipy.signal.dlti(s.A, s.B, s.C, s.D, dt=PERIOD_S))):
        package = package_law(as_compensator(plant), "law")
        assert np.abs(run(package, y) - expected).max() < 1e-11 * np.abs(expected).max()
        assert package.period_s == PERIOD_S
    package = package_law(as_compensator(from_control(named)), "law")
    assert [port.name for port in package.inputs + package.outputs] == reads + drives


def test_a_ratio_whose_coefficients_lose_its_poles_is_told_how_to_be_stated():
    """A narrow filter of order eight; by zeros and poles it is packed, and is SciPy's sections."""
    ratio, roots, sections = (
        scipy.signal.butter(4, [0.01, 0.02], "band", output=form) for form in ("ba", "zpk", "sos")
    )
    lossy, whole = (as_compensator(from_scipy(scipy.signal.dlti(*form, dt=0.002))) for form in (ratio, roots))
    with pytest.raises(ConfigError, match="may be unstable") as refused:
        package_law(lossy, "law")
    assert "zeros and poles" in refused.value.hint
    assert "authority" not in refused.value.hint
    package = package_law(whole, "law")
    y = np.random.default_rng(0).standard_normal((500, 1))
    expected = scipy.signal.sosfilt(sections, y[:, 0])
    assert np.abs(run(package, y)[:, 0] - expected).max() < 1e-10 * np.abs(expected).max()


def test_an_unstable_law_is_declared():
    grows = Compensator(
        SampledStateSpace([[1.001]], [[1.0]], [[1.0]], [[0.0]], period_s=0.01), *ports(1, 1, 1)
    )
    with pytest.raises(ConfigError, match=r"pole of magnitude 1\.001"):
        package_law(grows, "law")
    assert package_law(grows, "law", limit=1.0, unstable=True).unstable
    assert not package_law(random_law(np.random.default_rng(0), 4, 1, 1), "law", unstable=True).unstable


def test_the_largest_pole_of_a_modal_core_is_that_of_its_matrix():
    for states in (0, 1, 2, 7):
        core = package_law(random_law(np.random.default_rng(states), states, 1, 1), "law").core
        assert core.radius == pytest.approx(np.abs(np.linalg.eigvals(core.A)).max(initial=0.0), rel=1e-9)


def test_a_ramp_is_no_shorter_than_asked():
    law = random_law(np.random.default_rng(0), 2, 1, 1)
    period = law.period_s
    for asked, samples in ((0.0, 0), (1e-5, 1), (3.0 * period, 3), (3.2 * period, 4)):
        assert package_law(law, "law", ramp_s=asked).ramp == samples


def test_where_the_compensator_gives_no_number_the_inner_loop_stands_alone(tmp_path):
    """inf - inf of its two states; the inner loop and the limits still act, in the reference and in C."""
    A = np.diag([0.5, 0.5])
    law = Compensator(
        SampledStateSpace(A, 1e308 * np.ones((2, 1)), [[10.0, -10.0]], [[0.0]], period_s=0.01),
        *ports(1, 1, 1),
    )
    path = LoopPath(0, 0, Section(np.array([-0.25, 0.0, 0.0]), np.zeros(2)))
    package = add_test_vectors(
        dataclasses.replace(package_law(law, "law", limit=2.0, form="dense"), paths=(path,), vectors=None)
    )
    y = np.array([[3.0], [3.0], [1.0]])
    expected = run(package, y)
    assert expected[1:, 0].tolist() == [-0.75, -0.25]
    assert np.array_equal(compile_law(package, tmp_path)(y), expected)


def test_peaks_are_bounded_from_above_and_closely():
    rng = np.random.default_rng(9)
    for states in (1, 4, 9):
        F = random_law(rng, states, 1, 1, radii=(0.5, 0.995)).sampled.A
        G, H, J = (
            rng.standard_normal((states, 3)),
            rng.standard_normal((2, states)),
            rng.standard_normal((2, 3)),
        )
        truth, x = np.abs(J), G
        for _ in range(20_000):
            truth, x = truth + np.abs(H @ x), F @ x
        bound = bound_peaks(F, G, H, J)
        assert np.all(bound >= truth * (1.0 - 1e-12))
        assert np.all(bound <= 1.1 * truth)
    delay = np.eye(5, k=1)  # defective: no eigenvectors
    assert np.all(bound_peaks(delay, np.ones((5, 1)), np.ones((1, 5)), np.zeros((1, 1))) >= 15.0)
    block = 0.9 * np.eye(12) + np.eye(12, k=1)  # a Jordan block: the sum of its powers is known
    known = sum(10.0 ** (j + 1) for j in range(12))
    assert known <= bound_peaks(block, np.eye(12)[:, -1:], np.ones((1, 12)), np.zeros((1, 1)))[0, 0]
    line, into, out = np.eye(150, k=-1), np.eye(150)[:, :1], np.ones((1, 150))  # 150 delays: a FIR law
    assert 150.0 <= float(bound_peaks(line, into, out, np.zeros((1, 1)))[0, 0]) < 200.0
    line[0, -1] = 0.5  # fed back: each of 150 samples once, and half of them again
    assert 300.0 <= float(bound_peaks(line, into, out, np.zeros((1, 1)))[0, 0]) < 1000.0
    slow = np.array([[0.99999]])
    assert 1e5 <= float(bound_peaks(slow, np.eye(1), np.eye(1), np.zeros((1, 1)))[0, 0]) < 1.1e5


def test_limits_of_size_and_slew_at_once_act_as_written():
    """Of random laws with both, which learn what is applied, in a loop of its own."""
    both = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        law, limit = random_law(rng, 8, 2, 2, radii=(0.8, 0.99)), rng.uniform(0.05, 1.0, 2)
        step = limit * rng.uniform(0.05, 0.5, 2)
        reference = ReferenceLaw(
            package_law(law, "law", input_range=1.0, limit=limit, slew_rate=step / PERIOD_S)
        )
        s, x, last = law.sampled, np.zeros(8), np.zeros(2)
        slewed = sized = False
        for y in np.clip(rng.standard_normal((200, 2)), -1.0, 1.0):
            wanted = s.C @ x + s.D @ y
            within = last + np.clip(wanted - last, -step, step)
            u = np.clip(within, -limit, limit)
            assert reference.step(y) == pytest.approx(u, rel=1e-9, abs=1e-11)
            slewed, sized = slewed or bool(np.any(within != wanted)), sized or bool(np.any(u != within))
            x, last = s.A @ x + s.B @ y + law.applied @ (u - wanted), u
        both += slewed and sized
    assert both >= 6


@pytest.mark.parametrize("applied", [False, True])
def test_single_precision_stays_within_its_bound(applied, tmp_path):
    ratios = []
    for seed in seeds_of("single precision within its bound: laws"):
        rng = np.random.default_rng(seed)
        states, inputs, outputs = rng.integers(1, 16), rng.integers(1, 4), rng.integers(1, 3)
        law = random_law(rng, int(states), int(inputs), int(outputs), applied=applied, radii=(0.8, 0.998))
        limit = rng.choice([0.3, 30.0 if applied else np.inf])
        package = package_law(law, "law", input_range=rng.uniform(0.01, 1.0), limit=limit)
        single = to_single(package)
        worst = worst_error(package, single, 3000, tmp_path)
        assert np.all(worst <= single.error_bound)
        ratios += (single.error_bound / worst).tolist()
    assert np.median(ratios) < 100.0


def exact_run(package, y):
    """Commands in fractions, without rounding: the law as `ControllerPackage` defines it, from a reset on."""
    core, ramp = package.core, package.ramp
    A, B, C, D, E = (
        [[Fraction(v) for v in row] for row in M.tolist()] for M in (core.A, core.B, core.C, core.D, core.E)
    )
    low, high = package.lower.tolist(), package.upper.tolist()
    x, outputs = [Fraction(0)] * len(A), []

    def times(M, v):
        return [sum((a * b for a, b in zip(row, v, strict=True)), Fraction(0)) for row in M]

    for k, row in enumerate(y.tolist()):
        r = [Fraction(v) for v in row]
        part = Fraction(min(k, ramp), ramp) if ramp else Fraction(1)
        wanted = [c + d for c, d in zip(times(C, x), times(D, r), strict=True)]
        fade = part * part * (3 - 2 * part)
        u = [Fraction(min(max(fade * w, a), b)) for w, a, b in zip(wanted, low, high, strict=True)]
        missing = [a - w for a, w in zip(u, wanted, strict=True)]
        x = [sum(terms) for terms in zip(times(A, x), times(B, r), times(E, missing), strict=True)]
        outputs.append(u)
    return outputs


NUMBERS = "ABCDE"


def cut_to(single, signs):
    """A law in double precision almost half a unit away from every number of ``single``."""
    moved = {
        name: M + 0.499 * signs[name] * np.spacing(np.abs(M).astype(np.float32)) * (M != 0.0)
        for name, M in ((name, getattr(single.core, name)) for name in NUMBERS)
    }
    return dataclasses.replace(
        single, core=dataclasses.replace(single.core, **moved), single=False, error_bound=None,
        error_bound_own=False, vectors=None,
    )  # fmt: skip


def farthest_cut(single, y):
    """That of these laws whose last command for ``y`` is farthest from that of ``single``: by differences."""
    signs = {name: np.zeros_like(getattr(single.core, name)) for name in NUMBERS}
    plain = run(cut_to(single, signs), y)[-1, 0]
    for name, found in list(signs.items()):
        one = np.zeros_like(found)
        for place in np.ndindex(one.shape):
            one[place] = 1e3
            found[place] = np.sign(run(cut_to(single, {**signs, name: one}), y)[-1, 0] - plain)
            one[place] = 0.0
    return cut_to(single, signs)


@pytest.mark.parametrize("touched", [False, True], ids=["own commands", "ramp and limits that act"])
def test_the_bound_holds_in_exact_arithmetic_with_all_that_is_cut_from_coefficients(touched):
    """For laws whose numbers lie half a unit from what they are cut to, under the worst inputs found."""
    ratios = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        law = random_law(rng, 2 + seed % 2, 2, 1, applied=touched, radii=(0.6, 0.9))
        package = package_law(law, "law", input_range=0.5, limit=np.inf)
        y = 0.5 * next(worst_signs(package, 30))[:, :2]
        if touched:
            limit = 0.5 * np.abs(run(package, y)).max()
            package = package_law(law, "law", input_range=0.5, limit=limit, ramp_s=15 * PERIOD_S)
        single, reach = to_single(package), 0.22 if touched else 0.5
        package = farthest_cut(single, reach * np.sign(y))
        y = 0.5 * next(worst_signs(package, 30))[:, :2]
        again = to_single(package).core
        assert all(np.array_equal(getattr(again, name), getattr(single.core, name)) for name in NUMBERS)
        errors, limited = [0.0], 0
        for part in (1.0, 2.0 * reach):
            given = (part * y).astype(np.float32).astype(float)
            u = run(single, given)
            limited += bool(np.any(np.abs(u) == single.upper))
            exact = np.ravel(exact_run(package, given))
            errors += [float(abs(a - Fraction(b))) for a, b in zip(exact, u.ravel().tolist(), strict=True)]
        assert limited == touched
        ratios.append(float(single.error_bound[0]) / max(errors))
    assert min(ratios) >= 1.0
    assert max(ratios) < 25.0


def test_the_bound_in_single_precision_holds_for_commands_that_others_add(tmp_path):
    """A slow estimate that almost nothing but the applied command moves."""
    slow = SampledStateSpace([[0.99973]], [[1e-4]], [[0.7]], [[0.0]], period_s=PERIOD_S)
    law = Compensator(slow, *ports(1, 1, 1), applied=np.array([[1e-4]]))
    package = package_law(law, "law", input_range=1e-3, limit=5.0)
    single = to_single(package)
    worst = worst_error(package, single, 30_000, tmp_path)
    assert np.all((single.error_bound / 100.0 < worst) & (worst <= single.error_bound))


def winding_law():
    """Errors grow under limits."""
    law = random_law(np.random.default_rng(1), 12, 3, 2, radii=(0.8, 0.998))
    return dataclasses.replace(law, applied=15.0 * law.applied)


def test_a_bound_for_own_commands_asks_that_no_limit_or_fade_touches_them(tmp_path):
    """Of this law errors grow under limits, which its inputs do not let it reach."""
    law = winding_law()
    package = package_law(law, "law", input_range=0.01, limit=30.0)
    single = to_single(package)
    assert bound_error(package).own
    assert single.error_bound_own
    worst = worst_error(package, single, 3000, tmp_path)
    assert np.all((single.error_bound / 100.0 < worst) & (worst <= single.error_bound))
    assert check_error_bound(single).said.endswith(OWN_COMMANDS)
    boast = check_error_bound(dataclasses.replace(single, error_bound_own=False))
    assert not boast.passed
    assert "for its own commands only" in boast.said
    faded = check_error_bound(single, "the rig's engine")
    assert not faded.passed
    assert faded.said.endswith("for its own commands applied in full, and the rig's engine fades them")
    for touched in ({"limit": 0.3}, {"limit": 30.0, "ramp_s": 1.0}):
        with pytest.raises(ConfigError, match=r"may amplify|no peak is bounded"):
            to_single(package_law(law, "law", input_range=0.01, **touched))


@pytest.mark.parametrize("learns", [True, False], ids=["own commands", "ramp and limits that act"])
def test_a_law_of_the_study_stays_within_its_bound(learns, tmp_path):
    """The one of most authority; whatever is applied, if it does not learn that."""
    package = package_law(study_law(2.0), "law", input_range=0.02, limit=5.0)
    if not learns:
        package = without_applied(package_law(study_law(2.0), "law", input_range=0.02, limit=0.3, ramp_s=0.5))
        y = 0.02 * next(worst_signs(package, 5000))[:, :14]
        assert np.abs(compile_law(package, tmp_path)(y)).max() == 0.3
    single = to_single(package)
    assert single.error_bound_own == learns
    worst = worst_error(package, single, 5000, tmp_path)
    assert np.all(worst <= single.error_bound)
    assert np.median(single.error_bound / worst) < 100.0


LEVELS = [(1.0, False), (-1.5, True), (0.0, True), (0.5, False), (2.0, True), (2.0, False)]


@pytest.mark.parametrize(("level", "learns"), repeats([(None, False), (None, True), *LEVELS], 2))
def test_a_bound_that_is_stated_a_twentieth_too_small_is_refused(level, learns):
    """At every other output; what the others state is what was proved. Of laws of the study in the long form.

    They last a second each; the small ones lose as much by their coefficients.
    """
    law, reach, limit = (winding_law(), 0.01, 30.0) if level is None else (study_law(level), 0.02, 5.0)
    law = law if learns else dataclasses.replace(law, applied=None)
    single = to_single(package_law(law, "law", input_range=reach, limit=limit))
    assert single.error_bound_own == learns
    less = np.resize([False, True], len(single.outputs))
    boast = check_error_bound(
        dataclasses.replace(single, error_bound=np.where(less, 0.95, 1.0) * single.error_bound)
    )
    assert not boast.passed
    assert [port.name in boast.said for port in single.outputs] == less.tolist()


def told_of(package):
    """What the comment at the head of the C says of the ranges, on one line."""
    text = " ".join(generate_c(package, "law").header.split("Reads (")[0].replace(" *", " ").split())
    return text[text.index("Hz).") + 5 :]


def test_the_header_says_first_under_which_condition_nothing_overflows():
    """In both precisions; a law whose own poles are inside while its observer's are not, and the reverse."""
    lag, given = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], period_s=0.01), {"input_range": 1.0}
    law = Compensator(lag, *ports(1, 1, 1))
    winding, steady = (dataclasses.replace(law, applied=np.array([[e]])) for e in (-0.8, 0.1))
    grows = dataclasses.replace(law, dynamics=dataclasses.replace(lag, A=[[1.1]]), applied=np.array([[0.9]]))
    whatever, own = (
        f"{text.capitalize()}, no operation overflows or gives NaN" for text in (ANYTHING, OWN_COMMANDS)
    )
    unknown = "That no operation overflows within the ranges is not known."
    for told, package in (
        (f"{whatever}.", package_law(law, "law", **given)),
        (f"{whatever}.", package_law(steady, "law", limit=3.0, **given)),
        (f"{whatever}.", package_law(grows, "law", limit=3.0, unstable=True, **given)),
        (f"{own}.", package_law(winding, "law", limit=3.0, **given)),
        (f"{own}.", package_law(steady, "law", **given)),
        (unknown, package_law(law, "law")),
        (unknown, package_law(grows, "law", unstable=True, **given)),
    ):
        assert told_of(package) == told
    for told, learns in ((whatever, law), (whatever, steady), (own, winding)):
        single = to_single(package_law(learns, "law", limit=3.0, **given))
        bound = f"{single.error_bound[0]:.3g}"
        assert (
            told_of(single)
            == f"{told}, and outputs differ from those in double precision by at most {bound}."
        )


def largest_operand(package, y, applied):
    """The largest number of states and commands that the law computes."""
    law, found = ReferenceLaw(package), np.zeros(1)
    for row, other in zip(y, applied, strict=True):
        u = law.compute(row)
        found = np.concatenate([found, np.abs(law.wanted), np.abs(law.next)]).max(keepdims=True)
        law.commit(u if np.isnan(other) else np.array([other]))
    return float(found[0])


def test_a_bound_that_adds_up_no_samples_keeps_none():
    """For 200 states they were 40 MB, for the largest law 2 GB."""
    F = 0.9 * np.linalg.qr(np.random.default_rng(0).standard_normal((200, 200)))[0]
    tracemalloc.start()
    bound = bound_peaks(F, np.eye(200)[:, :1], np.tile(np.eye(200), (2, 1)), np.zeros((400, 1)), most=0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6
    impulse, truth = np.eye(200)[:, 0], np.zeros(200)
    for _ in range(400):
        truth, impulse = truth + np.abs(impulse), F @ impulse
    assert np.all(bound[:200, 0] >= truth)


def test_an_output_that_no_input_reaches_asks_for_no_longer_vectors():
    """A state that nothing drives, one behind a filter that gives nothing: they stand still for good."""
    still = SampledStateSpace(np.diag([0.5, 0.4]), [[1.0], [0.0]], np.eye(2), np.zeros((2, 1)), period_s=0.01)
    law = Compensator(still, *ports(1, 1, 2))
    mute = InputFilter(0, Section(np.zeros(3), np.zeros(2)))
    for filters, moving in (((), [True, False]), ((mute,), [False, False])):
        package = package_law(law, "law", filters=filters)
        assert (len(package.vectors.y), package.vectors.u.any(axis=0).tolist()) == (48, moving)
        assert check_vectors(package).passed


@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
def test_nothing_overflows_in_a_law_of_long_delays(single):
    """A mean of 100 samples: no eigenvectors, and its states contract only all together."""
    B, C = np.eye(100)[:, :1], np.full((1, 100), 0.01)
    mean = SampledStateSpace(np.eye(100, k=-1), B, C, [[0.0]], period_s=0.01)
    package = package_law(Compensator(mean, *ports(1, 1, 1)), "mean", input_range=2.0, limit=3.0)
    late = dataclasses.replace(mean, C=np.eye(100)[-1:])  # the first output comes after 100 samples
    assert (
        len(package_law(Compensator(late, *ports(1, 1, 1)), "late").vectors.y) > 100 > len(package.vectors.y)
    )
    package = to_single(package) if single else package
    assert check_error_bound(package).passed
    given = np.full((120, 1), 2.0)
    error = max(abs(float(out) - min(k, 100) / 50.0) for k, out in enumerate(run(package, given).ravel()))
    assert error <= (float(package.error_bound[0]) if single else 1e-14)


def test_a_slew_limit_in_single_precision_is_refused_whoever_states_a_bound():
    """Its steps round alike: what a package without it states is exceeded four times."""
    lag = SampledStateSpace([[0.5]], [[1.0]], [[0.1]], [[0.0]], period_s=0.01)
    single = to_single(package_law(Compensator(lag, *ports(1, 1, 1)), "lag", input_range=1.0, limit=5.0))
    assert check_error_bound(single).passed
    slow = dataclasses.replace(single, slew=np.array([float(np.float32(1e-4))]), vectors=None)
    double = dataclasses.replace(slow, single=False, error_bound=None)
    y = np.ones((1500, 1))
    assert np.abs(run(slow, y) - run(double, y)).max() > 4.0 * single.error_bound[0]
    step = check_error_bound(slow)
    assert not step.passed
    assert step.said.startswith("a slew limit in single precision")


@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("where", ["D", "B", "E"])
def test_a_law_of_which_an_operation_overflows_within_its_ranges_is_refused(where, single):
    """At once, in a state, or by what is applied; beside one that is smaller and keeps its numbers finite."""
    rng, y, none = np.random.default_rng(0), np.full((400, 1), 3.0), np.full(400, np.nan)
    law = random_law(rng, 3, 1, 1, applied=where == "E", radii=(0.9, 0.95))
    package = package_law(law, "law", input_range=3.0, limit=5e3)
    package = to_single(package) if single else package
    applied = np.where(np.arange(400) % 2 == 0, 5e3, -5e3) if where == "E" else none
    top = 2.0**127 if single else 2.0**1023
    for size, finite in ((2.0**-10 if where == "E" else top * 2.0**-90, True), (top, False)):
        number = getattr(package.core, where)
        core = dataclasses.replace(package.core, **{where: size * np.sign(number)})
        loud = dataclasses.replace(package, core=core, vectors=None)
        loud = dataclasses.replace(loud, error_bound=np.array([1e300])) if single else loud
        assert np.isfinite(largest_operand(loud, y, applied)) == finite
        assert check_error_bound(loud).passed == finite
        assert bool(when_nothing_overflows(loud)) == (finite or single)  # the bound is what knows


def test_a_range_of_the_largest_numbers_has_test_vectors(tmp_path):
    """Twice the range, which is cut, is no number any more: its end stands for it."""
    law = random_law(np.random.default_rng(0), 3, 2, 2)
    package = package_law(law, "law", input_range=1.5e308, limit=1.0)
    assert np.abs(package.vectors.y).max() == np.finfo(float).max
    assert replay(package, tmp_path) == 0


def test_what_has_no_bound_is_refused():
    law = random_law(np.random.default_rng(0), 4, 1, 1)
    with pytest.raises(ConfigError, match="has no range"):
        to_single(package_law(law, "law"))
    with pytest.raises(ConfigError, match="slew limit"):
        to_single(package_law(law, "law", input_range=1.0, slew_rate=1.0))
    with pytest.raises(ConfigError, match="already"):
        to_single(to_single(package_law(law, "law", input_range=1.0, limit=1.0)))
    with pytest.raises(ConfigError, match="what is applied has no limit"):
        to_single(package_law(law, "law", input_range=1.0))
    loud = dataclasses.replace(law, applied=5.0 * np.ones((4, 1)))
    with pytest.raises(ConfigError, match=r"may amplify|no peak is bounded"):
        to_single(package_law(loud, "law", input_range=1.0, limit=0.1))
    with pytest.raises(ConfigError, match="overflows"):
        to_single(package_law(law, "law", input_range=1e37, limit=1.0))
    s = law.sampled
    for huge in (1e300, 1e31):  # beyond single precision; and beyond what sums may reach
        loud = SampledStateSpace(s.A, s.B, s.C, [[huge]], period_s=s.period_s)
        with pytest.raises(ConfigError, match="overflows"):
            to_single(package_law(Compensator(loud, law.inputs, law.outputs), "law", input_range=1.0))
    extreme = SampledStateSpace(s.A, 1e300 * s.B, s.C / 1e300, s.D, period_s=s.period_s)
    to_single(package_law(Compensator(extreme, law.inputs, law.outputs), "law", input_range=1.0))
    with pytest.raises(ConfigError, match="the path of applied commands"):
        without_applied(to_single(package_law(law, "law", input_range=1.0, limit=1e3)))
    grows = random_law(np.random.default_rng(0), 2, 1, 1, radii=(1.01, 1.02))
    with pytest.raises(ConfigError, match="unstable law"):
        to_single(package_law(grows, "law", input_range=1.0, limit=1.0, unstable=True))
    slow = Compensator(
        SampledStateSpace([[1.0 - 1e-7]], [[1.0]], [[1.0]], [[0.0]], period_s=0.01), *ports(1, 1, 1)
    )
    with pytest.raises(ConfigError, match="rounding may change"):
        to_single(package_law(slow, "law", input_range=1.0))


def test_the_published_law_of_a_measured_beam(tmp_path):
    """Takacs and Rohal-Ilkiv 2012, their design model: u = -K x, x+ = A x + B u + M (y - C x)."""
    A = np.array([[0.867074264700783, 1.118487994649831], [-0.214184972531195, 0.869746240894636]])
    B = np.array([[0.933601028678616e-3], [0.530974425107969e-3]])
    C = np.array([[-0.552612993066737, 0.705187130687643]])
    M = np.array([[-4.336938056233941], [-0.354380105600932]])
    K = np.array([[12.967150796211348, 125.5047671231475]])
    law = Compensator(
        SampledStateSpace(A - B @ K - M @ C, M, -K, np.zeros((1, 1)), period_s=0.01),
        (Port("tip", "mm"),), (Port("voltage", "V"),), applied=B,
    )  # fmt: skip
    unstable = bool(np.abs(np.linalg.eigvals(law.sampled.A)).max() >= 1.0)
    for form in ("dense", "auto"):
        package = package_law(law, "takacs", input_range=15.0, limit=120.0, form=form, unstable=unstable)
        reference = ReferenceLaw(package)
        x, estimate, worst, held = np.array([8.0, 3.0]), np.zeros(2), 0.0, 0
        for _ in range(2000):
            y = C @ x
            v = np.clip(-K @ estimate, -120.0, 120.0)
            held += int(abs(v[0]) == 120.0)
            u = reference.step(y)
            worst = max(worst, float(np.abs(u - v).max()))
            estimate = A @ estimate + B @ v + M @ (y - C @ estimate)
            x = A @ x + B @ u
        assert worst < 1e-12 * 120.0
        assert held > 3
        assert np.abs(x).max() < 1e-3
