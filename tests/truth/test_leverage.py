"""What a model misses of a line that it has not seen: by its leverage, against fits without that line."""

import numpy as np
import pytest

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.thinning import take_lines
from middeck.identification.problem.data import Data
from middeck.identification.search.leverage import leverage
from middeck.identification.search.refine_and_reweigh import polish
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.identification.start.start import starts
from repeats import repeats

HZ, ZETA = np.array([3.0, 7.0]), 0.02


def a_fit(options: FitOptions, seed: int):
    """Two outputs and inputs, two modes, late by 6 ms, 1 % noise, at 40 lines; refined to the end."""
    rng = np.random.default_rng(seed)
    s, w = 2j * np.pi * np.linspace(1.0, 10.0, 40), 2.0 * np.pi * HZ
    modes = w**2 / (s[:, None] ** 2 + 2.0 * ZETA * w * s[:, None] + w**2) * np.exp(-0.006 * s)[:, None]
    H = np.einsum("om,km,mi->oki", [[1.0, 0.6], [0.5, -0.8]], modes, [[1.0, 0.3], [-0.4, 0.9]])
    size = 0.01 * np.sqrt(np.mean(np.abs(H) ** 2))
    re, im = size * rng.standard_normal((2, *H.shape)) / np.sqrt(2.0)
    v = np.full(H.shape, size**2)
    data = Data(s=s, H=H + re + 1j * im, weight=1.0 / np.sqrt(v))
    spread = ExcessVariance(variance=v, size=np.ones(H.shape))
    first = next(iter(starts(data, options)))
    return data, spread, polish(data, first, spread, steps=40, rounds=1, share=0.0)


@pytest.mark.kernels
@pytest.mark.parametrize("degree", repeats([None, 2]))
def test_a_line_left_out_is_missed_as_its_leverage_says(degree):
    options = FitOptions(states=4, constants="complex", relative_degree=degree, delay=True, direct=False)
    data, spread, best = a_fit(options, seed=2)
    h = leverage(data, best, spread.variance)
    # Each unknown follows one number, of two on a line.
    unknowns = best.layout.size + best.refined.step.linear.size - 4 * (degree == 2)
    assert 2.0 * h.sum() == pytest.approx(unknowns, rel=1e-6)
    whole = best.residual(data)
    for k in (3, 9, 10, 25, 27):
        rest, less = take_lines(data, spread, np.delete(np.arange(40), k))
        without = polish(rest, best.start, less, steps=40, rounds=1, share=0.0)
        missed = without.residual(data)[:, k]
        # All four entries of a line go together; each counts the others as seen.
        assert np.linalg.norm(missed) == pytest.approx(np.linalg.norm(whole[:, k] / (1.0 - h[:, k])), rel=0.3)
