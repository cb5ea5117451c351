"""Lines, tables and their filters: power, width, and spectra whose filter is known."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.loop.closed_loop import close_loop, leave_open
from middeck.control.loop.performance import Performance, loop_rms
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.disturbance_spectra import (
    colour_disturbances,
    fit_spectrum,
    line_filter,
    sum_spectra,
)
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.errors import ConfigError, DataError
from middeck.signals.ports import Port
from middeck.systems.norms.band_rms import band_rms
from middeck.systems.poles.resolvent import by_solving
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import grouped_plant


def density(system, f):
    return np.sum(np.abs(by_solving(system)(2j * np.pi * np.asarray(f))) ** 2, axis=(1, 2))


def test_a_line_has_its_rms_and_its_width():
    line = line_filter(30.0, 0.6, 2.0)
    # Of a rate, S falls as 1/f^2: less than a millionth of the power lies above 1e6 Hz.
    assert band_rms(line, np.eye(1), (0.0, 1e6))[0] == pytest.approx(2.0, rel=1e-6)
    # Half power at f where |f^2 - f0^2| = width f: exactly a width apart.
    half = np.sqrt(30.0**2 + 0.3**2) + np.array([-0.3, 0.3])
    np.testing.assert_allclose(density(line, half), density(line, [30.0, 30.0]) / 2.0, rtol=1e-12)


def test_powers_add():
    both = sum_spectra([line_filter(30.0, 0.6, 2.0), line_filter(60.0, 1.2, 1.0)])
    assert both.D.shape == (1, 2)
    f = np.array([10.0, 30.0, 61.0])
    apart = density(line_filter(30.0, 0.6, 2.0), f) + density(line_filter(60.0, 1.2, 1.0), f)
    np.testing.assert_allclose(density(both, f), apart, rtol=1e-13)
    assert band_rms(both, np.eye(2), (0.0, 1e6))[0] == pytest.approx(np.sqrt(5.0), rel=1e-6)


def bump(f, f0, zeta):
    return 1.0 / ((1.0 - (f / f0) ** 2) ** 2 + (2.0 * zeta * f / f0) ** 2)


def test_a_table_of_a_rational_spectrum_is_found():
    # A floor that falls above 3 Hz and two resonances: the sum is rational of order five.
    f = np.geomspace(0.5, 200.0, 400)
    S = 1e-4 * (1.0 / (1.0 + (f / 3.0) ** 2) + 0.5 * bump(f, 20.0, 0.02) + 0.02 * bump(f, 70.0, 0.005))
    fit = fit_spectrum(f, S, 2)
    # Least squares to convergence on exact data.
    assert fit.rms_error_db < 1e-6
    poles, zeros = np.linalg.eigvals(fit.filter.A), transmission_zeros(fit.filter)
    assert poles.real.max() < 0.0
    assert zeros.real.max() < 0.0
    np.testing.assert_allclose(density(fit.filter, f), S, rtol=1e-6)


def test_more_sections_never_fit_worse_and_the_error_is_reported():
    rng = np.random.default_rng(3)
    f = np.geomspace(1.0, 100.0, 120)
    S = (1.0 / f + bump(f, 12.0, 0.05)) * np.exp(0.2 * rng.standard_normal(120))
    fits = [fit_spectrum(f, S, n) for n in range(4)]
    errors = [fit.rms_error_db for fit in fits]
    assert all(later <= earlier * (1.0 + 1e-6) for earlier, later in pairwise(errors))
    # The scatter of 0.2 in log S is 0.87 dB: no filter of 13 numbers goes much below on 120 lines.
    assert 0.75 < errors[-1] < 1.2
    for fit in fits:
        off = 10.0 * np.log10(density(fit.filter, f) / S)
        assert fit.worst_error_db == pytest.approx(np.abs(off).max(), rel=1e-9)


def test_tables_and_lines_without_sense_are_refused():
    f = np.geomspace(1.0, 10.0, 20)
    for bad in ((f[::-1], f), (f, 0.0 * f), (f, f[:-1]), (f - 1.0, f), (f, np.where(f > 5.0, np.nan, f))):
        with pytest.raises(DataError):
            fit_spectrum(*bad, 1)
    with pytest.raises(DataError, match="sections"):
        fit_spectrum(f, f, 6)
    for line in ((30.0, 0.0, 1.0), (30.0, 70.0, 1.0), (30.0, 1.0, -1.0)):
        with pytest.raises(ConfigError):
            line_filter(*line)


def one_mode():
    """A mode at 5 Hz; the motor u disturbs as well as it controls."""
    omega = 2.0 * np.pi * 5.0
    system = StateSpace(
        [[0.0, omega], [-omega, -0.04 * omega]], [[0.0, 0.0], [0.3, 1.0]], [[1.0, 0.0]], [[0.0, 0.0]]
    )
    return grouped_plant(system, (Port("w", "N"), Port("u", "N")), (Port("x", "m"),), u=("u",))


def test_a_coloured_plant_is_disturbed_by_the_spectrum():
    wheel = sum_spectra([line_filter(5.5, 0.2, 2.0), line_filter(11.0, 0.4, 1.0)])
    plant = colour_disturbances(one_mode(), (("u", wheel),))
    assert plant.w == ("w", "noise of u 1", "noise of u 2")
    assert plant.u == ("u",)
    assert plant.state_names[:4] == 4 * ("colour of u",)
    f = np.linspace(1.0, 20.0, 200_001)
    G = np.abs(by_solving(one_mode().system)(2j * np.pi * f[::100])[:, 0]) ** 2
    gain = np.stack([np.interp(f, f[::100], G[:, k]) for k in range(2)])
    power = 2.0 * np.trapezoid(gain[0] * 0.5 + gain[1] * np.interp(f, f[::100], density(wheel, f[::100])), f)
    found = loop_rms(leave_open(plant), Performance(np.ones(1), np.diag([0.5, 1.0, 1.0]), (1.0, 20.0)))
    # A grid of 10 mHz on lines 200 mHz wide: trapezia to (0.05)^2 / 12.
    assert found[0] == pytest.approx(np.sqrt(power), rel=1e-3)


def test_noises_stand_where_their_disturbances_stood():
    wheel = sum_spectra([line_filter(5.5, 0.2, 2.0), line_filter(11.0, 0.4, 1.0)])
    plant = colour_disturbances(one_mode(), (("w", wheel),))
    assert plant.w == ("noise of w 1", "noise of w 2", "u")


def test_a_design_for_a_spectrum_costs_what_its_coloured_loop_does():
    wheel = line_filter(5.5, 0.2, 2.0)
    plant = one_mode()
    asked = LQGWeights(
        output=np.ones(1),
        input=np.ones(1),
        disturbed=("w", "u"),
        process=np.diag([0.5, 3.0]),
        sensor=np.array([1e-4]),
    )
    law = design_lqg(plant, asked, 100.0, shaping=Shaping(colours=(("u", wheel),)))
    plain = design_lqg(plant, asked, 100.0)

    def cost(law):
        loop = close_loop(colour_disturbances(plant, (("u", wheel),)), law).system
        n = len(law.system.A)
        noise = loop.B @ np.diag([0.5, 3.0]) @ loop.B.T
        noise[-n:, -n:] += 1e-4 * law.system.B @ law.system.B.T
        X = sla.solve_continuous_lyapunov(loop.A, -noise)
        u = law.system.C
        return float((loop.C @ X @ loop.C.T + u @ X[-n:, -n:] @ u.T / 100.0)[0, 0])

    assert law.cost == pytest.approx(cost(law), rel=1e-9)
    # Who knows the line does better under it.
    assert cost(law) < cost(plain)


def test_colours_at_ports_that_do_not_disturb_are_refused():
    with pytest.raises(ConfigError, match="no port 'x'"):
        colour_disturbances(one_mode(), (("x", line_filter(5.5, 0.2, 2.0)),))
    assert colour_disturbances(one_mode(), ()) == one_mode()
