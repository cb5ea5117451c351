"""Standard deviations and intervals of a model's parameters, from the covariance of its unknowns."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.special
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio, natural_hz
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import UnknownPlaces
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.signals.ports import port_indices
from middeck.values import record


@record
class ParameterDeviations:
    """Standard deviations; see `ModelCovariance` for what they cover.

    Attributes:
        natural_hz, damping: Deviations of each mode's natural frequency [Hz] and damping ratio.
        delay_s: Deviation of the delay of each output [s]; zero where no delay was fitted.

    Infinite where the data do not determine the number: the deviation would be larger than the frequency or
    the damping ratio itself, or a delay's than a period of the slowest mode.
    """

    natural_hz: Float[np.ndarray, " mode"]
    damping: Float[np.ndarray, " mode"]
    delay_s: Float[np.ndarray, " output"]


@record
class Parameters:
    """All physical parameters of a model with their joint covariance.

    Attributes:
        names: ``natural_hz[m]``, ``damping[m]``; ``constant[m, output, input]`` for real modal constants,
            otherwise ``residue_re[...]`` and ``residue_im[...]``; ``rigid``, ``integral``, ``lower``,
            ``direct`` and ``path_delay_s[output, input]``; ``delay_s[output]``. m is the place of the mode in
            the model, the first where a residue of full rank has several; its terms are added.
        values, covariance: In SI units, frequencies in Hz. Rank-one residues of several inputs and outputs
            have fewer free numbers than entries: their covariance is singular then.
        degrees: Degrees of freedom of Student's t that stands for the normal law.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    degrees: float

    @property
    def deviation(self) -> Float[np.ndarray, " parameter"]:
        """Standard deviation of each; infinite where the data do not determine a frequency or a damping."""
        found = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        of_pole = np.array([name.startswith(("natural_hz", "damping")) for name in self.names], dtype=bool)
        return _determined(found, np.where(of_pole, np.abs(self.values), np.inf))

    def interval(
        self, level: float = 0.95
    ) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
        """Ends of the interval of each alone that covers the truth with probability ``level``."""
        half = quantile(level, self.degrees) * self.deviation
        return self.values - half, self.values + half


def quantile(level: float, degrees: float) -> float:
    """Deviations to either side that hold ``level`` of Student's t.

    >>> round(quantile(0.95, float("inf")), 3), round(quantile(0.95, 10.0), 3)
    (1.96, 2.228)
    """
    check_level(level)
    return float(scipy.special.stdtrit(degrees, 0.5 + 0.5 * level))


def joint_factor(level: float, numbers: int, degrees: float) -> float:
    """Deviations that hold so many jointly normal numbers with probability ``level`` (Hotelling's T).

    >>> round(joint_factor(0.95, 2, float("inf")), 3)
    2.448
    """
    if np.isinf(degrees):
        return float(np.sqrt(2.0 * scipy.special.gammaincinv(0.5 * numbers, level)))
    return float(np.sqrt(numbers * scipy.special.fdtri(numbers, degrees, level)))


def joint_tail(squared: np.ndarray | float, numbers: int, degrees: np.ndarray | float) -> np.ndarray:
    """Probability that T^2 of so many numbers exceeds ``squared`` by chance.

    >>> joint_tail(joint_factor(0.95, 3, 12.0) ** 2, 3, 12.0).round(12), joint_tail(0.0, 2, np.inf)
    (np.float64(0.05), np.float64(1.0))
    """
    # F of infinitely many degrees is not in the library; beyond 1e9 it is the same to nine digits.
    return np.asarray(scipy.special.fdtrc(numbers, np.minimum(degrees, 1e9), np.asarray(squared) / numbers))[
        ()
    ]


def check_level(level: float) -> None:
    """Raise `ConfigError` unless 0 < level < 1."""
    if not 0.0 < level < 1.0:
        raise ConfigError(f"a level of {level} is no probability", hint="between 0 and 1, such as 0.95")


def uncertainty_of(covariance: ModelCovariance) -> ParameterDeviations:
    """Standard deviations of frequencies, damping and delays."""
    model = covariance.model
    f, zeta = natural_hz(model), damping_ratio(model)
    frequency, damping = (covariance.deviation(by) for by in pole_slopes(covariance))
    at = covariance.at
    delay = np.where(at.delay >= 0, covariance.deviation()[at.delay], 0.0)
    frequency = _determined(frequency, f)
    return ParameterDeviations(
        frequency,
        np.where(np.isinf(frequency), np.inf, _determined(damping, np.abs(zeta))),
        _determined(delay, 1.0 / f.min(initial=np.inf) if len(f) else np.inf),
    )


def pole_slopes(
    covariance: ModelCovariance,
) -> tuple[Float[np.ndarray, "mode unknown"], Float[np.ndarray, "mode unknown"]]:
    """Derivatives of natural frequencies [Hz] and damping ratios by the unknowns."""
    model = covariance.model
    at = covariance.at
    sigma, omega, size = -np.real(model.poles), np.imag(model.poles), np.abs(model.poles)
    frequency, damping = np.zeros((2, len(size), at.size))
    mode = np.arange(len(size))
    pairs = np.flatnonzero(model.is_pair)
    frequency[mode, at.sigma] = sigma**2 / size / (2.0 * np.pi)
    damping[mode, at.sigma] = sigma * omega**2 / size**3
    frequency[pairs, at.omega[pairs]] = (omega**2 / size)[pairs] / (2.0 * np.pi)
    damping[pairs, at.omega[pairs]] = -(sigma * omega**2 / size**3)[pairs]
    return frequency, damping


def parameters_of(covariance: ModelCovariance) -> Parameters:
    """All physical parameters, their values and their joint covariance."""
    model = covariance.model
    at = covariance.at
    frequency, damping = pole_slopes(covariance)
    modes = distinct_poles(model)
    residue_names, residues, by = residue_slopes(covariance)
    terms = [
        (f"{kind}[{model.outputs[o].name}, {model.inputs[i].name}]", value[o, i], place[o, i])
        for kind, value, place in (
            ("rigid", model.rigid, at.rigid),
            ("integral", model.integral, at.integral),
            ("lower", model.lower, at.lower),
            ("direct", model.direct, at.direct),
            ("path_delay_s", model.path_delay_s, at.path),
        )
        if value is not None
        for o, i in np.argwhere(place >= 0)
    ]
    terms += [
        (f"delay_s[{model.outputs[o].name}]", model.delay_s[o], at.delay[o])
        for o in np.flatnonzero(at.delay >= 0)
    ]
    J = np.concatenate(
        [frequency[modes], damping[modes], by, np.eye(at.size)[[place for _, _, place in terms]]]
    )
    root = J @ covariance.root
    return Parameters(
        (
            *(f"natural_hz[{m}]" for m in modes),
            *(f"damping[{m}]" for m in modes),
            *residue_names,
            *(name for name, _, _ in terms),
        ),
        np.concatenate(
            [
                natural_hz(model)[modes],
                damping_ratio(model)[modes],
                residues,
                [value for _, value, _ in terms],
            ]
        ),
        root @ root.T,
        covariance.degrees,
    )


def residue_slopes(
    covariance: ModelCovariance,
) -> tuple[list[str], Float[np.ndarray, " number"], Float[np.ndarray, "number unknown"]]:
    """Names, values and derivatives of modal constants or of the parts of complex residues."""
    model = covariance.model
    at = covariance.at
    names: list[str] = []
    values: list[float] = []
    rows: list[np.ndarray] = []
    for m in distinct_poles(model):
        pair = bool(model.is_pair[m])
        real = covariance.structure.real_constants and pair
        for o, output in enumerate(model.outputs):
            for i, entry in enumerate(model.inputs):
                residue, by = _residue(covariance, at, m, o, i)
                place = f"[{m}, {output.name}, {entry.name}]"
                kinds = ("constant",) if real else ("residue_re", "residue_im") if pair else ("residue_re",)
                for kind in kinds:
                    names.append(kind + place)
                    values.append(float(residue.imag if kind == "residue_im" else residue.real))
                    rows.append(np.imag(by) if kind == "residue_im" else np.real(by))
    return names, np.array(values), np.array(rows).reshape(len(rows), at.size)


def modal_constant(
    covariance: ModelCovariance, at: UnknownPlaces, m: int, o: int, i: int
) -> tuple[complex, Complex[np.ndarray, " unknown"]]:
    """Constant of mode m from input i to output o and its derivatives: 2 j omega_d c b of a pair, else c b.

    Real where the fit had real constants.
    """
    model = covariance.model
    pair = bool(model.is_pair[m])
    residue, by = _residue(covariance, at, m, o, i)
    if not pair or covariance.structure.real_constants:
        return residue, by
    factor = 2j * float(model.poles[m].imag)
    by = factor * by
    by[at.omega[m]] += factor * residue
    return factor * residue, by


def _residue(
    covariance: ModelCovariance, at: UnknownPlaces, m: int, o: int, i: int
) -> tuple[complex, Complex[np.ndarray, " unknown"]]:
    """Residue at the pole of mode m (phi psi of a real constant), its terms added, and its derivatives."""
    model = covariance.model
    real = covariance.structure.real_constants and bool(model.is_pair[m])
    unit = 2j * float(model.poles[m].imag) if real else 1.0
    value, by = 0.0 + 0.0j, np.zeros(at.size, dtype=complex)
    for n in np.flatnonzero(model.poles == model.poles[m]):
        c, b = complex(model.shapes[o, n]) * unit, complex(model.participation[n, i])
        value += c * b
        for place, slope in ((at.c[o, n], b), (at.b[n, i], c)):
            for part, factor in zip(place, (1.0, 1j), strict=True):
                if part >= 0:
                    by[part] += factor * slope
    return value, by


def distinct_poles(model: MeasurementModel) -> list[int]:
    """The first mode of each pole: residues of full rank have a mode for each of their rank."""
    first = np.argmax(model.poles[:, None] == model.poles[None], axis=1)
    return [m for m, k in enumerate(first) if m == k]


def zero_deviation(
    covariance: ModelCovariance, zeros: Complex[np.ndarray, " zero"], *, output: str, input: str
) -> tuple[Float[np.ndarray, " zero"], Float[np.ndarray, " zero"]]:
    """Standard deviations of |z| / 2 pi [Hz] and of -Re z / |z| of the zeros [rad/s] of one entry of H.

    Infinite where the data do not determine the zero: one would be larger than |z| / 2 pi, or than one.
    By the implicit function theorem dz = -(dH / dx) / (dH / ds) at the zero; right for simple zeros that lie
    farther from each other, and from the real axis, than their deviations.

    Raises `ConfigError` for an unknown port.
    """
    model = _without_delay(covariance.model)
    channels = (model.outputs, output), (model.inputs, input)
    o, i = (port_indices(ports, [name], "channel")[0] for ports, name in channels)
    z = np.asarray(zeros, dtype=complex)
    # H is analytic: an imaginary step has no cancellation, and its error goes with its square.
    step = 1e-4 * np.abs(z).clip(min=np.finfo(float).tiny)
    entry = entry_slopes(model, covariance.structure, z, o, i)
    ahead, behind = (entry_slopes(model, covariance.structure, z + sign * step, o, i).H for sign in (1, -1))
    by = np.zeros((len(z), len(covariance.root)), dtype=complex)
    by[:, entry.place] = (-entry.by / ((ahead - behind) / (2.0 * step))).T
    size = np.abs(z)[:, None]
    along = np.real(z.conj()[:, None] * by) / size
    # The ratio of a real zero is one whatever moves.
    ratio = np.where(
        np.imag(z)[:, None] == 0.0, 0.0, -np.real(by) / size + np.real(z)[:, None] * along / size**2
    )
    frequency = _determined(covariance.deviation(along / (2.0 * np.pi)), np.abs(z) / (2.0 * np.pi))
    return frequency, np.where(np.isinf(frequency), np.inf, _determined(covariance.deviation(ratio), 1.0))


def _without_delay(model: MeasurementModel) -> MeasurementModel:
    """The model without delays, with the same zeros: exp(-s tau) overflows at a far zero."""
    path = None if model.path_delay_s is None else np.zeros_like(model.path_delay_s)
    return dataclasses.replace(model, delay_s=np.zeros_like(model.delay_s), path_delay_s=path)


def stated(deviation: Float[np.ndarray, " number"]) -> list[float | None]:
    """Deviations as a document has them: None where the data do not determine the number.

    >>> stated(np.array([0.5, np.inf]))
    [0.5, None]
    """
    return [float(value) if np.isfinite(value) else None for value in deviation]


def _determined(deviation: np.ndarray, largest: np.ndarray | float) -> np.ndarray:
    """Deviations, infinite where they exceed their own quantities: the data do not fix these.

    A comparison of sizes, which rounding moves where the two are equal only.
    """
    return np.where(deviation <= largest, deviation, np.inf)
