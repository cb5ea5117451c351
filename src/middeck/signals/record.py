"""Time data: synchronised inputs and outputs of one or several experiments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from numbers import Real

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError
from middeck.signals.ports import Port, same_ports
from middeck.values import record, require_kind

Samples = Float[np.ndarray, "sample channel"]


@record(kw_only=True)
class Record:
    """Sampled inputs and outputs.

    Attributes:
        sample_hz: Sampling rate, common to all channels.
        u, y: Input and output samples. Several experiments share the test article, not the signals. With
            ``periodic`` true, the samples of an experiment are whole steady periods of one repeated input;
            otherwise there is one period, the record itself.
        held: Whether each input was held from its sample to the next, as a computer commands it; False:
            measured behind the same filters as the outputs; None where that is not known.

    Raises `DataError` for a rate that none can be, and `ConfigError` for a port that is none.
    """

    sample_hz: float
    u: Float[np.ndarray, "experiment period sample input"]
    y: Float[np.ndarray, "experiment period sample output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    periodic: bool
    held: bool | None = None

    def __post_init__(self) -> None:
        _require_rate_and_ports(self)


@record
class Campaign:
    """Records of one test article with the same channels and rate, of any lengths.

    Raises `DataError` if there is none, or if rates or ports differ. Records of equal length and kind fit in
    one `Record`, whose experiments they are.
    """

    records: tuple[Record, ...]

    def __post_init__(self) -> None:
        if not self.records:
            raise DataError("no record given", hint="name at least one file")
        first = self.records[0]
        for number, other in enumerate(self.records):
            where = f"record {number}"
            if other.sample_hz != first.sample_hz:
                what = f"sampled at {other.sample_hz:g} Hz, the first at {first.sample_hz:g} Hz"
                raise DataError(what, where=where, hint="resample one of them")
            if not (same_ports(other.inputs, first.inputs) and same_ports(other.outputs, first.outputs)):
                named = ", ".join(p.name for p in (*other.inputs, *other.outputs))
                raise DataError(
                    f"channels differ from those of the first record: {named}",
                    where=where,
                    hint="use the same names in all records",
                )


@record(kw_only=True)
class RecordStream:
    """A record read piece by piece, so that it may be longer than memory.

    Attributes:
        sample_hz, inputs, outputs: As of a `Record`.
        samples: Samples in each experiment, all its periods together.
        experiments: Number of experiments.
        period: Samples of a period if the samples are whole steady periods, otherwise None.
        pieces: ``pieces(experiment, size)`` reads u[sample, input] and y[sample, output] from the start, at
            most ``size`` samples at a time.
        held: As of a `Record`.
    """

    sample_hz: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    samples: int
    experiments: int
    period: int | None
    pieces: Callable[[int, int], Iterator[tuple[np.ndarray, np.ndarray]]]
    held: bool | None = None

    def blocks(self, size: int, experiment: int = 0) -> Iterator[tuple[Samples, Samples]]:
        """u[sample, input] and y[sample, output] of ``size`` samples each; the last may be shorter.

        Raises `DataError` for a sample that is not a finite number, and if the file ends early.
        """
        taken = 0
        for u, y in _regrouped(self.pieces(experiment, size), size):
            for ports, x in ((self.inputs, u), (self.outputs, y)):
                _check_finite(x, ports, experiment, taken)
            taken += len(u)
            yield u, y
        if taken != self.samples:
            raise DataError(
                f"truncated: {taken} of {self.samples} samples", where=f"experiment {experiment}",
                hint="copy or record it again",
            )  # fmt: skip


def stream_record(whole: Record) -> RecordStream:
    """A record in memory as a stream.

    >>> ports = (Port("u", "V"),), (Port("y", "m"),)
    >>> whole = Record(sample_hz=2.0, u=np.zeros((1, 1, 5, 1)), y=np.ones((1, 1, 5, 1)), inputs=ports[0],
    ...     outputs=ports[1], periodic=False)
    >>> [y[:, 0].tolist() for u, y in stream_record(whole).blocks(3)]
    [[1.0, 1.0, 1.0], [1.0, 1.0]]
    """
    experiments, periods, samples, _ = whole.u.shape

    def pieces(experiment: int, size: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        u, y = (x[experiment].reshape(periods * samples, -1) for x in (whole.u, whole.y))
        return ((u[k : k + size], y[k : k + size]) for k in range(0, len(u), size))

    period = samples if whole.periodic else None
    return RecordStream(
        sample_hz=whole.sample_hz,
        inputs=whole.inputs,
        outputs=whole.outputs,
        samples=periods * samples,
        experiments=experiments,
        period=period,
        pieces=pieces,
        held=whole.held,
    )


def _require_rate_and_ports(run: Record) -> None:
    hz = run.sample_hz
    if isinstance(hz, np.ndarray) and hz.ndim == 0:  # as np.load gives it
        hz = run.__dict__["sample_hz"] = hz.item()
    hint = "sample_hz, a number in Hz"
    require_kind(hz, Real, "sampling rate", hint)
    if isinstance(hz, bool):
        raise ConfigError("a truth value stands in place of the sampling rate", hint=hint)
    if not (np.isfinite(hz) and hz > 0.0):
        raise DataError(f"a sampling rate of {hz} Hz is not possible", hint="sample_hz > 0 Hz, finite")
    for side, ports in (("inputs", run.inputs), ("outputs", run.outputs)):
        require_kind(ports, tuple, side, "a tuple of one Port for each channel")
        for port in ports:
            require_kind(port, Port, f"port among the {side}", "Port(name, unit)")


def _regrouped(
    pieces: Iterator[tuple[np.ndarray, np.ndarray]], size: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pieces of any length as blocks of ``size`` samples."""
    u, y = np.empty((0, 0)), np.empty((0, 0))
    for more_u, more_y in pieces:
        u, y = (np.concatenate([x, m]) if len(x) else m for x, m in ((u, more_u), (y, more_y)))
        while len(u) >= size:
            yield u[:size], y[:size]
            u, y = u[size:], y[size:]
    if len(u):
        yield u, y


def _check_finite(x: np.ndarray, ports: tuple[Port, ...], experiment: int, start: int) -> None:
    bad = np.argwhere(~np.isfinite(x))
    if len(bad):
        sample, channel = bad[0]
        raise DataError(
            f"{len(bad)} samples are not finite numbers, the first in experiment {experiment}, sample "
            f"{start + sample}",
            where=f"channel {ports[channel].name}",
            hint="cut the record before the gap or repair the channel",
        )
