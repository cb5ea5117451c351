"""The design plant, of an article or a fitted model, with the ports that were typed."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.identification.model.channel_selection import ChannelSelection, select_channels
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz, path_delay, rank_of
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.merged_delays import merge_delays
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.signals.ports import port_indices
from middeck.signals.record import RecordStream
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.whirl_modes import solve_gyroscopic_modes
from middeck.systems.delay.delay_approximation import SAME_DELAY_S, approximate_delays
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.values import record

Band = tuple[float, float]


@record
class Wanted:
    """The ports to drive and to measure; empty for the only one there is."""

    control: tuple[str, ...]
    measure: tuple[str, ...]


def article_plant(modes: Modes, count: int, wanted: Wanted) -> tuple[Plant, Band]:
    """The lowest ``count`` modes between the ports wanted, and the band that they lie in."""
    issue_warnings(modes)
    structure = modes.equilibrium.model.structure
    u = chosen(wanted.control, [a.name for a in structure.actuators], "--control")
    y = chosen(wanted.measure, [s.name for s in structure.sensors], "--measure")
    plant = build_plant(modes, inputs=u, outputs=y, count=count, w=u, u=u, z=y, y=y)
    return plant, _band_around(solve_gyroscopic_modes(modes, count=count).frequency_hz)


def issue_warnings(modes: Modes) -> None:
    """Warnings of the modes, for a verb that does not show them."""
    for text in modes.warnings:
        warnings.warn(text, UserWarning, stacklevel=2)


@record
class FittedPlant:
    """The plant of a fitted model, the band of its poles, and notes on changes to the model."""

    plant: Plant
    band_hz: Band
    warnings: tuple[str, ...]


def model_plant(
    model: MeasurementModel, covariance: ModelCovariance | None, pade_order: int, wanted: Wanted
) -> FittedPlant:
    """The plant of a fitted model between the ports wanted, its delays as Pade approximations.

    Modes that are on no path between these ports are left out; delays that ``covariance`` does not tell
    apart are made one where the path would otherwise have several.
    """
    if model.sample_hz is not None:
        raise ConfigError(
            f"the model is sampled, at {model.sample_hz:g} Hz; a design is for a continuous plant",
            hint="middeck identify RECORD... --continuous -o MODEL.json",
        )
    u = chosen(wanted.control, [p.name for p in model.inputs], "--control")
    y = chosen(wanted.measure, [p.name for p in model.outputs], "--measure")
    path, notes = _path(model, u, y), ()
    if covariance is not None and _delays(path.model) > 1:
        merged = merge_delays(covariance)
        path, notes = _path(merged.model, u, y), merged.sentences
    between = f"from {', '.join(u)} to {', '.join(y)}"
    path_notes = [f"left out of the plant, as it is on no path {between}: {name}" for name in path.dropped]
    path_notes += [*notes, *_dear_delays(path.model, pade_order)]
    fitted = measured_plant(path.model, w=u, u=u, z=y, y=y)
    if np.any(remove_delays(fitted).system.D):
        raise ConfigError(
            f"the model has a constant term {between}: it passes white noise at infinite rms",
            hint="identify RECORD... --states N fits none by default; for velocities add "
            "--relative-degree 1; accelerations have one",
        )
    plant = approximate_delays(fitted, pade_order)
    return FittedPlant(plant, _band_around(natural_hz(path.model)), tuple(path_notes))


def _path(model: MeasurementModel, u: Sequence[str], y: Sequence[str]) -> ChannelSelection:
    """The model between some ports; all of it where a mode that does not decay would go with the rest, for
    a design has to refuse that and not to overlook it."""
    path = select_channels(model, inputs=u, outputs=y)
    return path if _lasting(path.model) == _lasting(model) else ChannelSelection(model, ())


def _lasting(model: MeasurementModel) -> int:
    """Modes that do not decay."""
    return int(np.sum(np.real(model.poles) >= 0.0)) + rank_of(model.rigid) + rank_of(model.integral)


def _delays(model: MeasurementModel) -> int:
    """Number of different delays of its paths."""
    return 1 + int(np.sum(np.diff(np.sort(path_delay(model), axis=None)) > SAME_DELAY_S))


def _dear_delays(model: MeasurementModel, pade_order: int) -> list[str]:
    """Warning of different delays: they cost states, small differences fast ones."""
    count = _delays(model)
    if count == 1:
        return []
    return [
        f"{count} different delays, each approximated by {pade_order} states; if there is only one, fit one: "
        "identify --delay common"
    ]


def _band_around(frequency_hz: Float[np.ndarray, " mode"]) -> Band:
    """Band from half the lowest to twice the highest frequency; rigid modes do not count."""
    hz = frequency_hz[frequency_hz > 0.0]
    return (0.5 * float(hz.min()), 2.0 * float(hz.max())) if len(hz) else (0.1, 60.0)


def require_ports(record: RecordStream, wanted: Wanted) -> None:
    """Raise `ConfigError` for ports that are not in a record, which takes longer to fit than to open."""
    for ports, names, option, side in (
        (record.inputs, wanted.control, "--control", "input"),
        (record.outputs, wanted.measure, "--measure", "output"),
    ):
        port_indices(ports, chosen(names, [port.name for port in ports], option), side)


def chosen(names: tuple[str, ...], known: Sequence[str], option: str) -> tuple[str, ...]:
    """``names``, or the only one there is.

    >>> chosen((), ["motor"], "--control")
    ('motor',)
    """
    if twice := next((name for i, name in enumerate(names) if name in names[:i]), ""):
        raise ConfigError(f"{option} names {twice!r} twice", hint="each port once")
    if names:
        return names
    if len(known) == 1:
        return (known[0],)
    hint = f"one or more of {', '.join(known)}" if known else "there is none: define one in the article"
    raise ConfigError(f"{option} is missing", hint=hint)
