"""Modes of an article that a robustness sweep shifts, and its first bending modes."""

from middeck.structure.modes.solve import Modes
from middeck.systems.plants.dispersed_frequencies import DispersedModes

FIRST = "first bending"


def dispersed_modes(modes: Modes, count: int) -> DispersedModes:
    """The flexible modes among the lowest ``count``; rigid and suspension modes are not bending.

    First bending is every mode of that name, one for each plane; where none has it, the lowest flexible mode.
    """
    names = zip(modes.name[:count], modes.kind[:count], strict=True)
    flexible = tuple(dict.fromkeys(name for name, kind in names if kind == "flexible"))
    first = tuple(name for name in flexible if name.startswith(FIRST)) or flexible[:1]
    return DispersedModes(first_bending=first, others=tuple(name for name in flexible if name not in first))
