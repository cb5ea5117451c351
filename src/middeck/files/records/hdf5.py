"""HDF5 records in the package's layout, chunked along the samples, whole or in pieces; and plain matrices."""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from middeck.errors import DataError
from middeck.files.disk.atomic import replacing
from middeck.files.records.own_layout import build_raw, check_samples, contents_of, describe, is_own
from middeck.files.records.raw import Raw, raw_matrix
from middeck.signals.record import Record, RecordStream

# Samples in a chunk: half a megabyte for eight channels, so that a block of a Welch estimate is a few chunks.
CHUNK = 8192
# Deflate makes at most 1032 bytes of one (zlib's technical notes).
MOST_COMPRESSED = 1032


def read_hdf5(file: Path, variable: str) -> Raw:
    """A record of the package's layout, or the matrix ``variable``."""
    with opened(file) as archive:
        names = [k for k in archive if isinstance(archive[k], h5py.Dataset)]
        if is_own(names) and not variable:
            return build_raw({k: plain(archive[k]) for k in names}, str(file))
        return raw_matrix(plain(archive[pick({k: archive[k] for k in names}, variable, file)]), file)


def pick(arrays: Mapping[str, Any], variable: str, file: Path) -> str:
    """The matrix to take: ``variable``, or the only one there is."""
    if variable in arrays:
        return variable
    if variable or len(arrays) != 1:
        what = f"no variable {variable!r}" if variable else f"{len(arrays)} variables"
        held = ", ".join(f"{name} {_shape(x.shape)}" for name, x in arrays.items()) or "nothing"
        raise DataError(what, where=str(file), hint=f'it holds {held}; choose with variable="NAME"')
    return next(iter(arrays))


def _shape(shape: Sequence[int]) -> str:
    return "x".join(map(str, shape)) or "of one value"


def plain(dataset: Any) -> np.ndarray:
    """The array in a dataset, texts as texts; raises `ValueError` where the file does not hold its samples.

    Samples never written, or lost, would be read as zeros, and a corrupt size without end.
    """
    check_stored(dataset)
    return np.asarray(dataset.asstr()[()] if h5py.check_string_dtype(dataset.dtype) else dataset[()])


def check_stored(dataset: Any) -> None:
    """Raise `ValueError` if the file holds fewer bytes than the dataset has."""
    stored, size = dataset.id.get_storage_size(), dataset.size * dataset.dtype.itemsize
    least = size if dataset.compression is None else size // MOST_COMPRESSED
    if stored < least or (size and not stored):
        raise ValueError(f"{dataset.name} has {stored} of {size} bytes")


def write_hdf5(path: Path, record: Record) -> None:
    """Write ``record`` (double precision)."""
    with replacing(path) as temporary, h5py.File(temporary, "w") as archive:
        for key, value in contents_of(record).items():
            samples = key in ("u", "y") and value.size
            chunks = (1, 1, min(CHUNK, value.shape[2]), value.shape[3]) if samples else None
            archive.create_dataset(key, data=_storable(value), chunks=chunks, fletcher32=bool(samples))


def write_hdf5_stream(path: Path, stream: RecordStream) -> None:
    """Write a stream block by block: no more than a chunk of it is held."""
    shape = (stream.experiments, 1, stream.samples)
    if stream.period:
        shape = (stream.experiments, stream.samples // stream.period, stream.period)
    with replacing(path) as temporary, h5py.File(temporary, "w") as archive:
        attributes = describe(
            stream.sample_hz, stream.period is not None, stream.inputs, stream.outputs, stream.held
        )
        for key, value in attributes.items():
            archive.create_dataset(key, data=_storable(value))
        u, y = (
            archive.create_dataset(
                key, (*shape, n), float, chunks=(1, 1, min(CHUNK, shape[2]), n), fletcher32=True
            )
            for key, n in (("u", len(stream.inputs)), ("y", len(stream.outputs)))
        )
        for experiment in range(stream.experiments):
            for start, (block_u, block_y) in _placed(stream, experiment):
                period, k = divmod(start, shape[2])
                u[experiment, period, k : k + len(block_u)] = block_u
                y[experiment, period, k : k + len(block_y)] = block_y


def _placed(stream: RecordStream, experiment: int) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray]]]:
    """Blocks with their first sample, cut so that none crosses from one period into the next."""
    length, start = stream.period or stream.samples, 0
    for u, y in stream.blocks(CHUNK, experiment):
        done = 0
        while done < len(u):
            count = min(len(u) - done, length - start % length)
            yield start, (u[done : done + count], y[done : done + count])
            done, start = done + count, start + count


def _storable(value: np.ndarray) -> Any:
    """Texts of fixed length: those of any length stand in a heap whose damage can hang the library."""
    value = np.asarray(value)
    if value.dtype.kind != "U":
        return value
    texts = [text.encode() for text in value.tolist()]
    return np.array(texts, dtype=h5py.string_dtype("utf-8", max([1, *map(len, texts)])))


@contextmanager
def opened(file: Path) -> Generator[Any]:
    """The file, for reading; raises `DataError` for one that h5py cannot read."""
    try:
        # Read in order, a chunk is needed once: a cache of more than one of them is memory for nothing.
        with h5py.File(file, "r", rdcc_nbytes=1 << 20) as archive:
            yield archive
    except (OSError, RuntimeError, KeyError, UnicodeDecodeError, TypeError, ValueError) as error:
        what = " ".join(str(error).split())
        raise DataError(
            f"truncated or not HDF5: {what}", where=str(file), hint="copy or record it again"
        ) from None


def head_hdf5(file: Path) -> tuple[Raw, tuple[int, int, int]]:
    """Everything but the samples, and the shape (experiment, period, sample)."""
    with opened(file) as archive:
        arrays: dict[str, Any] = {}
        for key in archive:
            data = archive[key]
            if key in ("u", "y"):
                check_stored(data)
                check_samples(key, data.shape, data.dtype, str(file))
                arrays[key] = np.broadcast_to(np.zeros((), data.dtype), data.shape)
            elif isinstance(data, h5py.Dataset):
                arrays[key] = plain(data)
    return build_raw(arrays, str(file)), arrays["y"].shape[:3]


def pieces_hdf5(file: Path, experiment: int, size: int) -> Iterator[np.ndarray]:
    """u[sample, input] beside y[sample, output] of one experiment, at most ``size`` samples at a time."""
    with opened(file) as archive:
        u, y = archive["u"], archive["y"]
        for period in range(y.shape[1]):
            for k in range(0, y.shape[2], size):
                rows = slice(k, k + size)
                both = u[experiment, period % u.shape[1], rows], y[experiment, period, rows]
                yield np.hstack(both).astype(float)
