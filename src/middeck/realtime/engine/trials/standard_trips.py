"""A standard set of trips, made from a model of the article and a record of its normal operation."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.monitors import Monitor
from middeck.realtime.engine.interface.settings import EngineSettings
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.values import record

RATE = "_rate"
"""Ending of the name of a rate sensor."""
GROWS, TIMES = 1.2, 3
"""Growth of the rms from window to window that counts, and how many windows must grow."""
FLOOR, LIMIT = 3.0, 8.0
"""Multiples of the largest rms of normal operation: above the first growth counts, the second trips."""
LOOKED_S = 10.0
"""Time after a push in which the sensors are looked at [s]."""
SEEN = 0.01
"""Share of a sensor's largest answer that ends the delay."""
HALF = 0.5
"""Share of an output's limit whose rms trips in any band but the slowest: a sine at the limit has 0.71."""


@record
class Band:
    """Edges [Hz], and the window [s] over which its rms is compared: a few periods of what is in it."""

    low_hz: float
    high_hz: float
    window_s: float


BANDS = (Band(0.0, 2.0, 1.0), Band(2.0, 12.0, 0.3), Band(12.0, np.inf, 0.1))


@record
class Reach:
    """How far the article goes on in the safe state.

    Attributes:
        coast_s: Travel of each sensor per unit of its rate; 0 without a rate sensor.
        limit: Largest magnitude of each output whose push, from the sample that trips until the safe state
            has taken over, moves no sensor by more than its envelope; inf where none has one.
    """

    coast_s: Float[np.ndarray, " sensor"]
    limit: Float[np.ndarray, " output"]


def find_reach(settings: EngineSettings, article: LinearArticle) -> Reach:
    """Push each output of the held ``article`` and look how far its sensors go within `LOOKED_S`.

    A push that trips lasts as long as the article's own delay, one sample, and the ramp to the safe state.
    """
    pulses = _pulses(settings, article, settings.samples(LOOKED_S))
    size = np.abs(pulses)
    coast = np.zeros(len(settings.sensors))
    for place, rate in _rates(settings):
        peak = size[:, :, rate].max(axis=1)
        most = int(np.argmax(peak))
        coast[place] = size[most, :, place].max() / peak[most] if peak[most] > 0.0 else 0.0
    envelope = np.array([sensor.envelope for sensor in settings.sensors])
    limit = np.full(len(settings.drives), np.inf)
    for k, answers in enumerate(size):
        seen = np.flatnonzero((answers > SEEN * answers.max(axis=0)).any(axis=1))
        lag = (int(seen[0]) if len(seen) else 0) + 1 + settings.samples(settings.safe_ramp_s)
        steps = np.cumsum(pulses[k], axis=0)
        steps[lag:] -= steps[:-lag].copy()
        way = np.abs(steps).max(axis=0)
        moved = way > 0.0
        limit[k] = np.min(envelope[moved] / way[moved], initial=np.inf)
    return Reach(coast, limit)


def standard_monitors(
    settings: EngineSettings,
    y: Float[np.ndarray, "sample sensor"],
    u: Float[np.ndarray, "sample output"],
) -> tuple[Monitor, ...]:
    """Growth and band power of every sensor and output, against their largest in normal operation.

    Args:
        y, u: A record of it, at least ten of the longest windows: the noisiest that is normal, from the
            article or from a model of it.

    Bands beyond half the sampling rate are left out. An output's limit is at most half of its range in every
    band but the first, however much it was used. Raises `ConfigError` for a record that is too short.
    """
    longest = max(settings.samples(band.window_s) for band in BANDS)
    if min(len(y), len(u)) < 10 * longest:
        raise ConfigError(
            f"a record of {min(len(y), len(u))} samples", where="standard monitors", hint=f">= {10 * longest}"
        )
    below = [band for band in BANDS if 2.0 * band.low_hz * settings.period_s < 1.0]
    made: list[Monitor] = []
    for k, sensor in enumerate(settings.sensors):
        blank = Monitor(channel=sensor.port.name, band_hz=(0.0, np.inf))
        made += [_normal(settings, blank, band, y[:, k], np.inf) for band in below]
    for k, drive in enumerate(settings.drives):
        blank = Monitor(channel=drive.port.name, side="output", band_hz=(0.0, np.inf))
        half = HALF * max(-drive.lower, drive.upper)
        most = [np.inf if band is BANDS[0] else half for band in below]
        pairs = zip(below, most, strict=True)
        made += [_normal(settings, blank, band, u[:, k], high) for band, high in pairs]
    return tuple(one for one in made if one.limit < np.inf)  # no limit: it never moved, what is normal?


def guard(
    settings: EngineSettings,
    article: LinearArticle,
    y: Float[np.ndarray, "sample sensor"],
    u: Float[np.ndarray, "sample output"],
) -> EngineSettings:
    """``settings`` with the standard monitors, and envelopes that look as far ahead as the article coasts.

    Ranges, envelopes and limits of outputs stay those of the user; `find_reach` says which limits the safe
    state can catch.
    """
    coast, rates = find_reach(settings, article).coast_s, dict(_rates(settings))
    sensors = tuple(
        dataclasses.replace(sensor, rate=settings.sensors[rates[k]].port.name, coast_s=float(coast[k]))
        if k in rates
        else sensor
        for k, sensor in enumerate(settings.sensors)
    )
    guarded = dataclasses.replace(settings, sensors=sensors)
    return dataclasses.replace(guarded, monitors=standard_monitors(guarded, y, u))


def _rates(settings: EngineSettings) -> Iterator[tuple[int, int]]:
    names = [port.name for port in settings.inputs]
    for k, name in enumerate(names):
        if f"{name}{RATE}" in names:
            yield k, names.index(f"{name}{RATE}")


def _pulses(
    settings: EngineSettings, article: LinearArticle, count: int
) -> Float[np.ndarray, "output sample sensor"]:
    """Sensors of the held article after one sample of a unit of each output."""
    sections = [path.section for path in settings.hold]
    b0, b1, b2 = np.reshape([section.b for section in sections], (-1, 3)).T[:, :, None]
    a1, a2 = np.reshape([section.a for section in sections], (-1, 2)).T[:, :, None]
    reads, pushed = (
        [path.input for path in settings.hold],
        article.B[:, [path.output for path in settings.hold]],
    )
    x, s1, s2 = article.B.copy(), 0.0, 0.0
    found = np.zeros((count, len(article.C), article.B.shape[1]))
    for k in range(1, count):
        found[k] = y = article.C @ x
        value = y[reads]
        out = b0 * value + s1
        s1, s2 = b1 * value - a1 * out + s2, b2 * value - a2 * out
        x = article.A @ x + pushed @ out
    return found.transpose(2, 0, 1)


def _normal(
    settings: EngineSettings,
    blank: Monitor,
    band: Band,
    row: np.ndarray,
    most: float,
) -> Monitor:
    """The monitor of a band, from its largest rms in a record; its limit is at most ``most``."""
    monitor = dataclasses.replace(blank, band_hz=(band.low_hz, band.high_hz))
    largest = _largest_rms(settings, monitor, band.window_s, row)
    return dataclasses.replace(
        monitor,
        limit=min(LIMIT * largest or np.inf, most),
        seconds=band.window_s,
        window_s=band.window_s,
        factor=GROWS if largest else 0.0,  # what never moved grows from nothing
        times=TIMES,
        floor=min(FLOOR * largest, most / 2.0),
    )


def _largest_rms(settings: EngineSettings, monitor: Monitor, window_s: float, row: np.ndarray) -> float:
    """Largest rms of a window, the first few left out, in which the filter settles."""
    import scipy.signal

    b = monitor.sections(settings.period_s)
    sos = np.ascontiguousarray(np.hstack([b[:, :3], np.ones((2, 1)), b[:, 3:]]))
    window = settings.samples(window_s)
    passed = np.asarray(scipy.signal.sosfilt(sos, np.ascontiguousarray(row)))
    squares = passed[: len(row) // window * window].reshape(-1, window) ** 2
    return float(np.sqrt(squares.mean(axis=1)[3:].max()))
