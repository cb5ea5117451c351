"""The tracked parameters, and the state of tracking them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio, natural_hz
from middeck.identification.tracking.lag import Sums, no_lag, unexplained
from middeck.identification.tracking.loss_and_restart import (
    WATCHED,
    Recovery,
    Restart,
    first_recovery,
    is_trusted,
)
from middeck.identification.uncertainty.parameter_deviations import ParameterDeviations
from middeck.values import record

# Motion before the first sample, as a multiple of what white inputs of the stated rms would keep up: a signal
# of a narrower band has more of its power where the modes are.
MORE_IN_BAND = 3.0
# Constants whose real part is below this share are those of a displacement.
ROUNDING = 1e-9
# Default deviations: those of a fit that is good enough to start from.
FIRST_FREQUENCY, FIRST_DAMPING, FIRST_GAIN = 0.005, 0.2, 0.05


@record(kw_only=True)
class RandomWalk:
    """Assumed random drift of the parameters.

    Attributes:
        frequency, damping, gain: Relative drift of each in one second; it grows with the square root of time.
            A slower one gives smaller deviations and follows later.
        frequency_jump, damping_jump: Relative size of a sudden change. When the corrections of a parameter go
            one way for longer than chance allows, its mode is thought to have jumped, and is found again from
            so large a deviation, with its neighbours within a tenth of its frequency.
    """

    frequency: float = 3e-5
    damping: float = 1e-3
    gain: float = 3e-4
    frequency_jump: float = 0.01
    damping_jump: float = 0.2

    def __post_init__(self) -> None:
        each = (self.frequency, self.damping, self.gain, self.frequency_jump, self.damping_jump)
        if not all(np.isfinite(x) and x >= 0.0 for x in each):
            raise ConfigError(f"drifts {each}", hint="finite numbers of zero or more")


@record(kw_only=True)
class Followed:
    """The constants of a tracked model.

    Attributes:
        T: Sampling period [s].
        shapes, participation, direct: Those of the model; ``shapes`` are divided by the loss of a hold that
            the model's constants already contain.
        real_constants: Whether phi psi is held when a frequency moves, and the residue phi psi / (2 j
            omega_d) goes with it.
        group: Index of each output's delay, of ``whole`` samples and ``part`` of another.
        noise_rms: Rms of the noise on each output's samples.
    """

    T: float
    shapes: Complex[np.ndarray, "output mode"]
    participation: Complex[np.ndarray, "mode input"]
    direct: Float[np.ndarray, "output input"]
    poles: Complex[np.ndarray, " mode"]
    real_constants: bool
    group: Int[np.ndarray, " output"]
    whole: Int[np.ndarray, " delay"]
    part: Float[np.ndarray, " delay"]
    noise_rms: Float[np.ndarray, " output"]
    drift: RandomWalk


@record(kw_only=True)
class Tracking:
    """Modal parameters as known after so many samples, with all that is needed to go on.

    Attributes:
        samples: Seen so far.
        mean, covariance: Mean and covariance of the modal states (real parts, imaginary parts; for each
            delay), log frequency, log damping and gains, in that order.
        past: Inputs on their way through the delays, latest first.
        corrections, chance: Weighted sum of recent corrections of log frequency and log damping, and its
            variance by chance.
        lag: Sums by which a parameter that lags is detected (`lag`).
        products: Weighted means of the products of normalised innovations, lags zero and on.
        late: Latest normalised innovations, latest first.
        weight: Weight of what the means have seen, up to one.
        jumps: Number of detected jumps of each mode, or of one within a tenth of its frequency.
        recovery: State from which a restart begins, should the modes be lost.
    """

    followed: Followed
    samples: int
    mean: Float[np.ndarray, " unknown"]
    covariance: Float[np.ndarray, "unknown unknown"]
    past: Float[np.ndarray, "age input"]
    corrections: Float[np.ndarray, " parameter"]
    chance: Float[np.ndarray, " parameter"]
    lag: Sums
    products: Float[np.ndarray, " lag"]
    late: Float[np.ndarray, "age2 output"]
    weight: float
    jumps: Int[np.ndarray, " mode"]
    recovery: Recovery

    @property
    def restarts(self) -> tuple[Restart, ...]:
        """When the modes were lost, and from which good state they were followed again."""
        return self.recovery.restarts

    @property
    def time_s(self) -> float:
        """Time of the last sample [s], from the first."""
        return self.samples * self.followed.T

    @property
    def _log(self) -> np.ndarray:
        return log_places(self.followed)

    @property
    def natural_hz(self) -> Float[np.ndarray, " mode"]:
        """Undamped natural frequency of each mode [Hz]."""
        return np.exp(self.mean[self._log[0]]) / (2.0 * np.pi)

    @property
    def frequency_std_hz(self) -> Float[np.ndarray, " mode"]:
        """Its standard deviation."""
        return self.natural_hz * self._deviation(self._log[0])

    @property
    def damping(self) -> Float[np.ndarray, " mode"]:
        """Damping ratio of each mode."""
        return np.exp(self.mean[self._log[1]])

    @property
    def damping_std(self) -> Float[np.ndarray, " mode"]:
        """Its standard deviation."""
        return self.damping * self._deviation(self._log[1])

    @property
    def gain(self) -> Float[np.ndarray, "output mode"]:
        """Modal constants as multiples of the model's at the start."""
        outputs, modes = self.followed.shapes.shape
        return 1.0 + self.mean[len(self.mean) - outputs * modes :].reshape(outputs, modes)

    @property
    def trusted(self) -> bool:
        """Whether the innovations are white and as large as stated; if not, the model does not hold."""
        return is_trusted(self.products, self.weight, len(self.followed.noise_rms))

    def _deviation(self, places: np.ndarray) -> np.ndarray:
        behind = unexplained(self.lag)[places - self._log[0, 0]]
        return np.sqrt(np.maximum(np.diag(self.covariance)[places], 0.0) + behind)


def log_places(followed: Followed) -> np.ndarray:
    """Places of log frequency (first row) and log damping among the unknowns."""
    modes = len(followed.poles)
    first = 2 * modes * len(followed.whole)
    return first + np.arange(2 * modes).reshape(2, modes)


def start_tracking(
    model: MeasurementModel,
    *,
    sample_hz: float,
    noise_rms: Float[np.ndarray, " output"] | float,
    input_rms: Float[np.ndarray, " input"] | float,
    known: ParameterDeviations | None = None,
    drift: RandomWalk | None = None,
) -> Tracking:
    """The state before the first sample.

    Args:
        model: Model at the start: a continuous one of conjugate pairs, fitted to an earlier record or made
            from a plant (`model_of_plant`). Without a ``hold_s``, half a sample of hold is in its delays.
            Frequencies, damping and the size of each mode at each output are followed; delays and the direct
            term are taken as they are.
        sample_hz: Rate of the samples that will come; inputs are held from each to the next.
        noise_rms: Rms of the white noise on each output's samples.
        input_rms: Rms of the inputs before the first sample, which sets the variance of the unknown motion
            at the start; zero for an article at rest.
        known: Standard deviations of the model's frequencies and damping; 0.5 and 20 per cent by default.
        drift: Assumed random drift of the parameters.

    Raises `ConfigError` for a sampled model, one with real poles or terms of modes below the band, delays
    that differ by input, a mode at or above half the sampling rate, noise that is not positive, an input that
    is negative or not finite, or a delay shorter than the hold in it.
    """
    noise = np.broadcast_to(np.asarray(noise_rms, dtype=float), (len(model.outputs),))
    rms = np.broadcast_to(np.asarray(input_rms, dtype=float), (len(model.inputs),))
    _check(model, sample_hz, noise, rms)
    followed = _followed(model, sample_hz, noise, drift or RandomWalk())
    modes, outputs, groups = len(model.poles), len(model.outputs), len(followed.whole)
    moving = motion_deviation(followed, rms**2)
    known_by = _parameter_deviation(model, known)
    deviation = np.concatenate([np.tile(moving, 2 * groups), known_by])
    parameters = np.concatenate(
        [np.log(np.abs(model.poles)), np.log(damping_ratio(model)), np.zeros(outputs * modes)]
    )
    return Tracking(
        followed=followed,
        samples=0,
        mean=np.concatenate([np.zeros(2 * modes * groups), parameters]),
        covariance=np.diag(deviation**2),
        past=np.zeros((int(followed.whole.max()) + 2, len(model.inputs))),
        corrections=np.zeros(2 * modes),
        chance=np.zeros(2 * modes),
        lag=no_lag(2 * modes),
        products=np.zeros(WATCHED + 1),
        late=np.zeros((WATCHED, outputs)),
        weight=0.0,
        jumps=np.zeros(modes, dtype=int),
        recovery=first_recovery(parameters, known_by**2, rms**2),
    )


def motion_deviation(followed: Followed, loudness: Float[np.ndarray, " input"]) -> Float[np.ndarray, " mode"]:
    """Standard deviation of the modal states under a force of which only the mean square is known."""
    # z' = lambda z + b u under white u, rms^2 T: E|z|^2 = |b|^2 rms^2 T / (2 sigma).
    power = np.abs(followed.participation) ** 2 @ loudness * followed.T / (-2.0 * np.real(followed.poles))
    return MORE_IN_BAND * np.sqrt(power)


def _parameter_deviation(
    model: MeasurementModel, known: ParameterDeviations | None
) -> Float[np.ndarray, " parameter"]:
    """Standard deviations of log frequency, log damping and gains at the start."""
    modes = len(model.poles)
    f = FIRST_FREQUENCY if known is None else known.natural_hz / natural_hz(model)
    z = FIRST_DAMPING if known is None else known.damping / damping_ratio(model)
    each = [np.broadcast_to(x, (modes,)) for x in (f, z)]
    return np.concatenate([*each, np.full(len(model.outputs) * modes, FIRST_GAIN)])


def _followed(model: MeasurementModel, sample_hz: float, noise: np.ndarray, drift: RandomWalk) -> Followed:
    T = 1.0 / sample_hz
    delay = model.delay_s + (0.0 if model.path_delay_s is None else model.path_delay_s[:, 0])
    # Where nothing is known of a hold the inputs were held, and half a sample of hold is in the delays.
    hold_in_model = model.hold_s is None
    pure = delay - 0.5 * T * hold_in_model
    if np.any(pure < -1e-9 * T):
        raise ConfigError(
            f"a delay of {delay.min()} s is less than the hold's own {0.5 * T} s",
            hint="a model of what is behind the hold says so: hold_s, zero for a plant with a pure delay",
        )
    # 1e-9 of a sample: decimals are not exact in binary.
    samples, group = np.unique(np.round(np.maximum(pure, 0.0) / T, 9), return_inverse=True)
    whole = np.floor(samples).astype(int)
    # A model fitted to held inputs has the hold's loss sin(x)/x in its constants: not twice.
    loss = np.sinc(natural_hz(model) * T) if hold_in_model else 1.0
    residue = np.einsum("om,mi->omi", model.shapes, model.participation)
    real = bool(np.all(np.abs(residue.real) <= ROUNDING * np.abs(residue).max(initial=0.0)))
    return Followed(
        T=T,
        shapes=model.shapes / loss,
        participation=model.participation,
        direct=model.direct,
        poles=model.poles,
        real_constants=real,
        group=np.asarray(group).ravel(),
        whole=whole,
        part=samples - whole,
        noise_rms=noise,
        drift=drift,
    )


def _check(model: MeasurementModel, sample_hz: float, noise: np.ndarray, rms: np.ndarray) -> None:
    if model.sample_hz is not None or np.any(model.lower) or not np.all(model.is_pair):
        raise ConfigError(
            "only a continuous model of conjugate pairs can be followed",
            hint="fit with real constants and without residual terms",
        )
    if not len(model.poles):
        raise ConfigError("a model without modes", hint="one mode or more")
    if model.path_delay_s is not None and np.ptp(model.path_delay_s, axis=1).any():
        raise ConfigError("delays that differ by input cannot be followed", hint="one delay for each output")
    if not (np.isfinite(sample_hz) and natural_hz(model).max() < 0.5 * sample_hz):
        raise ConfigError(
            f"a mode at {natural_hz(model).max():.6g} Hz cannot be followed at {sample_hz} Hz",
            hint="sample faster, or leave the mode out",
        )
    if not (np.isfinite(noise).all() and np.all(noise > 0.0)):
        raise ConfigError(f"noise of rms {noise.tolist()}", hint="a positive rms for each output")
    if not (np.isfinite(rms).all() and np.all(rms >= 0.0)):
        raise ConfigError(f"inputs of rms {rms.tolist()}", hint="zero for an article at rest")
