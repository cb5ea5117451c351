"""Aliases of modes beyond half the sampling rate in the sampled loop, and analogue filters against them."""

import dataclasses

import numpy as np

from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.sampled_loop import SampledOutcome, measure_sampled_loop
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, name_states, remove_delays, require_modal
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.modal_system import select_modes
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

UNFILTERED = "_unfiltered"


@record(kw_only=True)
class Alias:
    """A mode beyond half the rate and its alias.

    Attributes:
        name, frequency_hz: The mode.
        alias_hz: Frequency of the alias, folded about whole multiples of half the rate.
        damping: Damping ratio of the alias: same decay rate, lower frequency.
        filter_gain: Gain of the filter at the mode; one without a filter.
        loop_gain: Size of the mode's part of the return ratio at the alias, the largest over the loops.
        stable: Whether the loop with this mode and those below half the rate is stable.
        metric: Metric of that loop.
    """

    name: str
    frequency_hz: float
    alias_hz: float
    damping: float
    filter_gain: float
    loop_gain: float
    stable: bool
    metric: float


@record
class AliasReport:
    """The loop of one compensator at one rate.

    Attributes:
        rate_hz: Sampling rate.
        aliases: Each mode beyond half of it, ascending in frequency.
        resolved: The loop with the modes below half the rate alone.
        together: The loop with all modes.
    """

    rate_hz: float
    aliases: tuple[Alias, ...]
    resolved: SampledOutcome
    together: SampledOutcome


def find_aliases(
    plant: Plant,
    compensator: Compensator,
    weights: LQGWeights,
    authority: float,
    *,
    antialias: StateSpace | None = None,
) -> AliasReport:
    """Aliases of the modes beyond half the rate, and their effect on the loop of ``compensator`` and
    ``plant``.

    ``antialias`` is put behind each measurement (`filter_measurements`); the compensator should be designed
    for the plant with it, because of its phase lag. Metrics include the modes' own motion: compare two
    compensators, or filter and no filter.

    Raises `ConfigError` for a plant that is not in modal form, and what `measure_sampled_loop` does.
    """
    active = partition_modes(plant).active
    modal = require_modal(active)
    period = compensator.sampled.period_s
    beyond = np.flatnonzero(modal.omega >= np.pi / period)
    beyond = beyond[np.argsort(modal.omega[beyond], kind="stable")]
    below = np.flatnonzero(modal.omega < np.pi / period)

    def with_modes(keep: np.ndarray) -> Plant:
        part = dataclasses.replace(active, dynamics=select_modes(modal, np.sort(keep)))
        return part if antialias is None else filter_measurements(part, antialias)

    def loop_of(keep: np.ndarray) -> SampledOutcome:
        return measure_sampled_loop(with_modes(keep), compensator, weights, authority)

    found: list[Alias] = []
    for k in beyond:
        omega, decay = float(modal.omega[k]), float(modal.omega[k] * modal.zeta[k])
        turning = float(np.sqrt(max(omega**2 - decay**2, 0.0)))
        seen = abs(turning - 2.0 * np.pi / period * round(turning * period / (2.0 * np.pi)))
        alone = form_loop(with_modes(np.array([k])), compensator).plant.sampled
        ratio = [statespace_response(s, np.array([seen]))[0] for s in (compensator.sampled, alone)]
        outcome = loop_of(np.append(below, k))
        found.append(
            Alias(
                name=modal.names[k],
                frequency_hz=omega / (2.0 * np.pi),
                alias_hz=seen / (2.0 * np.pi),
                damping=decay / float(np.hypot(seen, decay)) if decay else 0.0,
                filter_gain=1.0
                if antialias is None
                else float(np.abs(statespace_response(antialias, np.array([omega]))[0, 0, 0])),
                loop_gain=float(np.abs(np.linalg.eigvals(ratio[0] @ ratio[1])).max(initial=0.0)),
                stable=outcome.stable,
                metric=outcome.metric,
            )
        )
    return AliasReport(1.0 / period, tuple(found), loop_of(below), loop_of(np.arange(len(modal.omega))))


def filter_measurements(plant: Plant, section: StateSpace) -> Plant:
    """The plant with ``section`` (one input, one output) behind each of its measurements y.

    The filtered measurement keeps its name. Where it is also a performance output, z reads a copy in front of
    the filter, with the suffix ``_unfiltered``. Inert modes are left out.

    Raises `ConfigError` for a section with more than one input or output.

    >>> from middeck.control.shaping.leads_and_notches import roll_off
    >>> from middeck.signals.ports import Port
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> plant = Plant(dynamics=lag, inputs=(Port("f", "N"),), outputs=(Port("x", "m"),), w=("f",),
    ...     u=("f",), z=("x",), y=("x",))
    >>> filtered = filter_measurements(plant, roll_off(40.0, 2))
    >>> filtered.z, filtered.y, name_states(filtered)
    (('x_unfiltered',), ('x',), ('state 0', 'anti-alias', 'anti-alias'))
    """
    if section.D.shape != (1, 1):
        raise ConfigError(f"the filter has {section.D.shape} outputs and inputs", hint="one of each")
    filtered = _filtered(remove_delays(plant), section)
    return dataclasses.replace(filtered, delay_s=np.vstack([plant.delay_s, plant.delay_s[_shared(plant)]]))


def _shared(plant: Plant) -> list[int]:
    """Rows of the measurements that are performance outputs too."""
    return plant.output_indices([name for name in dict.fromkeys(plant.y) if name in plant.z])


def _filtered(plant: Plant, section: StateSpace) -> Plant:
    active = partition_modes(plant).active
    system, rows, shared = active.system, active.output_indices(active.y), _shared(active)
    one = np.eye(len(rows))
    f = StateSpace(*(np.kron(one, m) for m in (section.A, section.B, section.C, section.D)))
    C = np.hstack([system.C, np.zeros((len(system.C), len(f.A)))])
    C[rows] = np.hstack([f.D @ system.C[rows], f.C])
    D = system.D.copy()
    D[rows] = f.D @ system.D[rows]
    before = np.hstack([system.C[shared], np.zeros((len(shared), len(f.A)))])
    dynamics = StateSpace(
        np.block([[system.A, np.zeros((len(system.A), len(f.A)))], [f.B @ system.C[rows], f.A]]),
        np.vstack([system.B, f.B @ system.D[rows]]),
        np.vstack([C, before]),
        np.vstack([D, system.D[shared]]),
    )
    names = {active.outputs[i].name for i in shared}
    copies = tuple(
        dataclasses.replace(p, name=p.name + UNFILTERED) for p in (active.outputs[i] for i in shared)
    )
    return dataclasses.replace(
        active,
        dynamics=dynamics,
        outputs=(*active.outputs, *copies),
        z=tuple(name + UNFILTERED if name in names else name for name in active.z),
        state_names=(*name_states(active), *("anti-alias",) * len(f.A)),
    )
