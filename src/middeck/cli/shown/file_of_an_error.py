"""The name of the input file is added to errors of a computation."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from middeck.errors import MiddeckError


@contextmanager
def reading(*files: str | Path) -> Generator[None]:
    """Put ``files`` before the place of an error that names none of them, nor another document.

    >>> from middeck.errors import DataError
    >>> with reading("a.npz"):
    ...     raise DataError("the channel is constant", where="input u")
    Traceback (most recent call last):
    ...
    middeck.errors.DataError: a.npz, input u: the channel is constant
    """
    try:
        yield
    except MiddeckError as error:
        from middeck.files.setups import called  # forms of articles, which a record is read without

        names = [called(str(f)) for f in files]
        if "faults" not in error.data and not any(name in str(error) for name in names):
            error.where = ", ".join([*names, *([error.where] if error.where else [])])
        raise
