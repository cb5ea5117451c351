"""The gradient of a fit with a noise of 1e-11, against orthogonal columns in extended precision."""

import numpy as np
import pytest

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import build_terms
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.problem.unknowns_layout import Layout, Point, pack
from middeck.identification.search.least_squares_costs import by_normal_equations, weighted

pytestmark = pytest.mark.kernels

MODES, LINES, PATHS = 8, 400, 2


def case(seed, noise, close):
    """Eight modes of 1 %, of which the first two are a share ``close`` of their frequency apart."""
    rng = np.random.default_rng(seed)
    s = 2j * np.pi * np.linspace(1.0, 60.0, LINES)
    hz = np.sort(rng.uniform(3.0, 55.0, MODES))
    hz[1] = hz[0] * (1.0 + close)
    w = 2.0 * np.pi * hz
    p = w * (-0.01 + 1j * np.sqrt(1.0 - 1e-4))
    b = np.ones((MODES, PATHS))
    b[:, 1:] = rng.uniform(-0.9, 0.9, (MODES, PATHS - 1))
    constants = rng.standard_normal((PATHS, MODES)) * w**2
    each = 1.0 / ((s[:, None] - p) * (s[:, None] - p.conj()))
    H = np.einsum("om,lm,mi->oli", constants, each, b) * np.exp(-0.004 * s)[None, :, None]
    size = noise * np.sqrt(np.mean(np.abs(H) ** 2))
    re, im = rng.standard_normal((2, *H.shape)) / np.sqrt(2.0)
    layout = Layout(
        pair=np.ones(MODES, bool), fixed_imag=np.zeros(MODES), pivot=np.zeros(MODES, int), inputs=PATHS,
        outputs=PATHS, options=FitOptions(constants="real", delay=True),
    )  # fmt: skip
    theta = pack(layout, Point(p, b + 0j, np.full((PATHS, 1), 0.004)))
    return layout, Data(s=s, H=H + size * (re + 1j * im), weight=np.full(H.shape, 1.0 / size)), theta


def projected(rows, on):
    """Rows without their parts along the others, by Gram and Schmidt, twice over, in extended precision."""
    base = []
    for row in on:
        for _ in range(2):
            for q in base:
                row = row - (q @ row) * q
        base.append(row / np.sqrt(np.sum(row**2)))
    for _ in range(2):
        for q in base:
            rows = rows - (rows @ q)[:, None] * q
    return rows


@pytest.mark.parametrize("close", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("noise", [1e-8, 1e-11])
def test_the_step_is_right_to_a_hundredth_of_a_deviation(noise, close):
    layout, data, theta = case(1, noise, close)
    assert by_normal_equations(layout, data)
    found = weighted(layout, data, theta)
    terms = build_terms(layout, data, theta)
    gradient, gram = np.zeros(layout.size), np.zeros((layout.size, layout.size))
    for o in range(PATHS):
        weight = data.weight[o].astype(np.longdouble)
        columns = as_real(terms.columns(o)).astype(np.longdouble)
        slopes = as_real(terms.slopes(found.linear[o], o)).astype(np.longdouble)
        heavy = np.repeat(weight.ravel(), 2)
        y = as_real(data.H[o][None]).astype(np.longdouble) * heavy
        left, G = projected(y, columns * heavy), projected(slopes * heavy, columns * heavy)
        gradient -= (G @ left[0]).astype(float)
        gram += (G @ G.T).astype(float)
    size = np.sqrt(np.diag(gram))
    L = np.linalg.cholesky(gram / size[:, None] / size)
    # In deviations, all unknowns together. Rounding of the data, 1e-16 of them, is 1e-5 of this noise.
    assert np.linalg.norm(np.linalg.solve(L, (found.gradient - gradient) / size)) < 0.01
