"""Frequency responses: measured or computed, on stated lines, with named ports."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, require_plant
from middeck.systems.poles.resolvent import evaluate_transfer
from middeck.systems.state_space.modal_system import ModalSystem, modal_response
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from middeck.values import record


@record
class ResponseCovariance:
    """Covariance of all entries of an estimated response on each line: E[dH_oi conj(dH_pj)] = C_op R_ij.

    Attributes:
        outputs: C, the covariance of what the outputs have beyond response to the inputs; noise of measured
            inputs is in it, through the response (Pintelon and Schoukens 2012, ch. 9: errors in variables).
        inverse_power: R, the inverse of the inputs' power over all experiments.
    """

    outputs: Complex[np.ndarray, "line output output"]
    inverse_power: Complex[np.ndarray, "line input input"]


@record(kw_only=True)
class FrequencyResponse:
    """Complex response H[line, output, input] at ``frequency_hz``.

    ``variance`` is that of the estimate H (noise of both real and imaginary part together), per line and
    entry; of a smoothed estimate, that of each line's own data, so that a sum over lines counts each sample
    once; None for a computed response. ``covariance`` says also how its entries err together, where known.
    ``hold_s`` is the period over which the inputs were held, whose hold is in H; zero where there is none in
    it, None where that is not known (`release_hold`); the inputs may then have been commands that were held
    over ``perhaps_held_s``. ``alike`` neighbouring lines show no more of the noise than one, as under a
    window: the sum of their squared correlations over all lags; one of whole periods, whose lines share
    nothing; None where that is not known, and one is taken. ``warnings`` are of faults that bias it and that
    no variance counts.
    """

    frequency_hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, "line output input"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    variance: Float[np.ndarray, "line output input"] | None = None
    covariance: ResponseCovariance | None = None
    hold_s: float | None = None
    perhaps_held_s: float | None = None
    alike: float | None = None
    warnings: tuple[str, ...] = ()


def statespace_response(
    system: StateSpace | SampledStateSpace, omega: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """C (p I - A)^-1 B + D with p = j omega, or exp(j omega T) for a sampled system; ``omega`` in rad/s.

    Many lines of a large system cost little more than its poles, see `middeck.systems.poles.resolvent`.
    """
    omega = np.asarray(omega, dtype=float)
    p = 1j * omega if system.period_s is None else np.exp(1j * omega * system.period_s)
    return evaluate_transfer(system, p)


@named_kinds
def evaluate_plant(plant: Plant, frequency_hz: Float[np.ndarray, " line"]) -> FrequencyResponse:
    """The plant's frequency response at ``frequency_hz``, all ports, delays exact.

    Raises `ConfigError` for a frequency that is not finite.
    """
    require_plant(plant)
    f = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
    if not np.all(np.isfinite(f)):
        raise ConfigError("a frequency is not finite", hint="numbers, in Hz")
    omega = 2.0 * np.pi * f
    dynamics = plant.dynamics
    on_time = (
        modal_response(dynamics, omega)
        if isinstance(dynamics, ModalSystem)
        else statespace_response(dynamics, omega)
    )
    H = on_time * np.exp(-1j * omega[:, None, None] * plant.delay_s) if plant.delayed else on_time
    return FrequencyResponse(
        frequency_hz=f, H=H, inputs=plant.inputs, outputs=plant.outputs, hold_s=plant.period_s or 0.0
    )


def in_band(response: FrequencyResponse, band_hz: tuple[float, float]) -> FrequencyResponse:
    """The lines of ``response`` within a band."""
    f = response.frequency_hz
    keep = (f >= band_hz[0]) & (f <= band_hz[1])
    known = response.covariance
    return dataclasses.replace(
        response,
        frequency_hz=f[keep],
        H=response.H[keep],
        variance=None if response.variance is None else response.variance[keep],
        covariance=None
        if known is None
        else ResponseCovariance(known.outputs[keep], known.inverse_power[keep]),
    )
