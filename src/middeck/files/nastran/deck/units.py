"""Units of a deck, which states none: by names such as ``mm-kg-s-mN``, and the likeliest ones."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from middeck.errors import ConfigError

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
MASSES = {
    "kg": 1.0, "g": 1e-3, "t": 1e3, "slug": 14.593902937206364, "slinch": 175.12683524647636,
    "lb": 0.45359237,
}  # fmt: skip
TIMES = {"s": 1.0, "ms": 1e-3}
FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "uN": 1e-6, "lbf": 4.4482216152605, "kgf": 9.80665}
# What decks are written in.
_COMMON = "mm-kg-s-mN m-kg-s-N mm-t-s-N in-slinch-s-lbf mm-kg-ms-kN mm-g-ms-N ft-slug-s-lbf cm-kg-s"
COMMON = tuple(_COMMON.split())
# Range of Young's modulus, density and size of structures, from wood to carbon fibres and tungsten.
YOUNG, DENSITY, SIZE = (1e8, 1.5e12), (100.0, 2.3e4), (1e-3, 2e3)
BUILT = (1e10, 5e11)  # Young's moduli of the most common: light alloys, fibres, steel
ROUNDING = 1e-6  # relative rounding of a force by people


class Units(NamedTuple):
    """A consistent set of units in SI: length [m], mass [kg], time [s]."""

    name: str
    length: float
    mass: float
    time: float

    @property
    def force(self) -> float:
        """Newtons in one unit of force."""
        return self.mass * self.length / self.time**2


def parse_units(text: str) -> Units:
    """Units by name: a length, a mass or a force, and a time, in any order, joined by hyphens.

    >>> parse_units("mm-kg-s-mN").force, round(parse_units("in-lbf-s").mass, 3)
    (0.001, 175.127)

    Raises `ConfigError` for an unknown name, and for four units of which the force is not mass times
    acceleration.
    """
    found: dict[str, float] = {}
    for name in text.split("-"):
        kinds = {"length": LENGTHS, "mass": MASSES, "time": TIMES, "force": FORCES}
        kind = next((kind for kind, known in kinds.items() if name in known), None)
        if kind is None or kind in found:
            what = f"a second {kind} {name!r}" if kind else f"no unit {name!r}"
            raise ConfigError(f"{what} in {text!r}", where="units", hint=_hint())
        found[kind] = kinds[kind][name]
    if "length" not in found or "time" not in found or not found.keys() & {"mass", "force"}:
        raise ConfigError(f"{text!r} is no set of units", where="units", hint=_hint())
    length, time, force = found["length"], found["time"], found.get("force", 0.0)
    units = Units(text, length, found.get("mass", force * time**2 / length), time)
    if force and abs(units.force / force - 1.0) > ROUNDING:
        raise ConfigError(
            f"{text!r} is not consistent: its force is {units.force / force:g} times mass times acceleration",
            where="units",
            hint="units without the force, as mm-kg-s; those of masses where WTMASS makes them of weights",
        )
    return units


def _hint() -> str:
    return f"a length, a mass or a force, and a time: {', '.join(COMMON)}"


def guess_units(materials: Sequence[tuple[float, float]], size: float) -> list[Units]:
    """Common units in which all ``materials`` (Young's modulus, density) and the ``size`` are plausible.

    A density of zero is ignored. The units in which the materials are closest to aluminium come first.
    """

    def distance(units: Units) -> float:
        stress = units.force / units.length**2
        return sum(abs(1.0 - (E * stress / 7e10) ** 0.1) for E, _ in materials)

    fitting = [u for u in map(parse_units, COMMON) if _plausible(u, materials, size)]
    return sorted(fitting, key=distance)


def warnings_on_modulus(units: Units, E: float) -> str:
    """A warning for an implausible Young's modulus in ``units``, with plausible units; else empty.

    A power of ten is one for form's sake, of a beam that is given by E A and E I.

    >>> warnings_on_modulus(parse_units("m-kg-s-N"), 7e4)
    "a Young's modulus of 7e+04 Pa, which nothing has that is built with; in mm-t-s-N it is 7e+10 Pa"
    """
    found = E * units.force / units.length**2
    if E <= 0.0 or YOUNG[0] <= found <= YOUNG[1] or abs(math.remainder(math.log10(E), 1.0)) < ROUNDING:
        return ""
    message = f"a Young's modulus of {found:.4g} Pa, which nothing has that is built with"
    others = [(u, E * u.force / u.length**2) for u in map(parse_units, COMMON)]
    better = [(u, e) for u, e in others if BUILT[0] <= e <= BUILT[1]]
    return message + (f"; in {better[0][0].name} it is {better[0][1]:.4g} Pa" if better else "")


def _plausible(units: Units, materials: Sequence[tuple[float, float]], size: float) -> bool:
    stress, density = units.force / units.length**2, units.mass / units.length**3
    return SIZE[0] <= size * units.length <= SIZE[1] and all(
        YOUNG[0] <= E * stress <= YOUNG[1] and (rho == 0.0 or DENSITY[0] <= rho * density <= DENSITY[1])
        for E, rho in materials
    )
