"""A candidate modal test, and its results on the article as estimated."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.correlation.measured_modes import (
    COUNT,
    MeasuredModes,
    every_channel,
    measure_modes,
    seen,
    sensor_rows,
    sort_rms,
    straight_channels,
)
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.updating.residuals.surveys import SHAPE_STD
from middeck.values import record

# Share of a mode's largest motion: channels with less do not measure the mode.
SEEN = 0.01


@record(kw_only=True)
class CandidateSurvey:
    """A candidate modal test: a set-up, and the modes that it would measure there.

    Attributes:
        settings: As of `Survey`.
        frequency_std: Standard deviation of a frequency over the frequency.
        shape_std: Standard deviation over the rms of the mode's channels of that sort.
        channels: (node, direction) as of `MeasuredModes`; none for frequencies alone, None for every node's
            six directions and every joint.
        count: Number of lowest moving modes of the band, suspension modes among them.
        band_hz: Between which frequencies it sees modes [Hz].

    Raises `ConfigError` for deviations, a count or a band that cannot be.

    >>> CandidateSurvey(name="again", environment=Environment.orbit(), frequency_std=1e-3).shape_std
    0.05
    """

    name: str
    environment: Environment
    frequency_std: float
    shape_std: float = SHAPE_STD
    settings: tuple[tuple[str, float], ...] = ()
    channels: tuple[tuple[str, str], ...] | None = None
    count: int = COUNT
    band_hz: tuple[float, float] = (0.0, np.inf)

    def __post_init__(self) -> None:
        where, (low, high) = f"candidate {self.name!r}", self.band_hz
        if not (0.0 < self.frequency_std < 1.0 and 0.0 < self.shape_std < 1.0):
            raise ConfigError(
                f"deviations of {self.frequency_std} in frequency and {self.shape_std} in shape",
                where=where,
                hint="relative, above 0 and below 1, e.g. 0.001 and 0.05",
            )
        if self.count < 1 or not 0.0 <= low < high:
            raise ConfigError(
                f"{self.count} modes from {low:g} to {high:g} Hz",
                where=where,
                hint="one mode at least, in a band that rises from 0 Hz or more",
            )


class Seen(NamedTuple):
    """The measured modes of a test, and those in its band that its channels miss: name and frequency [Hz]."""

    measured: MeasuredModes
    unseen: tuple[tuple[str, float], ...]


def measured_by(candidate: CandidateSurvey, modes: Modes) -> Seen:
    """The candidate's results without noise, with its stated standard deviations.

    Raises `ConfigError` where there is nothing to be seen.
    """
    low, high = candidate.band_hz
    moving = [i for i, kind in enumerate(modes.kind) if kind != "rigid"]
    chosen = [i for i in moving if low <= modes.frequency_hz[i] <= high][: candidate.count]
    if not chosen:
        first = f"the lowest is at {modes.frequency_hz[moving[0]]:.4g} Hz" if moving else "all are rigid"
        raise ConfigError(f"no mode from {low:g} to {high:g} Hz", hint=f"another band; {first}")
    sees = _sees(modes, candidate.channels, chosen)
    moved = [i for i, has in zip(chosen, sees, strict=True) if has]
    if not moved:
        raise ConfigError(
            f"its channels see none of {len(chosen)} modes", hint="other nodes, or other directions"
        )
    found = measure_modes(modes, candidate.channels, chosen=moved)
    rms = sort_rms(straight_channels(modes, found.node, found.direction), found.shape)
    # Channels of a sort that stands still in a mode have the noise of those that would just see it.
    still = SEEN * np.max(np.abs(found.shape), axis=0, initial=0.0)
    return Seen(
        dataclasses.replace(
            found,
            frequency_std_hz=candidate.frequency_std * found.frequency_hz,
            shape_std=candidate.shape_std * np.maximum(rms, still),
        ),
        tuple((modes.name[i], float(modes.frequency_hz[i])) for i in chosen if i not in moved),
    )


def _sees(modes: Modes, channels: Sequence[tuple[str, str]] | None, chosen: Sequence[int]) -> np.ndarray:
    """Whether each mode moves a channel by a considerable part of the largest motion of its sort."""
    if not channels:
        return np.ones(len(chosen), dtype=bool)
    every = measure_modes(modes, every_channel(modes.equilibrium.model), chosen=chosen)
    own = measure_modes(modes, channels, chosen=chosen)
    most, moved = (_most(modes, one) for one in (every, own))
    large = np.any(moved > SEEN * most, axis=0)
    nodes, directions = zip(*channels, strict=True)
    # In a mode without any motion of a sort, rounding would be the largest part.
    return large & np.any(seen(sensor_rows(modes, nodes, directions), modes)[:, list(chosen)], axis=0)


def _most(modes: Modes, measured: MeasuredModes) -> np.ndarray:
    """The largest motion in each mode, along a direction and about one."""
    straight = straight_channels(modes, measured.node, measured.direction)
    sorts = (np.abs(measured.shape[sort]) for sort in (straight, ~straight))
    return np.array([np.max(motion, axis=0, initial=0.0) for motion in sorts])
