"""Plants with the modes shifted that options ask for: single shifts, and the default robustness sweep."""

from middeck.cli.given.plants_to_try import Gathered, Law, chosen_modes, shifted_plants
from middeck.cli.options import Tried
from middeck.cli.shown.file_of_an_error import reading
from middeck.control.qualification import align_plant
from middeck.errors import ConfigError
from middeck.systems.plants.dispersed_frequencies import DispersedModes, dispersed_factors
from middeck.systems.plants.mode_shift import natural_hz, shift_modes
from middeck.systems.plants.plant import Plant, name_states


def all_plants(gathered: Gathered, law: Law, tried: Tried) -> dict[str, Plant]:
    """The plants as they are, with the shifts of ``--shift``, and in the cases of ``--sweep``.

    Raises `ConfigError` for ``--first-bending`` without a sweep.
    """
    plants = shifted_plants(gathered.plants, tried.shifts)
    if tried.sweep:
        return plants | swept_plants(gathered, law, tried.first_bending)
    if tried.first_bending is not None:
        raise ConfigError("--first-bending is for a sweep", hint="--sweep beside it")
    return plants


def swept_plants(gathered: Gathered, law: Law, first_bending: str | None) -> dict[str, Plant]:
    """Each plant in every case of the default robustness sweep (`dispersed_factors`).

    ``first_bending`` names the modes of the first bending, as `chosen_modes`; None takes those of an article.
    Modes that the compensator neither moves nor reads are not shifted. Raises `ConfigError` for a fitted
    model without it.
    """
    found: dict[str, Plant] = {}
    for name, plant in gathered.plants.items():
        with reading(name):
            moved = set(name_states(align_plant(plant, law)))
            modes = _dispersed(plant, gathered.dispersed.get(name), first_bending)
            modes = DispersedModes(
                first_bending=tuple(n for n in modes.first_bending if n in moved),
                others=tuple(n for n in modes.others if n in moved),
            )
            for title, factors in dispersed_factors(modes).items():
                found[f"{name}, {title}"] = shift_modes(plant, factors)
    return found


def _dispersed(plant: Plant, known: DispersedModes | None, first_bending: str | None) -> DispersedModes:
    if first_bending is None and known is not None:
        return known
    hz = natural_hz(plant)
    if first_bending is None:
        raise ConfigError(
            "a fitted model or promised plant does not say which of its modes is the first bending",
            hint=f"--first-bending MODES; there are {', '.join(f'{n} {f:.4g} Hz' for n, f in hz.items())}",
        )
    first = chosen_modes(plant, first_bending)
    names = tuple(hz) if known is None else (*known.first_bending, *known.others)
    return DispersedModes(first_bending=first, others=tuple(name for name in names if name not in first))
