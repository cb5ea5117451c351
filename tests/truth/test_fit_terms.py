"""The evaluation behind the fit: derivatives, spectra of experiments and transients against exact motion."""

import dataclasses

import numpy as np
import pytest

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data, Transient
from middeck.identification.problem.gram_blocks import Functions, weigh
from middeck.identification.problem.normal_equations import Solved, solve_normal
from middeck.identification.problem.residual_and_slopes import build_terms, residual_of
from middeck.identification.problem.unknowns_layout import Layout, Point, pack
from middeck.identification.search.least_squares_costs import _by_columns, weighted


def a_layout(*, imag=0.0, rigid_pivot=(), integral_pivot=(), **options):
    return Layout(
        pair=np.array([True, True, False]),
        fixed_imag=np.array([0.0, 0.0, imag]),
        pivot=np.array([0, 1, 0]),
        inputs=2,
        outputs=2,
        options=FitOptions(**{"constants": "complex", "delay": True, "direct": True} | options),
        rigid_pivot=rigid_pivot,
        integral_pivot=integral_pivot,
    )


def a_problem(layout, experiments=3, transient=None, seed=0):
    rng = np.random.default_rng(seed)
    s = 2j * np.pi * np.linspace(0.5, 9.0, 40)

    def noise(*shape):
        return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)

    drive = None if experiments is None else noise(40, 2, experiments)
    H = noise(2, 40, experiments or 2)
    b = noise(3, 2)
    b = b / b[np.arange(3), layout.pivot][:, None]
    b = b if not layout.options.real_constants else b.real
    b[2] = np.real(b[2])
    poles = np.array([-0.5 + 12j, -1.0 + 30j, -4.0 + 1j * layout.fixed_imag[2]])
    delay_s = np.array([[0.01, 0.015], [0.02, 0.03]])[:, : max(layout.delays[1], 1)] * any(layout.delays)
    psi = np.array([[0.7, 1.0], [1.0, -0.4]])[: len(layout.powers)]
    point = Point(poles, b, delay_s, psi)
    return Data(s=s, H=H, weight=1.0 + rng.random(H.shape), drive=drive, transient=transient), pack(
        layout, point
    )


EDGES = Transient(0.04, first=2, last=1)
PATH, COMMON = {"delay": "path"}, {"delay": "common"}
TWO = {"direct": False, "relative_degree": 2}
CASES = {
    "delays of paths": (a_layout(**PATH), None, None),
    "delays of paths, drive": (a_layout(**PATH), 3, EDGES),
    "one delay": (a_layout(**COMMON), None, None),
    "one delay, drive": (a_layout(**COMMON), 3, None),
    "any residues": (a_layout(full_rank=True), None, None),
    "any residues, drive": (a_layout(full_rank=True, **PATH), 3, EDGES),
    "any real residues": (a_layout(full_rank=True, constants="real"), None, None),
    "rigid": (a_layout(rigid_pivot=(1,)), None, None),
    "rigid, drive": (a_layout(rigid_pivot=(1,)), 3, EDGES),
    "integrator": (a_layout(integral_pivot=(1,)), None, None),
    "integrator, drive": (a_layout(integral_pivot=(1,)), 3, EDGES),
    "rigid and integrator": (a_layout(rigid_pivot=(1,), integral_pivot=(0,)), None, None),
    "relative degree two": (a_layout(**TWO), None, None),
    "relative degree two, drive": (a_layout(**TWO), 3, EDGES),
    "relative degree two, any residues": (a_layout(full_rank=True, **TWO), None, None),
    "relative degree two, real constants": (a_layout(constants="real", **TWO), None, None),
    "response": (a_layout(), None, None),
    "response, real constants": (a_layout(constants="real", residuals=True), None, None),
    "drive": (a_layout(), 3, None),
    "drive, real constants": (a_layout(constants="real", residuals=True), 3, None),
    "drive, sampled": (a_layout(sample_hz=25.0, delay=False, imag=np.pi / 0.04), 3, None),
    "transient": (a_layout(), 3, EDGES),
    "transient, drift": (a_layout(constants="real", residuals=True), 3, EDGES),
    "transient, sampled": (a_layout(sample_hz=25.0, delay=False, imag=np.pi / 0.04), 3, Transient(0.04)),
}
case = pytest.mark.parametrize(("layout", "experiments", "transient"), CASES.values(), ids=CASES)


def differences(function, x, step):
    """Central differences along every entry, first axis."""
    return np.array([(function(x + d) - function(x - d)) / (2.0 * step) for d in step * np.eye(len(x))])


def jacobian(layout, data, theta, linear):
    """Derivative of E [unknown, output, line, column] by all unknowns: theta, then each output's linear ones.

    Transients come last. Each as if free: where linear unknowns are tied, their rows are still there.
    """
    terms = build_terms(layout, data, theta)
    shared, each = len(theta), linear.shape[1]
    J = np.zeros((shared + linear.size, *data.H.shape), dtype=complex)
    transients = np.einsum("ql,ek->eqlk", terms.B, np.eye(data.H.shape[2])).reshape(-1, *data.H.shape[1:])
    for o in range(layout.outputs):
        own = slice(shared + o * each, shared + (o + 1) * each)
        J[:shared, o] = terms.slopes(linear[o], o)
        J[own, o] = np.concatenate([terms.columns(o), transients])
    return J


@case
def test_jacobian_by_all_unknowns(layout, experiments, transient):
    data, theta = a_problem(layout, experiments, transient)
    linear = np.random.default_rng(1).standard_normal(weighted(layout, data, theta).linear.shape)

    def model(unknowns):
        return -residual_of(
            layout, data, unknowns[: len(theta)], unknowns[len(theta) :].reshape(linear.shape)
        )

    found = jacobian(layout, data, theta, linear)
    expected = differences(model, np.concatenate([theta, linear.ravel()]), 1e-6)
    # Central differences of a model of order 10: rounding 1e-9, curvature 1e-11.
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    assert len(theta) == layout.size


@case
def test_gradient_of_the_projected_cost(layout, experiments, transient):
    data, theta = a_problem(layout, experiments, transient)
    step = weighted(layout, data, theta)
    expected = differences(lambda x: weighted(layout, data, x).cost, theta, 1e-6)
    # Central differences of a cost near 100 with a step of 1e-6: rounding 1e-8, curvature 1e-8 or less.
    np.testing.assert_allclose(step.gradient, expected, atol=1e-6 * np.abs(expected).max() + 1e-6)
    r = residual_of(layout, data, theta, step.linear) * data.weight
    # Rounding: the cost of the projection is that of the unknowns it returns.
    assert step.cost == pytest.approx(0.5 * np.sum(np.abs(r) ** 2), rel=1e-11)


def test_transients_are_solved_for_with_the_model():
    """Projecting them out column by column is one least-squares problem in all unknowns."""
    data, theta = a_problem(a_layout(), 3, EDGES)
    step = weighted(a_layout(), data, theta)
    J = jacobian(a_layout(), data, theta, step.linear)[len(theta) :]
    for o, each in enumerate(np.split(J, 2)):
        A = (each[:, o] * data.weight[o]).reshape(len(each), -1).view(float)
        x = np.linalg.lstsq(A.T, (data.H[o] * data.weight[o]).ravel().view(float), rcond=None)[0]
        # Rounding times a condition below 1e3.
        np.testing.assert_allclose(step.linear[o], x, rtol=1e-10, atol=1e-10)


POLES = np.array([-0.4 + 15.0j, -0.9 + 43.0j])


def free_motion(t, amplitude):
    return np.where(t >= 0.0, 2.0 * np.real(amplitude @ np.exp(np.multiply.outer(POLES, t))), 0.0)


def steady_motion(t, hz, U, residue):
    """Response to sum 2 Re U exp(2 pi j f t) of residues at POLES, and that input."""
    s = 2j * np.pi * hz
    G = np.sum(
        residue[:, None] / (s - POLES[:, None]) + residue.conj()[:, None] / (s - POLES.conj()[:, None]), 0
    )
    wave = np.exp(np.multiply.outer(t, s))
    return 2.0 * np.real(wave @ (G * U)), 2.0 * np.real(wave @ U), G


@pytest.mark.parametrize(("delay_s", "first"), [(0.0, 0), (0.023, 3)])
def test_a_record_that_starts_in_motion_is_exact(delay_s, first):
    """A periodic input over free motion, seen late: sampled at 100 Hz, of continuous modes, to rounding."""
    rng = np.random.default_rng(5)
    N, T = 512, 0.01
    n = np.arange(N)
    hz = np.arange(1, 120) / (N * T)
    residue, amplitude = np.array([0.6 - 2.0j, -1.1 + 0.4j]), np.array([1.0 + 0.7j, -0.3 + 2.0j])
    U = rng.standard_normal(len(hz)) + 1j * rng.standard_normal(len(hz))
    y, _, _ = steady_motion(n * T - delay_s, hz, U, residue)
    y = y + free_motion(n * T - delay_s, amplitude)
    # What answers to an input before the record is anything at all.
    y[:first] += 10.0 * rng.standard_normal(first)
    Y = np.fft.fft(y)[1 : len(hz) + 1] / N
    layout = Layout(
        pair=np.array([True, True]),
        fixed_imag=np.zeros(2),
        pivot=np.zeros(2, dtype=int),
        inputs=1,
        outputs=1,
        options=FitOptions(constants="complex", delay=bool(delay_s)),
    )
    theta = pack(layout, Point(POLES, np.ones((2, 1)), np.array([[delay_s]])))
    data = Data(
        s=2j * np.pi * hz,
        H=Y[None, :, None],
        weight=np.ones((1, len(hz), 1)),
        drive=U[:, None, None],
        transient=Transient(T, first),
    )
    step = weighted(layout, data, theta)
    r = residual_of(layout, data, theta, step.linear)
    # Rounding of transforms of 512 samples and of their least squares.
    assert np.abs(r).max() < 1e-12 * np.abs(Y).max()
    np.testing.assert_allclose(step.linear[0, :4], [0.6, -2.0, -1.1, 0.4], rtol=1e-10)


def test_a_held_input_of_any_kind_is_exact():
    """A sampled model driven by noise that is not periodic: the transient with its poles leaves rounding."""
    rng = np.random.default_rng(6)
    N, T = 300, 0.01
    z, c = np.exp(POLES * T), np.array([0.6 - 2.0j, -1.1 + 0.4j])
    u, x, y = rng.standard_normal(N), np.array([1.0 + 2.0j, -3.0]), np.zeros(N)
    for n in range(N):
        y[n] = 2.0 * np.real(c @ x) + 0.3 * u[n]
        x = z * x + u[n]
    U, Y = (np.fft.rfft(v)[1:-1] for v in (u, y))
    s = 2j * np.pi * np.fft.rfftfreq(N, T)[1:-1]
    layout = Layout(
        pair=np.array([True, True]),
        fixed_imag=np.zeros(2),
        pivot=np.zeros(2, dtype=int),
        inputs=1,
        outputs=1,
        options=FitOptions(constants="complex", direct=True, sample_hz=1.0 / T),
    )
    theta = pack(layout, Point(POLES, np.ones((2, 1)), np.zeros((1, 1))))
    data = Data(
        s=s,
        H=Y[None, :, None],
        weight=np.ones((1, len(s), 1)),
        drive=U[:, None, None],
        transient=Transient(T),
    )
    step = weighted(layout, data, theta)
    # Rounding of the recursion and of the transform.
    assert np.abs(residual_of(layout, data, theta, step.linear)).max() < 1e-11 * np.abs(Y).max()
    np.testing.assert_allclose(step.linear[0, :5], [0.6, -2.0, -1.1, 0.4, 0.3], rtol=1e-9)


def summed(each):
    """Several outputs as one: what they say of theta is added."""
    return Solved(
        linear=np.concatenate([one.linear for one in each]),
        cost=sum(one.cost for one in each),
        gradient=sum(one.gradient for one in each),
        gram=sum(one.gram for one in each),
    )


@pytest.mark.parametrize("from_sums", [True, False], ids=["from sums", "line by line"])
@pytest.mark.parametrize("alike", [True, False], ids=["one weight", "weights of inputs"])
@case
def test_normal_equations_are_those_of_qr(layout, experiments, transient, alike, from_sums):
    data, theta = a_problem(layout, experiments)
    if alike:
        data = dataclasses.replace(data, weight=np.repeat(data.weight[:, :, :1], data.H.shape[2], axis=2))
    terms = build_terms(layout, data, theta)
    shared = Functions(terms, from_sums=from_sums)
    measured = weigh(terms, shared)
    found = [solve_normal(terms, shared, of) for of in measured]
    assert [one.linear.shape[0] for one in found] == ([2] if data.drive is None else [1, 1])
    each = [_by_columns(terms, o).solved(terms) for o in range(2)]
    for fast, exact in zip(found, [summed(each)] if data.drive is None else each, strict=True):
        # Conditions of 1e2 to 1e4: corrected once, the solution is good to rounding times that.
        np.testing.assert_allclose(fast.linear, exact.linear, rtol=1e-9, atol=1e-10)
        assert fast.cost == pytest.approx(exact.cost, rel=1e-13)
        scale = np.sqrt(2.0 * exact.cost * np.diag(exact.gram))
        assert (np.abs(fast.gradient - exact.gradient) <= 1e-11 * scale).all()
        size = np.sqrt(np.maximum(np.diag(exact.gram), 1e-300))
        # The squared condition's share of rounding.
        assert (np.abs(fast.gram - exact.gram) <= 1e-7 * size[:, None] * size).all()


def test_a_coincident_pole_is_left_to_qr():
    layout = a_layout(full_rank=True)
    data, theta = a_problem(layout, None)
    theta = theta.copy()
    theta[1], theta[4] = theta[0] + 1e-9, theta[3] + 1e-9
    terms = build_terms(layout, data, theta)
    shared = Functions(terms)
    assert solve_normal(terms, shared, weigh(terms, shared)[0]) is None
    assert weighted(layout, data, theta) is not None


@case
def test_mixed_outputs_are_solved_for_together(layout, experiments, transient):
    """Against one dense least-squares problem of all outputs, and differences of its cost."""
    data, theta = a_problem(layout, experiments)
    rng = np.random.default_rng(3)
    mix = np.eye(2) + 0.3 * (rng.standard_normal((40, 2, 2)) + 1j * rng.standard_normal((40, 2, 2)))
    data = dataclasses.replace(data, mix=mix)
    step = weighted(layout, data, theta)
    r = np.einsum("lqo,olk->qlk", mix, residual_of(layout, data, theta, step.linear)) * data.weight
    assert step.cost == pytest.approx(0.5 * np.sum(np.abs(r) ** 2), rel=1e-11)
    expected = differences(lambda x: weighted(layout, data, x).cost, theta, 1e-6)
    # As for `test_gradient_of_the_projected_cost`; a least cost has no slope by the linear unknowns either.
    np.testing.assert_allclose(step.gradient, expected, atol=1e-6 * np.abs(expected).max() + 1e-6)
    J = jacobian(layout, data, theta, step.linear)
    by = np.einsum("lqo,nolk->nqlk", mix, J) * data.weight
    slope = np.real(np.sum(by[len(theta) :].conj() * r, axis=(1, 2, 3)))
    if layout.options.zero_sum:
        return
    size = np.sqrt(np.sum(np.abs(by[len(theta) :]) ** 2, axis=(1, 2, 3)) * np.sum(np.abs(r) ** 2))
    assert (np.abs(slope) <= 1e-11 * size).all()
