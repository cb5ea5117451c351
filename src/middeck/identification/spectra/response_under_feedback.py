"""Records taken in a closed loop: fed-back signals are not taken for excitation.

With u = r + K y (docs/conventions.md: the minus sign is in K) and noise v at the output, u and v are
correlated through K, and the direct estimate tends to

    S_yu / S_uu = (G S_rr + conj(K) S_vv) / (S_rr + |K|^2 S_vv),

between G and 1/K, nearer to the latter the less the reference does. From the reference, which no noise knows,
both u and y are responses, and G is their ratio (joint input-output method; Wellstead 1981, Pintelon and
Schoukens 2012, section 2.6.4):

    G = H_yr H_ur^-1,    dG = [I, -G] (dH_yr; dH_ur) H_ur^-1.

A known controller gives the reference, r = u - K y line by line, and the same estimate follows. Solving the
closed loop for G with K instead (indirect method) would turn every error of K and of the sensors' gains into
an error of G.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError
from middeck.identification.spectra.excited_lines import WORST_CONDITION, refuse_alike
from middeck.identification.spectra.variance_of_lines import ResponseScatter, variance_of
from middeck.signals.ports import Port, port_indices
from middeck.signals.record import Record, RecordStream
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

# Below this share of the input, what is left of it beside K y is rounding of K and of the samples.
FAINTEST_REFERENCE = 1e-6

Controller = StateSpace | SampledStateSpace
Reference = Sequence[str] | Float[np.ndarray, "experiment period sample reference"]


def plant_ports(
    record: Record | RecordStream, reference: Reference | None
) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
    """The inputs and outputs that are not references; raises `ConfigError` if none is left on a side."""
    named = set[str]() if reference is None or isinstance(reference, np.ndarray) else set(reference)
    both = named & {p.name for p in record.inputs} & {p.name for p in record.outputs}
    if both:
        raise ConfigError(f"{', '.join(sorted(both))} is an input and an output", hint="rename one of them")
    inputs, outputs = (
        tuple(p for p in side if p.name not in named) for side in (record.inputs, record.outputs)
    )
    if not (inputs and outputs):
        raise ConfigError("the references leave no input or no output", hint="name references only")
    return inputs, outputs


def from_channels(record: Record | RecordStream, names: Sequence[str]) -> Record | RecordStream:
    """The record with the named channels as inputs, and the outputs and remaining inputs as outputs."""
    ports = (*record.inputs, *record.outputs)
    picked = port_indices(ports, list(names), "channel")
    wide = len(record.inputs)
    rest = [wide + k for k in range(len(record.outputs))] + list(range(wide))
    left = [k for k in rest if k not in picked]
    inputs, outputs = tuple(ports[k] for k in picked), tuple(ports[k] for k in left)
    if isinstance(record, Record):
        z = np.concatenate([record.u, record.y], axis=3)
        return Record(
            sample_hz=record.sample_hz,
            u=z[..., picked],
            y=z[..., left],
            inputs=inputs,
            outputs=outputs,
            periodic=record.periodic,
        )
    source = record

    def pieces(experiment: int, size: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for u, y in source.pieces(experiment, size):
            z = np.concatenate([u, y], axis=1)
            yield z[:, picked], z[:, left]

    return RecordStream(
        sample_hz=source.sample_hz,
        inputs=inputs,
        outputs=outputs,
        samples=source.samples,
        experiments=source.experiments,
        period=source.period,
        pieces=pieces,
    )


def from_signal(record: Record, reference: Float[np.ndarray, "experiment period sample reference"]) -> Record:
    """The record with a given reference as input, and its outputs and inputs as outputs."""
    if reference.ndim != 4 or reference.shape[:3] != record.u.shape[:3]:
        raise DataError(
            f"the reference has the shape {reference.shape}, the inputs {record.u.shape}",
            hint="[experiment, period, sample, reference]",
        )
    ports = tuple(Port(f"reference {k + 1}", "") for k in range(reference.shape[3]))
    z = np.concatenate([record.y, record.u], axis=3)
    return Record(
        sample_hz=record.sample_hz,
        u=reference,
        y=z,
        inputs=ports,
        outputs=(*record.outputs, *record.inputs),
        periodic=record.periodic,
    )


def from_controller(record: Record, controller: Controller) -> Record:
    """The record with r = u - K y as input.

    K multiplies the lines of the DFT. Its initial state thereby becomes a transient of the reference, which
    is as smooth over lines as any other, and local models fit it.
    """
    outputs, inputs = record.y.shape[3], record.u.shape[3]
    if controller.D.shape != (inputs, outputs):
        raise ConfigError(
            f"the controller has {controller.D.shape[1]} inputs and {controller.D.shape[0]} outputs",
            hint=f"from the record's {outputs} outputs to its {inputs} inputs",
        )
    if isinstance(controller, SampledStateSpace) and not np.isclose(
        controller.period_s * record.sample_hz, 1.0, rtol=1e-9
    ):
        raise ConfigError(
            f"the controller is sampled every {controller.period_s:g} s, the record at "
            f"{record.sample_hz:g} Hz",
            hint="the controller as it ran, at the rate of the record",
        )
    samples = record.u.shape[2]
    frequency = np.fft.rfftfreq(samples, 1.0 / record.sample_hz)
    U, Y = (np.fft.rfft(x, axis=2) for x in (record.u, record.y))
    K = np.zeros((len(frequency), inputs, outputs), dtype=complex)
    # Zero carries no response, and an integrator has none there.
    K[1:] = statespace_response(controller, 2.0 * np.pi * frequency[1:])
    R = U - np.einsum("kio,epko->epki", K, Y)
    if np.abs(R[:, :, 1:]).max() <= FAINTEST_REFERENCE * np.abs(U[:, :, 1:]).max():
        raise DataError(
            "the input is all feedback, K y: without a reference a record tells 1/K, not the plant",
            hint="inject a test signal at the plant's input",
        )
    return from_signal(record, np.fft.irfft(R, n=samples, axis=2))


def plant_scatter(found: ResponseScatter, outputs: int) -> ResponseScatter:
    """Response of y to u from the response of (y, u) to the reference."""
    H_y, H_u = found.H[:, :outputs], found.H[:, outputs:]
    lines, inputs, references = H_u.shape
    if references < inputs:
        raise DataError(
            f"{references} references cannot tell {inputs} inputs apart",
            hint="a reference of its own for each input",
        )
    size = np.linalg.svd(H_u, compute_uv=False)
    refuse_alike(size[:, -1] * WORST_CONDITION <= size[:, 0], found.frequency_hz)
    W = np.linalg.pinv(H_u)
    G = H_y @ W
    beside = np.concatenate([np.broadcast_to(np.eye(outputs), (lines, outputs, outputs)), -G], axis=2)

    def at_input(R: np.ndarray) -> np.ndarray:
        return W.mT @ R @ W.conj()

    inverse_power = at_input(found.inverse_power)

    def through(covariance: np.ndarray | None) -> np.ndarray | None:
        return None if covariance is None else beside @ covariance @ beside.conj().mT

    noise, total = through(found.noise_covariance), through(found.total_covariance)
    return ResponseScatter(
        frequency_hz=found.frequency_hz,
        H=G,
        noise=None if noise is None else variance_of(noise, inverse_power),
        total=None if total is None else variance_of(total, inverse_power),
        noise_dof=found.noise_dof,
        total_dof=found.total_dof,
        noise_covariance=noise,
        total_covariance=total,
        inverse_power=inverse_power,
        line_inverse_power=None if found.line_inverse_power is None else at_input(found.line_inverse_power),
        warnings=found.warnings,
    )
