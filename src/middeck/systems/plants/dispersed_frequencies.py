"""Dispersed frequencies: robustness sweep of launch vehicles, first bending apart from the other modes."""

from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.values import record


@record
class Dispersion:
    """Relative shifts of frequencies, down and up.

    The defaults are those of launch-vehicle practice (NASA NTRS 20170001503): a controller holds for 10 % in
    the first bending frequency and 20 % in those above.

    >>> Dispersion()
    Dispersion(first_bending=0.1, others=0.2)
    """

    first_bending: float = 0.1
    others: float = 0.2

    def __post_init__(self) -> None:
        if not all(np.isfinite(x) and 0.0 <= x < 1.0 for x in (self.first_bending, self.others)):
            raise ConfigError(
                f"a sweep of {100.0 * self.first_bending:g} % on first bending and {100.0 * self.others:g} % "
                "on the others",
                hint="from 0 to below 100 %",
            )


@record(kw_only=True)
class DispersedModes:
    """Names of the modes that a sweep shifts; equal names are shifted together.

    Attributes:
        first_bending: One for each plane of bending.
        others: All others that a sweep shifts.
    """

    first_bending: tuple[str, ...]
    others: tuple[str, ...]


def dispersed_factors(
    modes: DispersedModes, dispersion: Dispersion | None = None
) -> dict[str, dict[str, float]]:
    """Factors on frequencies by the name of each case: each mode alone, all together, first against others.

    Modes whose shift is zero are in no case.

    >>> found = dispersed_factors(DispersedModes(first_bending=("1.7 Hz",), others=("7 Hz", "9 Hz")))
    >>> len(found), found["7 Hz -20 %"], found["first bending +10 %, others -20 %"]
    (10, {'7 Hz': 0.8}, {'1.7 Hz': 1.1, '7 Hz': 0.8, '9 Hz': 0.8})
    """
    dispersion = dispersion or Dispersion()
    first = _of(modes.first_bending, dispersion.first_bending)
    others = _of([name for name in modes.others if name not in first], dispersion.others)
    found = {
        f"{name} {_percent(sign * by)}": {name: 1.0 + sign * by}
        for name, by in (first | others).items()
        for sign in (-1.0, 1.0)
    }
    if not first or not others:
        return found | _together("all", first | others)
    for a in (-1.0, 1.0):
        for b in (-1.0, 1.0):
            title = (
                f"first bending {_percent(a * dispersion.first_bending)}, "
                f"others {_percent(b * dispersion.others)}"
            )
            found[title] = {
                **{name: 1.0 + a * by for name, by in first.items()},
                **{name: 1.0 + b * by for name, by in others.items()},
            }
    return found


def _of(names: Sequence[str], by: float) -> dict[str, float]:
    return dict.fromkeys(names, by) if by else {}


def _together(title: str, by: dict[str, float]) -> dict[str, dict[str, float]]:
    """Cases with all modes down and all up, where this is not one mode alone."""
    if len(by) < 2:
        return {}
    return {
        f"{title} {_percent(sign * max(by.values()))}": {n: 1.0 + sign * x for n, x in by.items()}
        for sign in (-1.0, 1.0)
    }


def _percent(by: float) -> str:
    return f"{100.0 * by:+g} %"
