"""Expected accuracy of a test, before it is run: the Cramer-Rao bound of its excitation.

With white noise of rms sigma_o on the samples of output o, the transform of a period of N samples has the
complex variance N sigma_o^2, and the average of P periods a P-th of it. The output of experiment e is
Y_e = H U_e, so that the information on the unknowns x is

    sum over lines, experiments and outputs of 2 Re[(dY/dx)^H (dY/dx)] P / (N sigma_o^2)

and its inverse the least covariance of any unbiased estimate (Pintelon and Schoukens 2012, section 9.12). No
estimate of the response stands between: inputs need not be orthogonal for the bound to hold.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.model.plant_model import model_of_plant
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, places_of
from middeck.identification.uncertainty.orthogonal import canonical_root, factor_of, inverse_root
from middeck.identification.uncertainty.parameter_deviations import (
    ParameterDeviations,
    modal_constant,
    uncertainty_of,
)
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.signals.excitation.recognition import recognise_excitation
from middeck.signals.excitation.signal import Excitation
from middeck.signals.record import Record
from middeck.systems.plants.plant import Plant
from middeck.values import record

# Real part of a residue of displacement, as a share of its size, that is rounding.
ROUNDING = 1e-9


@record(kw_only=True)
class ExpectedAccuracy:
    """Accuracy of a test of so many periods, if its noise is the only disturbance.

    Attributes:
        covariance: Joint covariance of all unknowns: `response_bounds`, `sample_models` and others take it.
        uncertainty: Standard deviations of natural frequencies, damping ratios and delays.
        gain: Standard deviation of each modal constant as a share of its size; infinite for a constant of
            zero.
        error: Expected relative complex error of each output, sqrt(sum E|dH|^2 / sum |H|^2) over
            ``scored_hz``.
        periods: Number of periods of each experiment.
        duration_s: Duration of all experiments together, without waiting for the steady state.
    """

    covariance: ModelCovariance
    uncertainty: ParameterDeviations
    gain: Float[np.ndarray, "output mode input"]
    error: Float[np.ndarray, " output"]
    periods: int
    duration_s: float


@named_kinds
def expected_accuracy(
    model: MeasurementModel | Plant,
    command: Excitation | Record,
    noise_rms: Float[np.ndarray, " output"] | float,
    *,
    periods: int = 1,
    delay_s: float = 0.0,
    structure: ModelStructure | None = None,
    scored_hz: Float[np.ndarray, " line"] | None = None,
) -> ExpectedAccuracy:
    """Standard deviations that a fit of ``model`` would have after the test, by the Cramer-Rao bound.

    Args:
        model: The assumed truth: a plant of a structure (with the delay ``delay_s`` of the test), or a model
            of an earlier record.
        command: A designed excitation, or a record whose inputs are to be used again. What a hold takes from
            held samples (those of a design, and of a record that says so) counts for a plant, and for a model
            that is of what is behind a hold (``hold_s``); any other has it in its constants.
        noise_rms: Rms of the white noise on each output's samples.
        periods: Steady periods of each experiment; one for a signal that does not repeat, whose transient is
            then taken as known (it costs as many unknowns as states, of all lines).
        structure: What will be free in the fit; as `fit_response` would choose by default: real constants and
            delays where the model has real constants, otherwise complex constants without a delay, and the
            constant terms that the model has.
        scored_hz: Frequencies [Hz] of the expected error of the response; by default the excited lines.

    Raises `ConfigError` for a number of inputs or noises that does not fit, a noise that is not positive, no
    period, a delay beside a model that has its own, or a test that leaves an unknown undetermined.
    """
    if not 0.0 <= delay_s < np.inf or (delay_s > 0.0 and not isinstance(model, Plant)):
        raise ConfigError(
            f"delay_s = {delay_s}: the delay of the test beyond a plant's own, from 0 s, finite",
            hint="give it with a plant; a model has its own (delay_s, path_delay_s)",
        )
    behind_hold = isinstance(model, Plant) or model.hold_s is not None
    if isinstance(model, Plant):
        model = model_of_plant(model, delay_s=delay_s)
    structure = structure_of(model) if structure is None else structure
    u, lines, sample_hz, held = _samples(command)
    outputs, inputs = model.direct.shape
    noise = np.broadcast_to(np.asarray(noise_rms, dtype=float), (outputs,))
    _check(u, inputs, noise, periods)
    samples = u.shape[1]
    U = np.moveaxis(np.fft.rfft(u, axis=1)[:, lines], 1, 0)
    if held and behind_hold:
        U = U * np.sinc(lines / samples)[:, None, None]
    s = 2j * np.pi * lines * sample_hz / samples
    F = factor_of(_blocks(model, structure, s, U, samples * noise**2 / periods))
    root, inflation = _inverse(F)
    covariance = ModelCovariance(
        model=model, structure=structure, root=root, inflation=inflation, degrees=float("inf"), robust=False
    )
    scored = np.imag(s) / (2.0 * np.pi) if scored_hz is None else np.asarray(scored_hz, dtype=float)
    return ExpectedAccuracy(
        covariance=covariance,
        uncertainty=uncertainty_of(covariance),
        gain=_gain(covariance),
        error=_error(covariance, scored),
        periods=periods,
        duration_s=len(u) * periods * samples / sample_hz,
    )


def structure_of(model: MeasurementModel) -> ModelStructure:
    """The structure that a fit of such a model has by default."""
    residue = np.einsum("om,mi->omi", model.shapes, model.participation)[:, model.is_pair]
    real = model.sample_hz is None and bool(
        np.all(np.abs(residue.real) <= ROUNDING * np.abs(residue).max(initial=0.0))
    )
    return ModelStructure(
        real_constants=real,
        with_delay=real,
        with_lower=bool(np.any(model.lower)),
        with_direct=bool(np.any(model.direct)) or not real,
    )


def _samples(command: Excitation | Record) -> tuple[np.ndarray, np.ndarray, float, bool]:
    """One period of each experiment, excited lines, rate, and whether samples are held until the next.

    Zero and Nyquist have no phase.
    """
    held = isinstance(command, Excitation) or bool(command.held)
    if isinstance(command, Excitation):
        u, lines = command.u, command.lines
    else:
        u = command.u.mean(axis=1)
        lines = recognise_excitation(command).lines if command.periodic else np.arange(u.shape[1] // 2)
    return u, lines[(lines > 0) & (2 * lines < u.shape[1])], command.sample_hz, held


def _check(u: np.ndarray, inputs: int, noise: np.ndarray, periods: int) -> None:
    if u.shape[2] != inputs:
        raise ConfigError(f"the signal has {u.shape[2]} inputs, the model {inputs}", hint="choose its ports")
    if not (np.isfinite(noise).all() and np.all(noise > 0.0)):
        raise ConfigError(f"noise of rms {noise.tolist()}", hint="a positive rms for each output")
    if periods < 1:
        raise ConfigError(f"a test of {periods} periods", hint="one or more")


def _blocks(
    model: MeasurementModel,
    structure: ModelStructure,
    s: Complex[np.ndarray, " line"],
    U: Complex[np.ndarray, "line experiment input"],
    variance: Float[np.ndarray, " output"],
) -> Iterator[Float[np.ndarray, "row unknown"]]:
    """Derivatives of each output's spectra over their deviations."""
    size = places_of(model, structure).size
    for o in range(len(model.outputs)):
        slopes = np.zeros((size, len(s), U.shape[1]), dtype=complex)
        for i in range(len(model.inputs)):
            entry = entry_slopes(model, structure, s, o, i)
            slopes[entry.place] += entry.by[:, :, None] * U[None, :, :, i]
        yield (np.sqrt(2.0 / variance[o]) * slopes.reshape(size, -1)).view(float).T


def _inverse(F: Float[np.ndarray, "row unknown"]) -> tuple[np.ndarray, np.ndarray]:
    """A root of the covariance and each unknown's inflation by the others; refused where it has none."""
    alone = np.linalg.norm(F, axis=0)
    root, loose = inverse_root(F)
    if not alone.all() or loose:
        raise ConfigError(
            "the test leaves unknowns of the model undetermined",
            hint="a band that holds all its modes, as many independent experiments as inputs, a longer "
            "period, or fewer unknowns (structure)",
        )
    return canonical_root(root), (alone * np.linalg.norm(root, axis=1)) ** 2


def _gain(covariance: ModelCovariance) -> Float[np.ndarray, "output mode input"]:
    model = covariance.model
    at = covariance.at
    outputs, inputs = model.direct.shape
    gain = np.full((outputs, len(model.poles), inputs), np.inf)
    for o, m, i in np.ndindex(gain.shape):
        value, by = modal_constant(covariance, at, m, o, i)
        if value:
            # Along the constant: its size, not its phase.
            along = np.real(by * np.conj(value)) / abs(value) ** 2
            gain[o, m, i] = np.linalg.norm(along @ covariance.root)
    return gain


def _error(
    covariance: ModelCovariance, scored_hz: Float[np.ndarray, " line"]
) -> Float[np.ndarray, " output"]:
    model = covariance.model
    left, size = np.zeros(len(model.outputs)), np.zeros(len(model.outputs))
    for o, i in np.ndindex(model.direct.shape):
        entry = entry_slopes(model, covariance.structure, 2j * np.pi * scored_hz, o, i)
        left[o] += float(np.sum(np.abs(covariance.root[entry.place].T @ entry.by) ** 2))
        size[o] += float(np.sum(np.abs(entry.H) ** 2))
    return np.sqrt(left / size)
