"""The error tree: each says what, where and what to try, and knows its exit code.

::

    MiddeckError
    |-- ConfigError            exit 2   a document or an option is wrong
    |-- MissingExtraError      exit 3   an optional package is not installed
    |-- DataError              exit 4   a record cannot be used
    `-- NumericalError         exit 5   a computation has no trustworthy answer
        |-- EquilibriumError            statics did not converge, or a cable went slack
        |-- UnstableEquilibriumError    a mode of the rest state grows
        |-- NotStabilisableError        no controller can hold these modes
        `-- FitError                    a fit that cannot be right

Expected outcomes are values, not errors: an unstable closed loop has ``stable == False``.
"""

from typing import Any


class MiddeckError(Exception):
    """Base of all errors raised on purpose.

    what: One sentence: what is wrong, with the offending value.
    where: File, line and key, or the name of the part of the model; empty if there is none.
    hint: What to try.
    **data: Whatever the caller may act on (residual history, last iterate, mode name); kept in ``.data``.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: str = "", hint: str = "", **data: Any) -> None:
        super().__init__(what)
        self.what = what
        self.where = where
        self.hint = hint
        self.data = data

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        advice = f"\n  try: {self.hint}" if self.hint else ""
        return f"{place}{self.what}{advice}"


class ConfigError(MiddeckError):
    """A document, a key or an option is wrong; several may be reported in one error."""

    exit_code = 2


class MissingExtraError(MiddeckError):
    """An optional package is not installed; ``extra`` is the name under which the package brings it."""

    exit_code = 3

    def __init__(self, what: str, *, extra: str) -> None:
        super().__init__(what, hint=f'pip install "middeck[{extra}]"', extra=extra)


class DataError(MiddeckError):
    """A record cannot be used: truncated, constant, too short, not a number."""

    exit_code = 4


class NumericalError(MiddeckError):
    """A computation has no trustworthy answer."""

    exit_code = 5


class EquilibriumError(NumericalError):
    """The static equilibrium was not reached, or is not one the model can hold."""


class UnstableEquilibriumError(NumericalError):
    """The rest state exists but one of its modes grows."""


class NotStabilisableError(NumericalError):
    """No controller can stabilise the named modes through the given ports."""


class FitError(NumericalError):
    """A fit that cannot be right: too few lines, constant response, all noise."""
