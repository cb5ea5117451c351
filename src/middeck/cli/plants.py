"""The plant that a design is for, from an article or from a fitted model, with the ports that were typed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.identification.measurement_model import MeasurementModel, natural_hz
from middeck.identification.plants.measured_plant import measured_plant
from middeck.structure.modes import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.systems.plant import Plant
from middeck.values import record

Band = tuple[float, float]


@record
class Wanted:
    """The ports to drive and to measure; empty where the only one is meant."""

    control: tuple[str, ...]
    measure: tuple[str, ...]


def article_plant(modes: Modes, count: int, wanted: Wanted) -> tuple[Plant, Band]:
    """The lowest ``count`` modes between the ports wanted, and the band that they lie in."""
    structure = modes.equilibrium.model.structure
    u = chosen(wanted.control, [a.name for a in structure.actuators], "--control")
    y = chosen(wanted.measure, [s.name for s in structure.sensors], "--measure")
    plant = build_plant(modes, inputs=u, outputs=y, count=count, w=u, u=u, z=y, y=y)
    return plant, _band_around(modes.frequency_hz[:count])


def model_plant(model: MeasurementModel, pade_order: int, wanted: Wanted) -> tuple[Plant, Band]:
    """The plant of a fitted model with its delay as a Pade approximation, and the band of its poles."""
    u = chosen(wanted.control, [p.name for p in model.inputs], "--control")
    y = chosen(wanted.measure, [p.name for p in model.outputs], "--measure")
    plant = measured_plant(model, pade_order=pade_order, w=u, u=u, z=y, y=y)
    return plant, _band_around(natural_hz(model))


def _band_around(frequency_hz: Float[np.ndarray, " mode"]) -> Band:
    """From half the lowest to twice the highest; rigid modes do not count."""
    hz = frequency_hz[frequency_hz > 0.0]
    return (0.5 * float(hz.min()), 2.0 * float(hz.max())) if len(hz) else (0.1, 60.0)


def chosen(names: tuple[str, ...], known: Sequence[str], option: str) -> tuple[str, ...]:
    """``names``, or the only one there is.

    >>> chosen((), ["motor"], "--control")
    ('motor',)
    """
    if names:
        return names
    if len(known) == 1:
        return (known[0],)
    raise ConfigError(f"{option} is missing", hint=f"one or more of {', '.join(known)}")
