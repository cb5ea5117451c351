"""Modal parameters of a measured model: frequencies, damping, shapes, modal constants and masses.

A pair of poles with residue matrix r is the mode

    A / (s^2 + 2 zeta omega s + omega^2), with the modal constant A = 2 j omega_d r

and a term in s if A is complex. A_oi = phi_o phi_i / m for a displacement from a force (Ewins 2000, ch. 4).
Where output and input are one point and direction, A there is phi^2 / m: it gives the size of the shape, and
so the modal mass.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, FitError
from middeck.identification.fit.fit_response import FitResult
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio, natural_hz
from middeck.signals.ports import Port, port_indices
from middeck.values import record


@record(kw_only=True)
class ModalParameters:
    """Modes in rising frequency; real poles and rigid modes are not among them.

    Attributes:
        natural_hz, damping: |pole| / 2 pi [Hz] and damping ratio.
        constants: Complex modal constants A [output/input times (rad/s)^2]; real for a lightly damped
            structure.
        shapes: Complex shapes over the outputs, each turned so that it is as real as it can be, with unit
            modal mass if a drive point was given, otherwise with a largest entry of size one.
        real_shapes: Their real parts, whose largest entry is positive (the masses that the sign rule of
            models weighs by are not known here).
        modal_mass: Modal mass for the shape that is one at the drive point, 1 / A there [kg for m from N];
            None without one.
        complexity: Modal phase collinearity (Juang and Pappa 1985): 1 for a real shape, 0 for a travelling
            wave.
        mac: |phi_m^H phi_n|^2 / (phi_m^H phi_m phi_n^H phi_n) of the complex shapes (Allemang and Brown
            1982).
    """

    natural_hz: Float[np.ndarray, " mode"]
    damping: Float[np.ndarray, " mode"]
    constants: Complex[np.ndarray, "mode output input"]
    shapes: Complex[np.ndarray, "output mode"]
    real_shapes: Float[np.ndarray, "output mode"]
    modal_mass: Float[np.ndarray, " mode"] | None
    complexity: Float[np.ndarray, " mode"]
    mac: Float[np.ndarray, "mode mode"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


def modal_parameters(
    fitted: FitResult | MeasurementModel, *, drive_point: tuple[str, str] | None = None
) -> ModalParameters:
    """Modal parameters of a fit or of its model.

    Args:
        drive_point: (output, input) by name that are one point and direction, a displacement and a force.

    Raises `ConfigError` for a drive point that the model does not have, or a model without a pair of poles;
    `FitError` if the modal constant of some mode at the drive point is not positive: then it is none.

    >>> zero = np.zeros((1, 1))                        # 1 / (4 (s^2 + ...)): a mass of 4 kg at 10 rad/s
    >>> model = MeasurementModel(
    ...     poles=[-0.1 + 10j], shapes=[[1 / 80j]], participation=[[1.0]], direct=zero, lower=zero,
    ...     delay_s=[0.0], inputs=(Port("force", "N"),), outputs=(Port("tip", "m"),))
    >>> round(float(modal_parameters(model, drive_point=("tip", "force")).modal_mass[0]), 9)
    4.0
    """
    model = fitted.model if isinstance(fitted, FitResult) else fitted
    pairs = np.flatnonzero(model.is_pair)
    if not len(pairs):
        raise ConfigError("a model without a pair of poles has no mode", hint="fit more states")
    pairs = pairs[np.argsort(natural_hz(model)[pairs])]
    constants = _constants(model, pairs)
    # A residue of rank one has one shape, seen from any input.
    shapes = np.stack([np.linalg.svd(A)[0][:, 0] for A in constants], axis=1)
    mass = None
    if drive_point is None:
        shapes = shapes / np.max(np.abs(shapes), axis=0)
    else:
        output = port_indices(model.outputs, [drive_point[0]], "output")[0]
        driven = port_indices(model.inputs, [drive_point[1]], "input")[0]
        at_point = _positive(np.real(constants[:, output, driven]), natural_hz(model)[pairs], drive_point)
        shapes = shapes / shapes[output] * np.sqrt(at_point)
        mass = 1.0 / at_point
    turned = shapes * np.exp(-0.5j * np.angle(np.sum(shapes**2, axis=0)))
    largest = np.argmax(np.abs(turned.real), axis=0)
    turned = turned * np.where(np.take_along_axis(turned.real, largest[None], axis=0) < 0.0, -1.0, 1.0)
    size = np.sum(np.abs(turned) ** 2, axis=0)
    return ModalParameters(
        natural_hz=natural_hz(model)[pairs],
        damping=damping_ratio(model)[pairs],
        constants=constants,
        shapes=turned,
        real_shapes=turned.real,
        modal_mass=mass,
        complexity=np.abs(np.sum(turned**2, axis=0)) ** 2 / np.sum(np.abs(turned) ** 2, axis=0) ** 2,
        mac=np.abs(turned.conj().T @ turned) ** 2 / np.outer(size, size),
        inputs=model.inputs,
        outputs=model.outputs,
    )


def _constants(model: MeasurementModel, pairs: np.ndarray) -> Complex[np.ndarray, "mode output input"]:
    poles = model.poles[pairs]
    residues = model.shapes.T[pairs, :, None] * model.participation[pairs, None, :]
    if model.sample_hz is not None:
        # A held input: r / (s - p) is sampled to r (exp(p T) - 1) / p / (z - exp(p T)).
        residues = residues * (poles / np.expm1(poles / model.sample_hz))[:, None, None]
    return 2j * np.imag(poles)[:, None, None] * residues


def _positive(at_point: np.ndarray, hz: np.ndarray, drive_point: tuple[str, str]) -> np.ndarray:
    if np.any(at_point <= 0.0):
        wrong = ", ".join(f"{f:.4g} Hz" for f in hz[at_point <= 0.0])
        raise FitError(
            f"the modal constant is not positive at {wrong}",
            where=f"drive point {drive_point[0]} from {drive_point[1]}",
            hint="the same point and direction, a displacement from a force, and modes that move it",
        )
    return at_point
