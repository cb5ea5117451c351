"""Compensators from files, JSON or MAT by their endings."""

from middeck.errors import DataError
from middeck.files.any_value import is_mat
from middeck.files.exchange.matlab_systems import load_mat
from middeck.files.laws.compensators import StoredCompensator, load_compensator


def load_law(path: str) -> StoredCompensator:
    """The compensator in a file; raises `DataError` for anything else."""
    if not is_mat(path):
        return load_compensator(path)
    found = load_mat(path)
    if isinstance(found, StoredCompensator):
        return found
    raise DataError(
        "a system, and nothing says that it is a compensator, nor its sign",
        where=path,
        hint="s.Kind = 'compensator' and s.Feedback = 'positive' (u = K y) or 'negative' (u = -K y)",
    )
