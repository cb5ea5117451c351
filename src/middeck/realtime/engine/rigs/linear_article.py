"""A linear article that the engine steps itself, with noise and faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.header import constants, layout
from middeck.realtime.package.core import Core
from middeck.realtime.package.modal_form import to_modal
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.values import record

FAULT_KINDS = (
    "sensor nan", "sensor add", "sensor stuck", "sensor drift", "sensor gain", "sensor late", "sensor drop",
    "sensor swap", "sensor noise", "encoder wrap", "output dead", "output gain", "output stuck",
    "output limit", "rig silent", "rig dies",
)  # fmt: skip


HERE = "linear article"
LATEST = 64
"""Samples of a sensor's past that the rig keeps."""


@record(kw_only=True)
class Fault:
    """A fault of the simulated article from one sample to another.

    Attributes:
        kind: One of `FAULT_KINDS`.
        channel: Place of the sensor, or of the output.
        start, end: Samples; ``end`` is excluded.
        value: What is added, the gain, rate per second, samples of delay, probability, other sensor, rms, or
            the magnitude at which an encoder wraps or an output is limited.
    """

    kind: str
    channel: int = 0
    start: int = 0
    end: int = 1 << 62
    value: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in FAULT_KINDS:
            raise ConfigError(f"no fault {self.kind!r}", hint=f"one of {', '.join(FAULT_KINDS)}")
        late = self.kind == "sensor late" and not 0.0 <= self.value < LATEST
        timed = 0 <= self.start < self.end <= 1 << 62
        if not timed or late or (self.kind == "encoder wrap" and not self.value > 0.0):
            raise ConfigError(
                f"{self.kind} of {self.value} from sample {self.start} to {self.end}",
                hint=f"a start before its end, a delay below {LATEST} samples, a wrap above zero",
            )


@record(kw_only=True)
class LinearArticle:
    """x+ = A x + B u + G w, y = C x + n between the ports of an engine, w white of variance one.

    Attributes:
        A, B, C, G: Matrices; ``pairs`` blocks of two states where A is modal, None where it is dense.
        x: Where it starts.
        sensor_noise: Rms of each sensor's white noise.
        seed: Seed of w and n.
        faults: What goes wrong, and when.
    """

    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state output"]
    C: Float[np.ndarray, "sensor state"]
    G: Float[np.ndarray, "state noise"]
    x: Float[np.ndarray, " state"]
    sensor_noise: Float[np.ndarray, " sensor"]
    pairs: int | None = None
    seed: int = 0
    faults: tuple[Fault, ...] = ()


def linear_article(
    plant: Plant,
    period_s: float,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    disturbed: Sequence[str] = (),
    disturbance_rms: float | Sequence[float] = 0.0,
    sensor_noise: float | Sequence[float] = 0.0,
    seed: int = 0,
) -> LinearArticle:
    """``plant`` sampled at the engine's rate, driven at ``inputs`` and read at ``outputs``.

    Args:
        disturbed, disturbance_rms: Inputs of the plant that white noise drives, held over each sample.
        sensor_noise: Rms of white noise at each output.

    Raises `ConfigError` for unknown ports, and for a plant whose outputs respond at once to its inputs: a
    sample cannot answer to the command that is computed from it.
    """
    sampled = sample_plant(plant, period_s) if plant.period_s is None else plant
    system = sampled.sampled
    columns, noisy = list(sampled.input_indices(tuple(inputs))), list(sampled.input_indices(tuple(disturbed)))
    rows = list(sampled.output_indices(tuple(outputs)))
    if np.any(system.D[np.ix_(rows, columns + noisy)]):
        raise ConfigError(
            "an output responds at once to an input",
            where=HERE,
            hint="a plant with a delay or a sensor's lag",
        )
    G = system.B[:, noisy] * np.broadcast_to(np.asarray(disturbance_rms, dtype=float), (len(noisy),))
    driven = np.hstack([system.B[:, columns], G])
    core = Core(
        A=system.A,
        B=driven,
        C=system.C[rows],
        D=np.zeros((len(rows), driven.shape[1])),
        E=np.zeros((len(driven), len(rows))),
        pairs=None,
    )
    core = to_modal(core) or core
    return LinearArticle(
        A=core.A,
        B=core.B[:, : len(columns)],
        C=core.C,
        G=core.B[:, len(columns) :],
        x=np.zeros(len(core.A)),
        sensor_noise=np.broadcast_to(np.asarray(sensor_noise, dtype=float), (len(rows),)).copy(),
        pairs=core.pairs,
        seed=seed,
    )


def encode_article(article: LinearArticle) -> tuple[np.ndarray, np.ndarray]:
    """The shared record and the numbers behind it; raises `ConfigError` for more faults than it can hold."""
    words = np.zeros((), layout("article"))
    n, most = len(article.A), constants()["FAULTS"]
    if not -1 << 63 <= article.seed < 1 << 63 or article.seed != int(article.seed):
        raise ConfigError(f"the seed {article.seed}", where=HERE, hint="a whole number of 64 bits")
    if len(article.faults) > most:
        raise ConfigError(f"{len(article.faults)} faults", where=HERE, hint=f"{most} at most")
    words["states"], words["pairs"] = n, -1 if article.pairs is None else article.pairs
    words["noises"], words["seed"] = article.G.shape[1], article.seed
    words["sensor_noise"][: len(article.C)] = article.sensor_noise
    words["faults"] = len(article.faults)
    for k, fault in enumerate(article.faults):
        _check_channel(article, fault)
        words["fault"][k] = (
            FAULT_KINDS.index(fault.kind),
            fault.channel,
            fault.start,
            fault.end,
            fault.value,
        )
    if article.pairs is None:
        dynamics = [article.A]
    else:
        first = np.arange(article.pairs)
        dynamics = [
            np.diag(article.A),
            article.A[first, first + article.pairs],
            article.A[first + article.pairs, first],
        ]
    parts = [*dynamics, article.B, article.C, article.G, article.x]
    numbers = np.concatenate([np.ravel(part, order="F") for part in parts])
    if not (np.isfinite(numbers).all() and np.isfinite(article.sensor_noise).all()):
        raise ConfigError("a number that is not finite", where=HERE, hint="finite A, B, C, G, x and noise")
    return words, numbers


def _check_channel(article: LinearArticle, fault: Fault) -> None:
    ports = article.B.shape[1] if fault.kind.startswith("output") else len(article.C)
    places = [fault.channel, *([fault.value] if fault.kind == "sensor swap" else [])]
    if not all(place in range(ports) for place in places):
        raise ConfigError(
            f"{fault.kind} at channel {', '.join(f'{place:g}' for place in places)}",
            where=HERE,
            hint=f"0 to {ports - 1}",
        )
