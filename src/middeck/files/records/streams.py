"""Record files read piece by piece."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from middeck.errors import DataError
from middeck.files.records.columns import Columns
from middeck.files.records.raw import Chosen, Raw, choose, sampling_rate
from middeck.signals.record import RecordStream

Pieces = Iterator[tuple[np.ndarray, np.ndarray]]


def stream_npz(file: Path, columns: Columns | None) -> RecordStream:
    """NPZ, compressed or not."""
    from middeck.files.records.npz import head_npz, pieces_npz

    return _stream_tables(file, columns, head_npz(file), partial(pieces_npz, file))


def stream_hdf5(file: Path, columns: Columns | None) -> RecordStream:
    """HDF5 in the package's layout."""
    from middeck.files.records.hdf5 import head_hdf5, pieces_hdf5

    return _stream_tables(file, columns, head_hdf5(file), partial(pieces_hdf5, file))


def stream_csv(file: Path, columns: Columns | None) -> RecordStream:
    """CSV, line by line."""
    from middeck.files.records.csv_text import head_csv, pieces_csv

    head = head_csv(file)
    return _stream_tables(file, columns, head, lambda _, size: pieces_csv(file, head[0].sample_hz, size))


def _stream_tables(
    file: Path,
    columns: Columns | None,
    head: tuple[Raw, tuple[int, int, int]],
    tables: Callable[[int, int], Iterator[np.ndarray]],
) -> RecordStream:
    """A stream from tables of all channels, of one experiment and of so many samples."""
    raw, shape = head
    chosen = choose(raw.heads, columns, str(file))

    def pieces(experiment: int, size: int) -> Pieces:
        for table in tables(experiment, size):
            yield table[:, list(chosen.u)], table[:, list(chosen.y)]

    return _stream(raw, shape, chosen, columns, file, pieces)


def stream_uff(file: Path, columns: Columns | None) -> RecordStream:
    """Universal file: each channel where it stands."""
    from middeck.files.records.uff import pieces_channel, read_runs

    runs = read_runs(file)
    if len({(r.samples, r.sample_hz, r.periods, r.heads) for r in runs}) > 1:
        raise DataError(
            "experiments of unlike lengths",
            where=str(file),
            hint="cut them to one length; load_campaign takes them",
        )
    first = runs[0]
    raw = Raw(
        sample_hz=first.sample_hz,
        heads=first.heads,
        x=(),
        periodic=first.periods is not None,
        held=first.held,
    )
    chosen = choose(first.heads, columns, str(file))

    def pieces(experiment: int, size: int) -> Pieces:
        at = [pieces_channel(file, runs[experiment], k, size) for k in (*chosen.u, *chosen.y)]
        for together in zip(*at, strict=True):
            table = np.column_stack(together)
            yield table[:, : len(chosen.u)], table[:, len(chosen.u) :]

    shape = (len(runs), first.periods or 1, first.samples // (first.periods or 1))
    return _stream(raw, shape, chosen, columns, file, pieces)


def _stream(
    raw: Raw,
    shape: tuple[int, int, int],
    chosen: Chosen,
    columns: Columns | None,
    file: Path,
    pieces: Callable[[int, int], Pieces],
) -> RecordStream:
    experiments, periods, samples = shape
    rate = sampling_rate(raw, columns, str(file))
    period = samples if raw.periodic else None

    def placed(experiment: int, size: int) -> Pieces:
        if not 0 <= experiment < experiments:
            what = f"no experiment {experiment}"
            raise DataError(what, where=str(file), hint=f"counted from 0, there are {experiments}")
        return pieces(experiment, size)

    count = periods * samples
    return RecordStream(
        sample_hz=rate,
        inputs=chosen.inputs,
        outputs=chosen.outputs,
        samples=count,
        experiments=experiments,
        period=period,
        pieces=placed,
        held=raw.held,
    )
