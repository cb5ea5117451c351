"""Reader of a record by the ending of its file; another format is entered here."""

from collections.abc import Callable, Sequence
from pathlib import Path

from middeck.errors import DataError
from middeck.files.records.raw import Raw

UFF = (".uff", ".unv", ".uf", ".58")
HDF5 = (".h5", ".hdf5")
RUN = ".mdr"
SUFFIXES = (".npz", ".csv", *HDF5, ".mat", ".npy", *UFF, RUN)


def reader_of(file: Path) -> Callable[[Path, str], Raw]:
    """Reader of a file and a variable of it (or ""); raises `DataError` for an ending without a reader."""
    suffix = file.suffix.lower()
    match suffix:
        case ".npz":
            from middeck.files.records.npz import read_npz as read
        case ".npy":
            from middeck.files.records.npz import read_npy as read
        case ".csv":
            from middeck.files.records.csv_text import read_csv as read
        case ".mat":
            from middeck.files.records.mat import read_mat as read
        case ".h5" | ".hdf5":
            from middeck.files.records.hdf5 import read_hdf5 as read
        case ".mdr":
            from middeck.files.records.engine_runs import read_run_file as read
        case _ if suffix in UFF:
            from middeck.files.records.uff import read_uff as read
        case _:
            raise unknown_ending(file, "reader", SUFFIXES)
    return read


def unknown_ending(file: Path, what: str, known: Sequence[str]) -> DataError:
    """The error for an ending without a reader or a writer."""
    hint = f"convert to one of {', '.join(known)}"
    return DataError(f"no {what} for {file.suffix!r} files", where=str(file), hint=hint)
