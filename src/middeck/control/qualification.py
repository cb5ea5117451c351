"""Qualification of a compensator on other plants: stability, margins and rms, continuous and sampled."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from middeck.arguments import named_kinds
from middeck.control.analysis.margins.margins import LoopMargins, measure_margins
from middeck.control.analysis.stability.stability import LoopStability
from middeck.control.law.compensator import Compensator, idle_compensator, locate_ports
from middeck.control.law.partition import partition_modes
from middeck.control.law.stabilisability import require_reachable
from middeck.control.lqg.weights import LQGWeights
from middeck.control.noise import measure_noise_rms
from middeck.errors import ConfigError, MiddeckError, NotStabilisableError, NumericalError
from middeck.systems.plants.plant import Plant, name_states, remove_delays, subsystem
from middeck.systems.sampling.sampling import tustin
from middeck.values import record, require_kind

CONTINUOUS = "continuous"


@record(kw_only=True)
class Qualified:
    """Result of one plant under one form of a compensator.

    Attributes:
        plant: Its name.
        setting: ``"continuous"``, or the sampling rate, as ``"250 Hz"``.
        stability: Stability by the roots, delays exact; unstable is an outcome. None where ``unheld``
            decides, or nothing could.
        rms, control_rms: (E[z' W^2 z])^1/2 and (E[u' R u])^1/2 under process and sensor noise, delays exact
            (`measure_noise_rms`), of a sampled loop between the samples too; ``inf`` where unstable, and
            where a direct term passes on white sensor noise.
        db: 20 log10 of ``rms`` over that without control; ``inf`` where unstable, ``-inf`` where without
            control there is no rms (a mode that does not decay), NaN never: ``inf`` where neither has one.
        loops: Margins of each loop, broken at the plant's inputs; empty for an unstable loop.
        unheld: Modes that do not decay and are uncontrollable or unobservable at these ports: the loop is
            then not stable, whether rounding puts their poles left or right of the axis.
        undecided: Reason why stability could not be decided; empty where it was.
    """

    plant: str
    setting: str
    stability: LoopStability | None
    rms: float
    control_rms: float
    db: float
    loops: tuple[LoopMargins, ...]
    unheld: tuple[str, ...] = ()
    undecided: str = ""

    @property
    def stable(self) -> bool:
        """Whether every root is known to decay; a root on the axis drifts without bound under noise."""
        return self.stability is not None and self.stability.decays


@named_kinds
def qualify_compensator(
    compensator: Compensator,
    plants: Mapping[str, Plant],
    weights: LQGWeights,
    *,
    rates_hz: Sequence[float] = (),
) -> tuple[Qualified, ...]:
    """The compensator on each of ``plants``, continuous and then at each rate; delays and hold exact.

    At a rate a continuous compensator is sampled by Tustin's rule; a sampled one runs at its own rate only.
    ``weights`` are the weights and noises of the measured rms: z, u and y of each plant in their order.

    Raises `ConfigError` for ports that a plant does not have, weights that do not fit, and rates for a
    sampled compensator. The error's place is the name of the plant.
    """
    require_kind(plants, Mapping, "plants", 'by name: {"nominal": plant}')
    rates_hz = (float(rates_hz),) if isinstance(rates_hz, int | float) else tuple(rates_hz)
    found: list[Qualified] = []
    for name, plant in plants.items():
        try:
            tried = _try(name, plant, compensator, weights)
            forms: list[Compensator] = [*sampled_forms(compensator, rates_hz)]
            if compensator.period_s is None:
                forms.insert(0, compensator)
            found += [_row(tried, law, weights) for law in forms]
        except MiddeckError as error:
            error.where = ", ".join(filter(None, [name, error.where]))
            raise
    return tuple(found)


@record
class _Tried:
    """A plant with its groups set, its result without control, and its unstabilisable modes."""

    name: str
    plant: Plant
    reference: float
    unheld: tuple[str, ...]


def _try(name: str, plant: Plant, compensator: Compensator, weights: LQGWeights) -> _Tried:
    aligned = align_plant(plant, compensator)
    alone = measure_noise_rms(aligned, idle_compensator(aligned), weights).rms
    return _Tried(name, aligned, alone, _unheld(aligned))


def align_plant(plant: Plant, compensator: Compensator) -> Plant:
    """The plant with groups u and y of the compensator's ports, in its own order where it has them.

    Inert modes are left out, but of a sampled plant. Raises `ConfigError` as `locate_ports`.
    """
    locate_ports(compensator, plant.inputs, plant.outputs)
    u, y = (tuple(port.name for port in side) for side in (compensator.outputs, compensator.inputs))
    # Weights go by the plant's own groups where these are the compensator's ports.
    u = plant.u if sorted(plant.u) == sorted(u) else u
    y = plant.y if sorted(plant.y) == sorted(y) else y
    grouped = dataclasses.replace(plant, u=u, y=y)
    # Before delays are approximated: afterwards modes can no longer be distinguished.
    return grouped if grouped.period_s else partition_modes(grouped).active


def sampled_forms(compensator: Compensator, rates_hz: Sequence[float]) -> tuple[Compensator, ...]:
    """The compensator at each rate: by Tustin's rule, or unchanged if it is sampled.

    Raises `ConfigError` for a rate that is not positive, and for one that is not a sampled compensator's own.
    """
    if compensator.period_s is not None:
        own = 1.0 / compensator.period_s
        if any(abs(rate - own) > 1e-9 * own for rate in rates_hz):
            raise ConfigError(
                f"the compensator is sampled, at {own:g} Hz; it has no form at another rate",
                hint="leave the rates out, or give the continuous design",
            )
        return (compensator,)
    bad = [rate for rate in rates_hz if not (np.isfinite(rate) and rate > 0.0)]
    if bad:
        raise ConfigError(f"a rate of {bad[0]} Hz", hint="a rate > 0 Hz")
    ports = compensator.inputs, compensator.outputs
    laws = (tustin(compensator.system, 1.0 / rate) for rate in rates_hz)
    return tuple(Compensator(law, *ports, method="Tustin") for law in laws)


def _row(tried: _Tried, law: Compensator, weights: LQGWeights) -> Qualified:
    """Result of one form on one plant; an undecided case is reported in its row and affects no other."""
    setting = f"{1.0 / law.period_s:g} Hz" if law.period_s else CONTINUOUS
    unknown = Qualified(
        plant=tried.name,
        setting=setting,
        stability=None,
        rms=np.inf,
        control_rms=np.inf,
        db=np.inf,
        loops=(),
        unheld=tried.unheld,
    )
    if tried.unheld:
        return unknown
    try:
        margins = measure_margins(tried.plant, law)
        if not margins.stable:
            return dataclasses.replace(unknown, stability=margins.stability)
        noise = measure_noise_rms(tried.plant, law, weights)
    except NumericalError as error:
        return dataclasses.replace(unknown, undecided=error.what)
    db = decibels(noise.rms, tried.reference)
    return Qualified(
        plant=tried.name,
        setting=setting,
        stability=margins.stability,
        rms=noise.rms,
        control_rms=noise.control_rms,
        db=db,
        loops=margins.loops,
    )


def _unheld(plant: Plant) -> tuple[str, ...]:
    """Modes that do not decay and are uncontrollable from u or unobservable in y, whatever the delays."""
    inside = remove_delays(plant)
    path, names = subsystem(inside, inside.u, inside.y), name_states(inside)
    found: list[str] = []
    for A, B in ((path.A, path.B), (path.A.T, path.C.T)):
        try:
            require_reachable(A, B, names)
        except NotStabilisableError as error:
            found += error.data["modes"]
    return tuple(dict.fromkeys(found))


def decibels(rms: float, reference: float) -> float:
    """20 log10 of a ratio of two rms, either of which may be infinite.

    >>> decibels(1.0, 10.0), decibels(1.0, np.inf), decibels(np.inf, np.inf)
    (-20.0, -inf, inf)
    """
    if not np.isfinite(rms):
        return np.inf
    if not np.isfinite(reference):
        return -np.inf
    return float(20.0 * np.log10(rms / reference)) if rms > 0.0 and reference > 0.0 else 0.0
