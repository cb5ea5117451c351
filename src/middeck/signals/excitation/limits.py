"""Largest signal that limits of peak, rms and slew allow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError
from middeck.signals.excitation.signal import Excitation, slew_of
from middeck.values import record


@record
class Limits:
    """Limits of one input; a design is as large as they allow.

    Attributes:
        rms: Root mean square over a period, or over the whole signal.
        peak: Largest absolute sample.
        slew: Largest step between samples times the sampling rate [unit/s]; what an amplifier follows.
    """

    rms: float | None = None
    peak: float | None = None
    slew: float | None = None

    def __post_init__(self) -> None:
        given = [x for x in (self.rms, self.peak, self.slew) if x is not None]
        if not given or not all(np.isfinite(x) and x > 0.0 for x in given):
            raise ConfigError(
                f"limits rms = {self.rms}, peak = {self.peak}, slew = {self.slew}",
                hint="at least one of them, each a positive number",
            )


def as_large_as_allowed(
    kind: str,
    what: str,
    u: Float[np.ndarray, "experiment sample input"],
    lines: Int[np.ndarray, " line"],
    limits: Limits | Sequence[Limits],
    sample_hz: float,
    *,
    periodic: bool = True,
) -> Excitation:
    """The signal ``u``, up to a factor for each input, within its limits (`scale_to_limits`)."""
    scaled = scale_to_limits(u, limits, sample_hz, periodic=periodic)
    return Excitation(kind=kind, what=what, sample_hz=sample_hz, u=scaled, lines=lines, periodic=periodic)


def scale_to_limits(
    u: Float[np.ndarray, "experiment sample input"],
    limits: Limits | Sequence[Limits],
    sample_hz: float,
    *,
    periodic: bool,
) -> Float[np.ndarray, "experiment sample input"]:
    """``u`` with each input as large as its limits allow in every experiment.

    One factor for all experiments of an input: what is orthogonal stays so. Raises `ConfigError` where the
    number of limits is neither one nor that of the inputs.

    >>> u = np.array([0.0, 1.0, 0.0, -1.0])[None, :, None]
    >>> scale_to_limits(u, Limits(rms=1.0, peak=1.2), 4.0, periodic=True)[0, :, 0].tolist()
    [0.0, 1.2, 0.0, -1.2]
    """
    each = [limits] * u.shape[2] if isinstance(limits, Limits) else list(limits)
    if len(each) != u.shape[2]:
        raise ConfigError(f"{len(each)} limits for {u.shape[2]} inputs", hint="one for all, or one for each")
    rms = np.sqrt(np.mean(u**2, axis=1)).max(axis=0)
    peak = np.abs(u).max(axis=(0, 1))
    slew = slew_of(u, sample_hz, periodic=periodic).max(axis=0)
    factor = [
        min(
            allowed / has
            for allowed, has in ((own.rms, rms[i]), (own.peak, peak[i]), (own.slew, slew[i]))
            if allowed is not None
        )
        for i, own in enumerate(each)
    ]
    return u * np.array(factor)
