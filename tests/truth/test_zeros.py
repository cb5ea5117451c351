"""Zeros of measurement models: closed forms, laws, scipy for small cases, and derivatives by differences."""

import dataclasses

import gimbal_record
import numpy as np
import pytest
import scipy.signal
from pole_zero_form import response_of_form

from middeck.errors import ConfigError
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import MeasurementModel, model_response, rational_response
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.pole_zero_gain import pole_zero_gain
from middeck.identification.plants.zeros import matrix_zeros, name_zeros, path_zeros
from middeck.identification.spectra.estimate import estimate_response
from middeck.identification.uncertainty.parameter_deviations import zero_deviation
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.signals.ports import Port
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace

HZ = 2.0 * np.pi


def modal_model(hz, phi, psi, zeta=0.01, delay_s=0.0, direct=0.0):
    """sum phi psi / (s^2 + 2 zeta w s + w^2), phi[output, mode], psi[mode, input]."""
    omega = HZ * np.asarray(hz, dtype=float)
    phi, psi = np.atleast_2d(phi), np.asarray(psi, dtype=float).reshape(len(omega), -1)
    pole = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    outputs, inputs = len(phi), psi.shape[1]
    return MeasurementModel(
        poles=pole,
        shapes=phi / (2j * pole.imag),
        participation=psi,
        direct=np.full((outputs, inputs), direct),
        lower=np.zeros((outputs, inputs)),
        delay_s=np.full(outputs, delay_s),
        inputs=tuple(Port(f"u{i}", "N m") for i in range(inputs)),
        outputs=tuple(Port(f"y{o}", "rad") for o in range(outputs)),
    )


def gimbal_model():
    model = modal_model(gimbal_record.MODES_HZ, gimbal_record.PHI, np.transpose(gimbal_record.PSI))
    return dataclasses.replace(
        model, inputs=gimbal_record.INPUTS, outputs=gimbal_record.OUTPUTS, delay_s=gimbal_record.DELAY_S
    )


@pytest.mark.parametrize("zeta", [0.0, 1e-6, 0.01])
def test_two_modes_in_closed_form(zeta):
    """r1 (s^2 + w2^2) + r2 (s^2 + w1^2) = 0 without damping; in general a quadratic."""
    w, r = HZ * np.array([1.0, 3.0]), np.array([2.0, 0.5])
    found = path_zeros(modal_model(w / HZ, [[1.0, 1.0]], r, zeta), "y0", "u0")
    expected = np.roots(
        [r.sum(), 2 * zeta * (r[0] * w[1] + r[1] * w[0]), r[0] * w[1] ** 2 + r[1] * w[0] ** 2]
    )
    np.testing.assert_allclose(found.value, expected[expected.imag > 0.0], rtol=1e-13)
    assert not found.is_nonminimum_phase.any()


def test_two_modes_against_each_other_have_real_zeros():
    """Opposite signs of the constants: the zeros leave the axis as a real pair, one on the wrong side."""
    w, r = HZ * np.array([1.0, 3.0]), np.array([0.5, -2.0])
    found = path_zeros(modal_model(w / HZ, [[1.0, 1.0]], r, 0.01), "y0", "u0")
    expected = np.roots([r.sum(), 0.02 * (r[0] * w[1] + r[1] * w[0]), r[0] * w[1] ** 2 + r[1] * w[0] ** 2])
    np.testing.assert_allclose(np.sort(found.value.real), np.sort(expected.real), rtol=1e-13)
    assert not found.is_pair.any()
    assert found.is_nonminimum_phase.tolist() == (found.value.real > 0.0).tolist()
    assert found.is_nonminimum_phase.sum() == 1
    words = name_zeros(found)
    assert sum("non-minimum phase" in line for line in words) == 1
    assert all("u0 to y0: real zero" in line for line in words)


@pytest.mark.parametrize("modes", [2, 5, 20, 60])
def test_poles_and_zeros_of_a_drive_point_alternate(modes):
    """Collocated: between any two modes lies one zero (Foster 1924); as many as gaps, none elsewhere."""
    rng = np.random.default_rng(modes)
    hz = np.sort(10.0 ** rng.uniform(-2.0, 4.0, modes))
    phi = rng.uniform(0.1, 1.0, modes)
    found = path_zeros(modal_model(hz, phi[None], phi, 0.0), "y0", "u0")
    assert len(found.value) == modes - 1
    assert np.all((hz[:-1] < found.frequency_hz) & (found.frequency_hz < hz[1:]))
    # Undamped: on the axis, to rounding.
    assert np.abs(found.damping).max() < 1e-12
    assert found.residual.max() < 1e-12


def test_a_path_of_little_damping_keeps_its_zeros_over_six_decades():
    """Every zero of light damping satisfies H = 0 to the rounding of its own terms."""
    hz = np.geomspace(1e-2, 1e4, 40)
    rng = np.random.default_rng(0)
    model = modal_model(hz, rng.choice([-1.0, 1.0], 40)[None] * hz, hz, 1e-4)
    found = path_zeros(model, "y0", "u0")
    assert np.sum(np.where(found.is_pair, 2, 1)) == 78  # relative degree two
    assert found.residual.max() < 1e-10


@pytest.mark.parametrize("direct", [0.0, 0.3])
def test_small_cases_are_scipys(direct):
    rng = np.random.default_rng(1)
    for _ in range(20):
        model = modal_model(
            [0.5, 1.1, 2.3], rng.standard_normal((1, 3)), rng.standard_normal(3), 0.05, direct=direct
        )
        found = path_zeros(model, "y0", "u0")
        poles = np.concatenate([model.poles, model.poles.conj()])
        residues = np.concatenate([model.shapes[0] * model.participation[:, 0]] * 2)
        residues[3:] = residues[3:].conj()
        numerator, _ = scipy.signal.invres(residues, poles, [direct] if direct else [])
        numerator = np.trim_zeros(
            np.where(np.abs(numerator) > 1e-9 * np.abs(numerator).max(), numerator.real, 0.0), "f"
        )
        theirs = np.roots(numerator)
        ours = np.concatenate([found.value, found.value[found.is_pair].conj()])
        assert len(ours) == len(theirs)
        # Their polynomials of degree six lose some five digits.
        assert max(np.abs(theirs - z).min() / abs(z) for z in ours) < 1e-8


def test_transmission_zeros_are_where_the_determinant_vanishes():
    model = gimbal_model()
    found = matrix_zeros(model, outputs=("payload", "bus"))
    # Ten states, relative degree two twice.
    assert np.sum(np.where(found.is_pair, 2, 1)) == 6
    plain = dataclasses.replace(model, delay_s=np.zeros(3))
    for z in found.value:
        H = rational_response(plain, np.array([z]))
        size = np.linalg.svd(H[0, [0, 2]], compute_uv=False)
        assert size[1] < 1e-12 * size[0]
    assert "gimbal, wheel to payload, bus" in name_zeros(found)[0]


def test_more_outputs_than_inputs_have_no_zeros_unless_all_share_one():
    assert len(matrix_zeros(gimbal_model()).value) == 0
    rng = np.random.default_rng(2)
    omega = HZ * np.array([1.0, 2.5, 4.0])
    rates = ModalSystem(
        omega=omega,
        zeta=0.02 * np.ones(3),
        psi=rng.standard_normal((3, 1)),
        phi=np.zeros((2, 3)),
        phi_rate=rng.standard_normal((2, 3)),
        names=("a", "b", "c"),
    ).as_statespace()
    # Rates of positions: a zero at the origin in every path.
    np.testing.assert_allclose(transmission_zeros(rates), [0.0], atol=1e-12)


def test_zeros_at_infinity_are_not_given():
    """A chain driven at one end, relative degree 1 to 8: as many zeros as states are left."""
    for degree in range(1, 9):
        n = 10
        A = np.diag(np.ones(n - 1), 1) + np.diag(-np.arange(1.0, n + 1))
        B, C = np.eye(n)[:, [-1]], np.eye(n)[[n - degree]]
        zeros = transmission_zeros(StateSpace(A, B, C, np.zeros((1, 1))))
        np.testing.assert_allclose(np.sort(zeros.real), -np.arange(n - degree, 0.0, -1.0), rtol=1e-6)


def test_a_sampled_model_has_its_zeros_in_z():
    """y = 1/(z - 0.5) + 1/(z - 0.9) - 0.4/(z + 0.3): a quadratic over the leading 1.6."""
    T = 0.1
    p, r = np.array([0.5, 0.9, -0.3]), np.array([1.0, 1.0, -0.4])
    poles = np.log(p.astype(complex)) / T
    one = np.zeros((1, 1))
    model = MeasurementModel(
        poles=poles,
        shapes=r[None],
        participation=np.ones((3, 1)),
        direct=one,
        lower=one,
        delay_s=[0.0],
        inputs=(Port("u", ""),),
        outputs=(Port("y", ""),),
        sample_hz=1.0 / T,
    )
    found = path_zeros(model, "y", "u")
    numerator = sum(r[k] * np.poly(np.delete(p, k)) for k in range(3))
    np.testing.assert_allclose(
        np.sort(np.exp(found.value * T).real), np.sort(np.roots(numerator)), rtol=1e-12
    )
    f = np.array([0.0, 1.3, 4.9])
    H = response_of_form(pole_zero_gain(model, "y", "u"), f)
    np.testing.assert_allclose(H, model_response(model, f)[:, 0, 0], rtol=1e-12)


@pytest.mark.parametrize(("output", "count"), [("payload", 0), ("encoder", 0), ("bus", 1)])
def test_the_bus_angle_alone_has_a_zero_on_the_wrong_side(output, count):
    found = path_zeros(gimbal_model(), output, "gimbal")
    assert found.is_nonminimum_phase.sum() == count
    assert np.sum(np.where(found.is_pair, 2, 1)) == 8


@pytest.mark.parametrize("square", [False, True])
def test_derivatives_of_zeros(square):
    """By central differences of every frequency, damping and constant of the model."""
    model = gimbal_model()
    chosen = {"outputs": ("payload", "bus"), "inputs": ("gimbal", "wheel") if square else ("gimbal",)}
    chosen["outputs"] = chosen["outputs"] if square else ("bus",)
    rows, columns = ([0, 2], [0, 1]) if square else ([2], [0])
    found = matrix_zeros(model, **chosen)
    for name, index, change in [
        ("poles", 1, 1e-6),
        ("poles", 4, 1e-6j),
        ("shapes", (2, 3), 1e-6),
        ("participation", (2, 0), 1e-6),
    ]:
        ends = [_moved(model, name, index, sign * change) for sign in (1.0, -1.0)]
        by_differences = np.subtract(*(matrix_zeros(e, **chosen).value for e in ends))
        dH = [np.subtract(*(rational_response(e, np.array([z]))[0] for e in ends)) for z in found.value]
        by_formula = [
            np.sum(G * d[np.ix_(rows, columns)]) for G, d in zip(found.by_response, dH, strict=True)
        ]
        # Rounding of differences of 1e-6: some 1e-9 of the zeros, 1e-3 of these changes at most.
        np.testing.assert_allclose(by_formula, by_differences, atol=1e-3 * np.abs(by_differences).max())


def _moved(model, name, index, change):
    value = getattr(model, name).copy()
    value[index] *= 1.0 + change
    moved = dataclasses.replace(model, **{name: value})
    # Modal constants are held while a pole moves: c = phi / (2 j omega_d).
    return dataclasses.replace(moved, shapes=moved.shapes * model.poles.imag / moved.poles.imag)


@pytest.mark.parametrize("output", ["payload", "encoder", "bus"])
def test_poles_zeros_gain_and_delay(output):
    model = gimbal_model()
    form = pole_zero_gain(model, output, "gimbal")
    o = [p.name for p in model.outputs].index(output)
    residue = model.shapes[o] * model.participation[:, 0]
    # Real constants: the sum of phi psi leads, and the static gain is the sum of phi psi / omega^2.
    phi_psi = np.real(residue * 2j * model.poles.imag)
    assert form.gain == pytest.approx(phi_psi.sum(), rel=1e-12)
    assert form.static_gain == pytest.approx(np.sum(phi_psi / np.abs(model.poles) ** 2), rel=1e-12)
    assert form.delay_s == model.delay_s[o]
    f = gimbal_record.SCORED_HZ
    # Products of eighteen factors.
    np.testing.assert_allclose(response_of_form(form, f), model_response(model, f)[:, o, 0], rtol=1e-10)


def test_a_rigid_body_in_poles_and_zeros():
    model = dataclasses.replace(gimbal_model(), rigid=np.full((3, 2), 0.7))
    form = pole_zero_gain(model, "payload", "gimbal")
    assert np.sum(form.poles == 0.0) == 2
    assert form.static_gain is None
    f = gimbal_record.SCORED_HZ
    np.testing.assert_allclose(response_of_form(form, f), model_response(model, f)[:, 0, 0], rtol=1e-9)


@pytest.mark.parametrize("inputs", [("gimbal",), ("gimbal", "wheel")])
def test_outputs_and_inputs_that_say_the_same_leave_the_zeros_of_one_path(inputs):
    """A matrix that is singular everywhere has the zeros of what is left, which any change removes."""
    model = gimbal_model()
    shapes, participation = np.array(model.shapes), np.array(model.participation)
    shapes[1], participation[:, 1] = 2.0 * shapes[0], -3.0 * participation[:, 0]
    model = dataclasses.replace(model, shapes=shapes, participation=participation)
    found = matrix_zeros(model, outputs=("payload", "encoder"), inputs=inputs)
    one = path_zeros(model, "payload", "gimbal")
    np.testing.assert_allclose(found.value, one.value, rtol=1e-10)
    assert found.by_response is None
    assert one.by_response is not None


@pytest.mark.parametrize("zeta", [0.999, 1.0 - 1e-8, 1.0 - 1e-15])
def test_a_pair_near_critical_damping_keeps_its_digits(zeta):
    """phi psi / (s + w)^2 in the limit; its two fractions have residues of 1e7 and more that cancel."""
    hz, phi = np.array([1.0, 3.0]), np.array([[1.0, 0.4]])
    model = modal_model(hz, phi, [1.0, 1.0], zeta)
    f, w = np.geomspace(0.1, 10.0, 50), HZ * hz
    s = 1j * HZ * f[:, None]
    expected = np.sum(phi / (s**2 + 2.0 * zeta * w * s + w**2), axis=1)
    np.testing.assert_allclose(model_response(model, f)[:, 0, 0], expected, rtol=1e-13)
    np.testing.assert_allclose(evaluate_plant(measured_plant(model), f).H[:, 0, 0], expected, rtol=1e-12)
    zeros = path_zeros(model, "y0", "u0")
    numerator = [1.4, 2 * zeta * (w[1] + 0.4 * w[0]), w[1] ** 2 + 0.4 * w[0] ** 2]
    np.testing.assert_allclose(zeros.value, np.roots(numerator)[:1], rtol=1e-12)


def test_complex_residues_that_add_up_to_zero_have_relative_degree_two():
    """To rounding only, as a fit leaves them: a zero at 1e16 times the modes' size is no zero."""
    rng = np.random.default_rng(4)
    model = gimbal_model()
    R = rng.standard_normal(5) + 1j * rng.standard_normal(5)
    R[-1] -= np.real(R).sum()
    model = dataclasses.replace(
        model, shapes=R[None], participation=np.ones((5, 1)), direct=np.zeros((1, 1)), lower=np.zeros((1, 1)),
        delay_s=[0.0], inputs=model.inputs[:1], outputs=model.outputs[:1],
    )  # fmt: skip
    found = path_zeros(model, "payload", "gimbal")
    assert np.sum(np.where(found.is_pair, 2, 1)) == 8


def test_what_moves_a_zero_is_what_its_deviation_is_made_of():
    """By the response's factor here, or by the implicit function theorem on the unknowns of a fit there."""
    fitted = fit_response(estimate_response(gimbal_record.multisine(0)), states=10)
    found = path_zeros(fitted.model, "payload", "gimbal")
    delayed = dataclasses.replace(fitted.model, delay_s=np.zeros(1))
    slopes = entry_slopes(delayed, fitted.covariance.structure, found.value, 0, 0)
    dz = found.by_response[:, 0, 0, None] * slopes.by.T
    C = fitted.covariance.matrix[np.ix_(slopes.place, slopes.place)]
    along = np.real(found.value.conj()[:, None] * dz) / np.abs(found.value)[:, None] / HZ
    deviation = np.sqrt(np.einsum("zu,uv,zv->z", along, C, along))
    theirs, _ = zero_deviation(fitted.covariance, found.value, output="payload", input="gimbal")
    # Their derivative by s is a difference: (step 1e-4 over 1.6 %, the way to the nearest mode)^2.
    np.testing.assert_allclose(deviation, theirs, rtol=1e-4)
    # The delay of 10 ms moves no zero, not even one so far that its factor, exp(2000), is beyond all floats.
    far, _ = zero_deviation(fitted.covariance, [-2e5], output="payload", input="gimbal")
    assert np.isfinite(far).all()
    truth = path_zeros(gimbal_model(), "payload", "gimbal")
    # Four standard deviations.
    assert np.all(np.abs(found.frequency_hz - truth.frequency_hz) < 4.0 * deviation)


def test_an_unknown_output_is_refused():
    with pytest.raises(ConfigError, match="one of payload"):
        path_zeros(gimbal_model(), "load", "gimbal")


@pytest.mark.parametrize("rate", [1, 2])
def test_a_rate_and_an_acceleration_have_zeros_at_the_origin(rate: int):
    """s^rate times two modes: one or two zeros stand at s = 0, on neither side."""
    f, zeta, gain = np.array([3.0, 8.5]), 0.01, np.array([1.0, -0.4])
    omega = 2.0 * np.pi * f
    poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    shapes = gain * poles**rate / (2j * poles.imag)
    # s^2 / (s^2 + ...) has a direct term of one.
    direct = np.array([[gain.sum() if rate == 2 else 0.0]])
    model = MeasurementModel(
        poles=poles,
        shapes=shapes[None],
        participation=np.ones((2, 1), dtype=complex),
        direct=direct,
        lower=np.zeros((1, 1)),
        delay_s=np.zeros(1),
        inputs=(Port("force", "N"),),
        outputs=(Port("motion", "m/s"),),
    )
    zeros = path_zeros(model, "motion", "force")
    # Two equal zeros come out of a pencil as far apart as the root of rounding.
    at_origin = np.abs(zeros.value) < 1e-6 * omega[0]
    assert np.sum(np.where(zeros.is_pair, 2, 1)[at_origin]) == rate
    assert not zeros.is_nonminimum_phase[at_origin].any()
    # Besides, both modes have one zero or pair where gain_1 / (s^2 + ...) = -gain_2 / (s^2 + ...).
    left = zeros.value[~at_origin]
    s = left[0]
    H = sum(g / (s**2 + 2 * zeta * w * s + w**2) for g, w in zip(gain, omega, strict=True))
    assert abs(H) < 1e-9 / omega[0] ** 2


def test_poles_at_the_origin_of_both_kinds_are_no_zeros():
    """a/s^2 + b/s + c/(s^2 + w^2): (a + b s)(s^2 + w^2) + c s^2 = 0, three zeros and none at the origin."""
    a, b, c, w = 3.0, 0.7, -0.4, HZ * 2.0
    one = np.ones((1, 1))
    model = dataclasses.replace(
        modal_model([2.0], [[1.0]], [c], 0.0), lower=0.4 * a * one, rigid=0.6 * a * one, integral=b * one
    )
    found = path_zeros(model, "y0", "u0")
    expected = np.roots([b, a + c, b * w**2, a * w**2])
    ours = np.concatenate([found.value, found.value[found.is_pair].conj()])
    np.testing.assert_allclose(np.sort_complex(ours), np.sort_complex(expected), rtol=1e-12)


def test_a_zero_at_the_origin_beside_a_pole_there():
    """A wheel's rate g/s u0 + rates of two modes, and rates of the modes: det H = s (g/s h11 + ...)."""
    omega, zeta = HZ * np.array([0.5, 3.0]), 0.01
    phi, psi, g = np.array([[0.1, 0.2], [1.0, -0.7]]), np.array([[0.3, 1.0], [0.2, 0.9]]), 2.0
    plain = modal_model(omega / HZ, phi, psi, zeta)
    model = dataclasses.replace(
        plain, shapes=plain.shapes * plain.poles, integral=np.array([[g, 0.0], [0.0, 0.0]])
    )
    found = matrix_zeros(model)
    # det of phi s/d psi + [g/s, 0; 0, 0] over s, with d_m = s^2 + 2 zeta w_m s + w_m^2, is
    # det(phi) det(psi) s / (d1 d2) + g / s (phi_2m psi_m2 / d_m); times s d1 d2 its roots are the others.
    d = [np.array([1.0, 2.0 * zeta * w, w**2]) for w in omega]
    cross = np.linalg.det(phi) * np.linalg.det(psi)
    numerator = g * (phi[1, 0] * psi[0, 1] * d[1] + phi[1, 1] * psi[1, 1] * d[0]) + [cross, 0.0, 0.0]
    others = np.roots(numerator)
    assert found.value[0] == 0.0
    np.testing.assert_allclose(found.value[1:], others[others.imag > 0.0], rtol=1e-10)
