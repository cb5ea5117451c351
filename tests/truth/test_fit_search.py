"""A search does not end where rounding of its normal equations says that nothing is to be gained."""

import functools

import numpy as np
import pytest

from middeck.identification.levenberg_marquardt import SMALLEST_GAIN, Step, is_positive, search
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data
from middeck.identification.problem.gram_blocks import Functions
from middeck.identification.problem.residual_and_slopes import build_terms
from middeck.identification.problem.unknowns_layout import Layout, Point, pack
from middeck.identification.search.least_squares_costs import by_normal_equations, least_cost, weighted

CURVATURE = np.array([[2.0, 1.0], [1.0, 3.0]])
# The same with a product that rounding has made larger than both lengths allow.
NO_GRAM = np.array([[2.0, -9.0], [-9.0, 3.0]])


def a_bowl(gram):
    def evaluate(x, _below):
        return Step(
            cost=0.5 * float(x @ CURVATURE @ x), gradient=CURVATURE @ x, gram=gram, linear=np.zeros((1, 0))
        )

    return evaluate


@pytest.mark.parametrize("start", [(3.0, -2.0), (1.0, 1.0), (0.1, 5.0)])
def test_an_indefinite_gram_is_formed_again_and_never_the_end(start):
    again = search(a_bowl(NO_GRAM), np.array(start), exactly=a_bowl(CURVATURE))
    assert again.converged
    # The last step promised less than this, and on a bowl the undamped one keeps its word.
    assert again.step.cost <= 2.0 * SMALLEST_GAIN
    alone = search(a_bowl(NO_GRAM), np.array(start), 40)
    assert not alone.converged


def test_what_is_not_finite_is_no_convergence():
    def evaluate(x, _below):
        return Step(cost=1.0, gradient=np.full(2, np.nan), gram=CURVATURE, linear=np.zeros((1, 0)))

    assert not search(evaluate, np.ones(2), 10).converged
    assert not is_positive(np.full((2, 2), np.nan))


def damped_low_modes(seed, *, decades):
    """Modes of 30 to 90 % damping in the lowest lines, falling noise: the heavy lines are far from them."""
    rng = np.random.default_rng(seed)
    hz, zeta = np.array([0.05, 0.12, 0.2, 10.0, 20.0, 30.0]), np.array([0.9, 0.5, 0.3, 0.01, 0.01, 0.01])
    omega, f = 2.0 * np.pi * hz, np.geomspace(0.1, 1000.0, 1500)
    poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    s, delay_s = 2j * np.pi * f, 0.003
    b, c = np.stack([np.ones(6), rng.standard_normal(6)], axis=1), rng.standard_normal((2, 6))
    modes = np.abs(poles) ** 2 / ((s[:, None] - poles) * (s[:, None] - poles.conj()))
    H = np.einsum("on,kn,ni->oki", c, modes, b) * np.exp(-s * delay_s)[:, None]
    size = 1e-4 * np.sqrt(np.mean(np.abs(H) ** 2)) * (f / f[0]) ** -decades
    H = H + size[:, None] * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape))
    options = FitOptions(constants="real", delay=True)
    layout = Layout(
        pair=np.ones(6, bool),
        fixed_imag=np.zeros(6),
        pivot=np.zeros(6, int),
        inputs=2,
        outputs=2,
        options=options,
    )
    theta = pack(layout, Point(poles, b, np.full((2, 1), delay_s), np.zeros((0, 2))))
    away = np.r_[np.ones(6), np.full(6, 0.003), np.ones(len(theta) - 14), 0.02, 0.02]
    data = Data(s=s, H=H, weight=np.broadcast_to(1.0 / size[:, None], H.shape), drive=None, transient=None)
    return layout, data, theta + 0.3 * away * rng.standard_normal(len(theta))


def test_damped_low_modes_under_weights_over_decades():
    """Sums alone ended here at a thousand times the cost, and said that they had converged."""
    layout, data, theta = damped_low_modes(2, decades=1)

    def by_lines(x, below):
        return weighted(layout, data, x, below, from_sums=False)

    found = search(functools.partial(weighted, layout, data), theta, 60, exactly=by_lines)
    reference = search(by_lines, theta, 60)
    # Both are still on their way down a narrow valley after 60 steps; the false end was 1700 times above.
    assert found.step.cost < 1.1 * reference.step.cost


def test_gram_from_sums_of_pairs_without_a_frequency():
    """Critically damped to the last digit: nothing divides by their frequency, and no warning is raised."""
    s = 2j * np.pi * np.linspace(0.5, 9.0, 40)
    layout = Layout(
        pair=np.ones(2, bool),
        fixed_imag=np.zeros(2),
        pivot=np.zeros(2, int),
        inputs=1,
        outputs=1,
        options=FitOptions(constants="real"),
    )
    theta = pack(
        layout,
        Point(np.array([-3 + 1e-200j, -0.4 + 20j]), np.ones((2, 1)), np.zeros((1, 1)), np.zeros((0, 1))),
    )
    data = Data(s=s, H=np.ones((1, 40, 1)), weight=np.ones((1, 40, 1)))
    terms, weight = build_terms(layout, data, theta), np.random.default_rng(0).random((1, 40))
    sums, lines = (Functions(terms, from_sums=way).grams(weight) for way in (True, False))
    size = np.sqrt(np.einsum("gnn->gn", lines))
    # Rounding of forty terms, times the distance of the lines over the decay rate of 0.4: some hundred.
    assert (np.abs(sums - lines) <= 1e-11 * size[:, :, None] * size[:, None]).all()


@pytest.mark.parametrize("every", [1, 100], ids=["from sums", "by columns"])
def test_what_is_not_below_a_cost_is_no_step_and_what_is_below_is_the_whole_one(every):
    layout, data, theta = damped_low_modes(2, decades=1)
    data = Data(s=data.s[::every], H=data.H[:, ::every], weight=data.weight[:, ::every])
    assert by_normal_equations(layout, data) == (every == 1)
    whole = weighted(layout, data, theta)
    cost, linear = least_cost(layout, data, theta)
    assert cost == whole.cost
    np.testing.assert_array_equal(linear, whole.linear)
    assert weighted(layout, data, theta, whole.cost) is None
    assert weighted(layout, data, theta, 1.001 * whole.cost) == whole
