"""Plants in another environment, drawn from the uncertainty that a refinement leaves.

Shapes, inertias and gains are those of the article at each draw. Its frequencies are not: unknowns that the
surveys do not see alone keep most of their spread, and what the surveys do see (a sum of them) then holds to
first order only. Each draw's frequencies are therefore those of the linear estimate, which keeps it. A draw
has as much of the shear that the article is drawn without as the surveys leave likely: its modes mix by it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.environment import Environment
from middeck.structure.model.finer_mesh import add_shear
from middeck.structure.model.umbilical import floats, tie_umbilical
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.systems.plants.plant import Plant, delay_plant, require_modal
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.updating.orbit.predicted_frequencies import CABLE_HZ, Prediction, predict_modes
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.surveys import SetUp, set_up
from middeck.values import record

# Unknowns that are named where a draw has no rest state.
NAMED = 3


@record(kw_only=True)
class LoopSpread:
    """Uncertainty of the loop beside that of the article.

    Attributes:
        delay_s: Delay from command to reading of every path [s], as the compensators of the promise meet it:
            of one in continuous time that stands for a sampled one, half a sample of its hold included. A
            package, or a rate, adds its hold to promised plants by itself.
        delay_tolerance_s: Its tolerance to both sides, all values within as likely.
        gain_tolerance: Relative tolerance of each sensor's gain; an angle and its rate share one.
        damping_std: Standard deviation of ln zeta for a mode that no survey measured.
        umbilical_hz: Frequency that a weak cable may give the article where it floats, all from zero to this
            as likely (`tie_umbilical`); on an article with supports a weak cable is negligible. Frequencies
            of flexible modes allow for 0.03 Hz.
    """

    delay_s: float = 0.0
    delay_tolerance_s: float = 0.0
    gain_tolerance: float = 0.0
    damping_std: float = 0.3
    umbilical_hz: float = 0.0

    def __post_init__(self) -> None:
        values = (
            self.delay_s,
            self.delay_tolerance_s,
            self.gain_tolerance,
            self.damping_std,
            self.umbilical_hz,
        )
        sound = all(np.isfinite(v) and v >= 0.0 for v in values)
        if not sound or self.delay_tolerance_s > self.delay_s or self.gain_tolerance >= 1.0:
            raise ConfigError(
                f"delay {self.delay_s} s +- {self.delay_tolerance_s} s, gain +- {self.gain_tolerance}, "
                f"damping +- {self.damping_std}, umbilical to {self.umbilical_hz} Hz",
                where="spread of the loop",
                hint="zero or positive; a tolerance of the delay within it, of the gain below 1",
            )

    @property
    def most_cable_hz(self) -> float:
        """Highest frequency of a cable that frequencies of flexible modes allow for, stated or not."""
        return max(self.umbilical_hz, CABLE_HZ)


@record
class DrawnPlants:
    """Plants, and what was drawn for each.

    Attributes:
        names: Names of drawn numbers: unknowns, errors of each mode's frequency and damping, delay, gains.
        drawn: In deviations from its mean, those within tolerances in parts of these; a row a plant.
    """

    plants: tuple[Plant, ...]
    names: tuple[str, ...]
    drawn: Float[np.ndarray, "plant name"]


@record(kw_only=True)
class PlantDraws:
    """Plants of an article in an environment, drawn but not built yet: each is the same in any order.

    Attributes:
        there: The article and what the unknowns move there.
        mean: Its most probable modes.
        build, finish, loop: As `draw_plants` has them.
        sensors: Each output's, an angle and its rate being one's.
        n: Numbers of the estimate's root.
        alone, lossy: Numbers of each mode's own error and damping.
        pulls: Share of the umbilical's frequency, from zero to one.
        delay_place, gains: Place of the delay and of each sensor's gain within its tolerance, from -1 to 1.
    """

    refined: Refined
    there: SetUp
    mean: Prediction
    build: Callable[[Modes], Plant]
    finish: Callable[[Plant], Plant]
    loop: LoopSpread
    sensors: tuple[str, ...]
    n: Float[np.ndarray, "draw both"]
    alone: Float[np.ndarray, "draw mode"]
    lossy: Float[np.ndarray, "draw mode"]
    pulls: Float[np.ndarray, " draw"]
    delay_place: Float[np.ndarray, " draw"]
    gains: Float[np.ndarray, "draw sensor"]

    def plants(self, which: range) -> DrawnPlants:
        """The plants of these draws. Raises `NumericalError` where an article has no rest state."""
        both = [self._one(number) for number in which]
        plants, drawn = (tuple(x) for x in zip(*both, strict=True)) if both else ((), ())
        return DrawnPlants(plants, self.names, np.reshape(drawn, (len(both), len(self.names))))

    @functools.cached_property
    def like(self) -> Plant:
        """A plant with the ports and the form of all."""
        return self.finish(self.build(self.mean.modes))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is drawn, as in `DrawnPlants`."""
        modes = [self.mean.modes.name[i] for i in self.mean.index]
        return (
            *(u.name for u in self.refined.unknowns),
            *(f"frequency of {n}" for n in modes),
            *(f"damping of {n}" for n in modes),
            "delay",
            "umbilical",
            *(f"gain of {n}" for n in dict.fromkeys(self.sensors)),
        )

    def _one(self, number: int) -> tuple[Plant, Float[np.ndarray, " name"]]:
        mean, loop, n, delay_place = self.mean, self.loop, self.n[number], self.delay_place[number]
        cable_hz = loop.umbilical_hz * floats(self.there.environment)
        try:
            modes = _drawn_modes(self.refined, self.there, n, cable_hz * self.pulls[number])
        except NumericalError as error:
            error.where = ", ".join(filter(None, (f"draw {number} of {len(self.n)}", error.where)))
            raise
        shift = mean.log_shift + mean.log_root @ n + mean.log_rest * self.alone[number]
        lossy = mean.damping_root @ n + mean.damping_alone(loop.damping_std) * self.lossy[number]
        zeta = mean.damping * np.exp(lossy)
        plant = self.build(modes)
        gains = 1.0 + loop.gain_tolerance * self.gains[number]
        gain = dict(zip(dict.fromkeys(self.sensors), gains, strict=True))
        modal = _moved(require_modal(plant), mean, modes, shift, zeta)
        modal = _scaled_outputs(modal, np.array([gain[s] for s in self.sensors]))
        plant = self.finish(dataclasses.replace(plant, dynamics=modal))
        delay = loop.delay_s + loop.delay_tolerance_s * delay_place
        # A number without tolerance was not drawn, and no risk depends on it.
        of_loop = [
            delay_place * (loop.delay_tolerance_s > 0.0),
            (2.0 * self.pulls[number] - 1.0) * (cable_hz > 0.0),
            *(self.gains[number] * (loop.gain_tolerance > 0.0)),
        ]
        own = (shift - mean.log_shift) / mean.log_std
        drawn = np.concatenate([_in_deviations(self.refined, n), own, self.lossy[number], of_loop])
        return delay_plant(plant, delay) if delay else plant, drawn


def draw_plants(
    refined: Refined,
    environment: Environment,
    build: Callable[[Modes], Plant],
    *,
    draws: int,
    rng: np.random.Generator,
    loop: LoopSpread,
    finish: Callable[[Plant], Plant] = lambda plant: plant,
    mean: Prediction | None = None,
) -> PlantDraws:
    """``draws`` plants of the article in ``environment``.

    ``build`` makes a plant in modal form of the lowest modes; ``finish`` changes it once gains, frequencies
    and damping are in, for example to close an inner loop; the delay comes last. ``mean`` is
    `predict_modes` there of as many modes as such a plant has, if known. Raises `ConfigError` for a plant
    that is not modal.
    """
    there = set_up(refined.structure, environment, (), refined.unknowns)
    plant = build(there.solve(refined.x) if mean is None else mean.modes)
    count, sensors = len(require_modal(plant).omega), _sensors(plant)
    if mean is None:
        mean = predict_modes(refined, environment, count=count, umbilical_hz=loop.most_cable_hz)
    # A stream of its own: with a cable or without, all else is drawn alike.
    pulls = rng.spawn(1)[0].uniform(0.0, 1.0, draws)
    both, modes, own = refined.estimate.root.shape[1], len(mean.index), len(set(sensors))
    rows = [
        (
            refined.with_shear(rng.standard_normal(both)),
            *rng.standard_normal((2, modes)),
            rng.uniform(-1.0, 1.0),
            rng.uniform(-1.0, 1.0, own),
        )
        for _ in range(draws)
    ]
    n, alone, lossy, delay_place, gains = (np.array(x) for x in zip(*rows, strict=True))
    return PlantDraws(
        refined=refined,
        there=there,
        mean=mean,
        build=build,
        finish=finish,
        loop=loop,
        sensors=sensors,
        n=n,
        alone=alone,
        lossy=lossy,
        pulls=pulls,
        delay_place=delay_place,
        gains=gains,
    )


def _drawn_modes(refined: Refined, there: SetUp, n: np.ndarray, umbilical_hz: float) -> Modes:
    x, shear = refined.drawn_at(n)
    tied = tie_umbilical(*there[:2], umbilical_hz)
    try:
        return there._replace(structure=add_shear(there.structure, shear), environment=tied).solve(x)
    except NumericalError as error:
        off = {u.name: (v - u.mean) / u.spread for u, v in zip(refined.unknowns, x, strict=True)}
        far = sorted(off, key=lambda name: -abs(off[name]))[:NAMED]
        error.hint = (
            "narrower spreads of the unknowns that the surveys do not see, or surveys that do; here "
            + ", ".join(f"{name} is {off[name]:+.2g}" for name in far)
            + " of its standard deviations off its prior"
        )
        raise


def mean_plant(mean: Prediction, build: Callable[[Modes], Plant]) -> Plant:
    """The plant of the most probable frequencies and damping; ``build`` as in `draw_plants`."""
    plant = build(mean.modes)
    modal = _moved(require_modal(plant), mean, mean.modes, mean.log_shift, mean.damping)
    return dataclasses.replace(plant, dynamics=modal)


def _sensors(plant: Plant) -> tuple[str, ...]:
    """The sensor of each output; an angle and its rate are of one sensor."""
    return tuple(port.name.removesuffix(RATE) for port in plant.outputs)


def _in_deviations(refined: Refined, n: np.ndarray) -> np.ndarray:
    found = refined.estimate
    return (found.root @ n)[: len(refined.unknowns)] / found.x_std


def _moved(
    modal: ModalSystem, mean: Prediction, modes: Modes, shift: np.ndarray, zeta: np.ndarray
) -> ModalSystem:
    """The drawn frequencies and damping, each at the mode of this draw that has most of the shape."""
    kept = len(modal.omega)
    at = np.array([i for i, kind in enumerate(modes.kind) if kind != "rigid"], dtype=int)
    cross = mean.modes.shapes[:, mean.index].T @ (mean.modes.mass @ modes.shapes[:, at])
    mine, theirs = linear_sum_assignment(np.abs(cross), maximize=True)
    omega, damping = modal.omega.copy(), modal.zeta.copy()
    for k, i in zip(mine.tolist(), at[theirs].tolist(), strict=True):
        if i < kept:
            omega[i] = mean.modes.omega[mean.index[k]] * np.exp(shift[k])
            damping[i] = zeta[k]
    return dataclasses.replace(modal, omega=omega, zeta=damping)


def _scaled_outputs(modal: ModalSystem, gain: np.ndarray) -> ModalSystem:
    rows = gain[:, None]
    acceleration, direct = modal.phi_acceleration, modal.direct
    return dataclasses.replace(
        modal,
        phi=rows * modal.phi,
        phi_rate=rows * modal.phi_rate,
        phi_acceleration=None if acceleration is None else rows * acceleration,
        direct=None if direct is None else rows * direct,
    )
