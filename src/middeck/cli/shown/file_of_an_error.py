"""Errors of a computation get the name of the file whose content they are about."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from middeck.errors import MiddeckError


@contextmanager
def reading(*files: str | Path) -> Generator[None]:
    """Put ``files`` before the place of an error that names none of them.

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
        names = [_called(f) for f in files]
        if not any(name in str(error) for name in names):
            error.where = ", ".join([*names, *([error.where] if error.where else [])])
        raise


def _called(file: str | Path) -> str:
    """The path, or the name of a built-in environment, whose file nobody wrote."""
    from middeck.files.setups import BUILT_IN  # forms of articles, which a record is read without

    return next((f"environment {name!r}" for name, path in BUILT_IN.items() if path == file), str(file))
