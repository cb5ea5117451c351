"""NPZ records, whole or in pieces; and a plain matrix as NPY."""

import zipfile
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from middeck.errors import DataError
from middeck.files.disk.atomic import replacing
from middeck.files.records.own_layout import build_raw, check_samples, contents_of
from middeck.files.records.raw import Raw, raw_matrix
from middeck.signals.record import Record

AGAIN = "copy or record it again"
BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, AttributeError, KeyError)


def read_npz(file: Path, variable: str) -> Raw:
    """The record in an archive of the package's layout."""
    with _refusing(file), open(file, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
        # Opened here, as np.load leaves a file open that it cannot read. AttributeError: np.load took the
        # file for a single array, which is no archive.
        arrays = {name: archive[name] for name in archive.files}
    return build_raw(arrays, str(file))


def read_npy(file: Path, variable: str) -> Raw:
    """A single matrix, one column a channel."""
    try:
        with open(file, "rb") as stream:
            matrix = np.lib.format.read_array(stream, allow_pickle=False)
    except (EOFError, OSError, ValueError) as error:
        raise _refused("NPY array", error, file) from None
    return raw_matrix(matrix, file)


def write_npz(path: Path, record: Record) -> None:
    """Write ``record`` compressed (double precision)."""
    with replacing(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **contents_of(record))


@contextmanager
def _refusing(file: Path) -> Generator[None]:
    try:
        yield
    except BROKEN as error:
        raise _refused("NPZ archive", error, file) from None


def _refused(kind: str, error: Exception, file: Path) -> DataError:
    """The error. NumPy's own suggests to load pickled objects, which may run any program."""
    if "pickle" in str(error):
        # Text where a file should be is taken for a pickle too.
        what = f"truncated or not an {kind}, or it holds objects instead of numbers"
        return DataError(what, where=str(file), hint="save arrays of numbers and texts only")
    return DataError(f"truncated or not an {kind}: {error}", where=str(file), hint=AGAIN)


def head_npz(file: Path) -> tuple[Raw, tuple[int, int, int]]:
    """Everything but the samples, and the shape (experiment, period, sample)."""
    arrays: dict[str, Any] = {}
    with _refusing(file), zipfile.ZipFile(file) as archive:
        for name in archive.namelist():
            key = name.removesuffix(".npy")
            with archive.open(name) as member:
                if key in ("u", "y"):
                    shape, _, dtype = _header(member)
                    check_samples(key, shape, dtype, str(file))
                    arrays[key] = np.broadcast_to(np.zeros((), dtype), shape)
                else:
                    arrays[key] = np.lib.format.read_array(member, allow_pickle=False)
    raw = build_raw(arrays, str(file))
    return raw, arrays["y"].shape[:3]


def _header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(member)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return read(member)


def pieces_npz(file: Path, experiment: int, size: int) -> Iterator[np.ndarray]:
    """u[sample, input] beside y[sample, output] of one experiment, at most ``size`` samples at a time."""
    with (
        _refusing(file),
        zipfile.ZipFile(file) as archive,
        archive.open("u.npy") as u,
        archive.open("y.npy") as y,
    ):
        of_u, of_y = (_Samples(x) for x in (u, y))
        for period in range(of_y.shape[1]):
            of_u.seek(experiment, period % of_u.shape[1])
            of_y.seek(experiment, period)
            for k in range(0, of_y.shape[2], size):
                count = min(size, of_y.shape[2] - k)
                yield np.hstack([of_u.read(count), of_y.read(count)])


class _Samples:
    """``u`` or ``y`` of an archive, read row by row where it stands, compressed or not."""

    def __init__(self, member: IO[bytes]) -> None:
        self.shape, columns_first, self._dtype = _header(member)
        if columns_first:
            raise DataError("samples stored column by column cannot be streamed", hint="write it again")
        self._member, self._start = member, member.tell()
        self._row = self.shape[3] * self._dtype.itemsize

    def seek(self, experiment: int, period: int) -> None:
        place = self._start + (experiment * self.shape[1] + period) * self.shape[2] * self._row
        if self._member.tell() != place:
            self._member.seek(place)

    def read(self, count: int) -> np.ndarray:
        content = self._member.read(count * self._row)
        return np.frombuffer(content, self._dtype).reshape(-1, self.shape[3]).astype(float)
