"""Signals of two levels: the most power that a limited peak allows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.signals.excitation.grids import band_lines, whole_samples
from middeck.signals.excitation.limits import Limits, as_large_as_allowed
from middeck.signals.excitation.orthogonal_inputs import spread_signs
from middeck.signals.excitation.signal import Excitation

LARGEST_ORDER = 24
# A held bit has the power sin(x)^2 / x^2, x = pi f hold / sample_hz: half of it is left at 0.44 of the clock.
HALF_POWER = 0.44
STARTS, SWAPS = 8, 100  # in the search for a binary signal; more of either gains less than a per cent


def design_mls(
    order: int,
    sample_hz: float,
    limits: Limits | Sequence[Limits],
    rng: np.random.Generator,
    *,
    hold: int = 1,
    inputs: int = 1,
) -> Excitation:
    """A maximum length sequence: pseudo-random bits with a period of 2^order - 1 (Golomb 1967).

    Its spectrum is flat but for the hold of each bit over ``hold`` samples; ``lines`` are those up to where
    half the power is left, 0.44 ``sample_hz`` / ``hold``. The rng chooses where in the sequence it begins.
    Raises `ConfigError` for an order outside 2 to 24, a hold below one, or a limit of slew, which no step
    keeps.

    >>> made = design_mls(5, 100.0, Limits(peak=1.0), np.random.default_rng(0))
    >>> made.u.shape, float(made.crest_factor[0])
    ((1, 31, 1), 1.0)
    """
    if not 2 <= order <= LARGEST_ORDER or hold < 1:
        raise ConfigError(
            f"no maximum-length sequence of order {order} with {hold} samples a bit",
            hint=f"an order of 2 to {LARGEST_ORDER} and one sample or more",
        )
    _refuse_slew(limits)
    import scipy.signal  # takes a second, which no other signal needs

    state = rng.integers(2, size=order)
    state[0] |= not state.any()  # a register of zeros stays one
    bits = np.asarray(scipy.signal.max_len_seq(order, state=state)[0], dtype=float)
    u = spread_signs(np.repeat(2.0 * bits - 1.0, hold), inputs)
    last = int(HALF_POWER * len(bits)) if hold > 1 else (len(bits) - 1) // 2
    what = f"maximum length sequence of 2^{order} - 1 bits at {sample_hz / hold:.6g} Hz"
    return as_large_as_allowed("binary", what, u, np.arange(1, max(1, last) + 1), limits, sample_hz)


def design_binary(
    band_hz: tuple[float, float],
    period_s: float,
    sample_hz: float,
    limits: Limits | Sequence[Limits],
    rng: np.random.Generator,
    *,
    inputs: int = 1,
) -> Excitation:
    """A discrete interval binary signal: two levels, as much power as possible on the lines of the band.

    From the sign of a random-phase multisine; its phases are kept, its amplitudes made equal, and the sign is
    taken again until nothing changes (Van den Bos and Krol 1979); the best of eight starts. What is left
    outside the band is the price of two levels. Raises `ConfigError` as `random_multisine`, and for a limit
    of slew.
    """
    _refuse_slew(limits)
    samples = whole_samples(period_s, sample_hz)
    first, last = band_lines(band_hz, period_s, sample_hz)
    lines = np.arange(first, last + 1)
    found = [_swap(lines, samples, rng) for _ in range(STARTS)]
    # Even lines make the sum of their amplitudes largest for a given power.
    best = max(found, key=lambda u: float(np.sum(np.abs(np.fft.rfft(u)[lines]))))
    share = float(np.sum(2.0 * np.abs(np.fft.rfft(best)[lines] / samples) ** 2))
    what = f"binary signal with {share:.0%} of its power on {len(lines)} lines from "
    what += f"{lines[0] / period_s:.6g} to {lines[-1] / period_s:.6g} Hz"
    return as_large_as_allowed("binary", what, spread_signs(best, inputs), lines, limits, sample_hz)


def _swap(lines: np.ndarray, samples: int, rng: np.random.Generator) -> Float[np.ndarray, " sample"]:
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    u = _sign(np.fft.irfft(spectrum, samples))
    for _ in range(SWAPS):
        spectrum[lines] = np.exp(1j * np.angle(np.fft.rfft(u)[lines]))
        following = _sign(np.fft.irfft(spectrum, samples))
        if np.array_equal(following, u):
            break
        u = following
    return u


def _sign(u: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    return np.where(u >= 0.0, 1.0, -1.0)


def _refuse_slew(limits: Limits | Sequence[Limits]) -> None:
    each = [limits] if isinstance(limits, Limits) else limits
    if any(own.slew is not None for own in each):
        raise ConfigError(
            "a binary signal jumps between two values and exceeds any slew limit",
            hint="use a multisine or a sweep",
        )
