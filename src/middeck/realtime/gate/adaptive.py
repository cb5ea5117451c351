"""A bounded adaptive gain of a package, and its proof over all gains, moves and models."""

import math
from collections.abc import Mapping

from middeck.errors import ConfigError, NumericalError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.gate.gain_loop import form_gain_loop
from middeck.realtime.gate.gain_proof import Proved, prove_interval
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.plants.plant import Plant
from middeck.values import record


@record(kw_only=True)
class GainProof:
    """The proof of the loop with one model, or why there is none.

    Attributes:
        model: Its name.
        proved: For every constant gain from zero up, and for every path of the gain within its rate.
        constant: For every constant gain from ``minimum`` to ``maximum``.
        fades: For every constant gain from zero up, which a fade passes.
        decay_per_s: Least decay that is proved of every constant gain [1/s]; 0 for none.
        fade_growth: A bound of the factor by which a fade, however fast, lets the norm of the proof from zero
            up grow, while the gain stands still; infinite where there is none.
        rate_limit: A rate [1/s] up to which it is proved; None where it is proved at any rate.
        weakest: The gains between which the decay that is proved is least; None where none is.
        pieces: Intervals of gain with a metric of their own.
        unstable_gain: A gain at which the loop is proved to be unstable; None where there is none.
        said: In words.
    """

    model: str
    proved: bool
    constant: bool
    fades: bool
    decay_per_s: float
    fade_growth: float
    rate_limit: float | None
    weakest: tuple[float, float] | None
    pieces: int
    unstable_gain: float | None
    said: str


def prove_gain(
    package: ControllerPackage, gain: AdaptiveGain, models: Mapping[str, Plant]
) -> tuple[GainProof, ...]:
    """Proof of stability under the adaptive gain with each of ``models``, while no limit acts.

    Nothing is sampled: every gain from ``minimum`` to ``maximum`` and every move is covered (`gain_path`),
    and rounding is bounded. A fade f takes f g from zero up while the gain g stands still: so every gain from
    zero to ``maximum`` is proved too, in norms of its own where ``minimum`` is above zero. What cannot be
    proved is not proved; it may still be stable.
    Raises `ConfigError` for a sensor that the package does not read and a band beyond half its rate.
    """
    fault = misfit(package, gain)
    if fault:
        raise ConfigError(
            fault, where="adaptive gain", hint="an input of the package, a band below half its rate"
        )
    return tuple(_prove(package, gain, name, plant) for name, plant in models.items())


def misfit(package: ControllerPackage, gain: AdaptiveGain) -> str:
    """Why ``gain`` cannot watch its band on ``package``; empty where it can."""
    names = [port.name for port in package.inputs]
    if gain.sensor not in names:
        return f"no input {gain.sensor!r} to watch: one of {', '.join(names)}"
    half = 0.5 / package.period_s
    if gain.band_hz[1] >= half:
        return f"a band up to {gain.band_hz[1]:g} Hz, half the rate is {half:g} Hz"
    return ""


def _prove(package: ControllerPackage, gain: AdaptiveGain, name: str, plant: Plant) -> GainProof:
    try:
        loop = form_gain_loop(package, plant)
        found = prove_interval(loop, gain.minimum, gain.maximum, gain.rate * package.period_s)
        faded = prove_interval(loop, 0.0, gain.maximum, 0.0) if gain.minimum else found
    except (ConfigError, NumericalError) as error:
        found = faded = Proved(said=f"not decided: {error.what}")
    period = package.period_s
    limit = None if math.isinf(found.step) else found.step / period
    return GainProof(
        model=name,
        proved=bool(max(found.moving, faded.constant) < 1.0),
        constant=bool(found.constant < 1.0),
        fades=bool(faded.constant < 1.0),
        decay_per_s=_decay(found.constant, period),
        fade_growth=faded.fade,
        rate_limit=limit,
        weakest=found.weakest,
        pieces=found.pieces,
        unstable_gain=faded.unstable_gain if found.unstable_gain is None else found.unstable_gain,
        said=found.said or _describe(gain, found, limit, period) + _describe_fades(gain, faded),
    )


def _describe_fades(gain: AdaptiveGain, faded: Proved) -> str:
    if not gain.minimum:
        return ""
    if faded.constant < 1.0:
        return f"; so does every gain from zero, as fades pass them, however fast ({_growth(faded)})"
    return f"; but a fade passes every gain from zero, and those are not proved to decay: {faded.said}"


def _growth(faded: Proved) -> str:
    return f"the norm grows by a factor of {faded.fade:.3g} at most"


def _decay(factor: float, period_s: float) -> float:
    return -math.log(factor) / period_s if factor < 1.0 else 0.0


def _describe(gain: AdaptiveGain, found: Proved, limit: float | None, period_s: float) -> str:
    said = (
        f"every constant gain from {gain.minimum:g} to {gain.maximum:g} decays by at least "
        f"{_decay(found.constant, period_s):.3g} 1/s"
    )
    if found.weakest is not None and limit is not None:
        said += f" (least from {found.weakest[0]:.3g} to {found.weakest[1]:.3g})"
    if limit is None:
        return said + "; so does every path of the gain, at any rate"
    if found.moving < 1.0:
        said += f"; every path within {gain.rate:g} 1/s decays too (proved up to {limit:.3g} 1/s)"
        return said if gain.minimum else f"{said}; in a fade, however fast, {_growth(found)}"
    return said + f"; paths are proved to decay up to a rate of {limit:.3g} 1/s, not {gain.rate:g} 1/s"
