"""Slips of units in a survey, seen against the model: a factor that all frequencies or channels share.

Modes are matched by their shapes alone, translations and rotations each of any scale, so that neither a slip
in frequency nor one between metres and radians hides the match.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.measured_modes import (
    MeasuredModes,
    seen,
    sensor_rows,
    sort_rms,
    straight_channels,
)
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause

ALIKE = 0.8  # assurance from which on two shapes are taken for one mode
FEWEST = 3  # modes that must agree on a factor
VERY_ALIKE, FEW_CHANNELS = 0.95, 6  # where fewer agree: assurance, and channels from which it says something
IN_STEP = 0.15  # on a logarithmic scale: how far a survey without shapes may be off the model's lowest modes
AGREE = 0.25  # on a logarithmic scale: how far factors may lie from each other and from that of a unit
MOVES = 0.3  # of a mode's rms: least motion of a channel that shows its own scale

FREQUENCY = {
    2.0 * np.pi: "rad/s in place of Hz",
    0.5 / np.pi: "Hz divided by 2 pi",
    60.0: "cycles a minute in place of Hz",
    1e3: "mHz in place of Hz",
    1e-3: "kHz in place of Hz",
}
# What takes the place of a frequency f is FACTOR f^POWER.
POWERS = {
    (4.0 * np.pi**2, 2.0): "eigenvalues in (rad/s)^2 in place of Hz",
    (1.0, -1.0): "periods in s in place of Hz",
}
SCALES = {
    180.0 / np.pi: "degrees beside metres",
    np.pi / 180.0: "radians over 57.3",
    1e3: "mm beside m, or mrad beside rad",
    1e-3: "m beside mm, or rad beside mrad",
    25.4e-3: "m beside inches",
    1.0 / 25.4e-3: "inches beside m",
}
PERCENT, LOSS = 100.0, 0.2


def warnings_on_survey_units(modes: Modes, measured: MeasuredModes) -> tuple[str, ...]:
    """Warnings of wrong units in ``measured``, by its shapes or, without any, by its frequencies."""
    if measured.node:
        rows = sensor_rows(modes, measured.node, measured.direction)
        return warnings_on_units(modes, measured, seen(rows, modes))
    moving = np.array([kind != "rigid" for kind in modes.kind]) & (modes.frequency_hz > 0.0)
    bends = moving & np.array([kind == "flexible" for kind in modes.kind])
    ours, theirs = modes.frequency_hz, measured.frequency_hz
    return warnings_on_frequency_units(ours[moving], theirs) or warnings_on_frequency_units(
        ours[bends], theirs
    )


def warnings_on_units(
    modes: Modes, measured: MeasuredModes, shapes: Float[np.ndarray, "channel mode"]
) -> tuple[str, ...]:
    """Warnings of wrong units in ``measured``; ``shapes`` are those of the model at its channels."""
    straight = straight_channels(modes, measured.node, measured.direction)
    movable = np.array([kind != "rigid" for kind in modes.kind]) & (modes.frequency_hz > 0.0)
    index = np.flatnonzero(movable)
    if not len(index):
        return ()
    phi = shapes[:, index]
    levels = _decibels(phi, measured)
    alike = _matches(phi, np.asarray(measured.shape), straight)
    near = _nearest(modes.frequency_hz[index], measured.frequency_hz)
    ours, theirs = (alike if len(alike) >= FEWEST else near).T
    remarks = [levels] if levels else []
    remarks += warnings_on_frequencies_of_shapes(modes.frequency_hz[index], phi, measured, straight)
    remarks += _damping(modes, measured, index[ours], theirs)
    sorts = _sorts(phi, np.asarray(measured.shape), straight, alike)
    # One channel of a thousandfold scale makes any two shapes alike: then frequencies decide the pairs.
    channels = sorts or _channels(phi, measured, straight, alike) or _channels(phi, measured, straight, near)
    return tuple(remarks + ([] if levels else channels))


def warnings_on_frequencies_of_shapes(
    frequency_hz: Float[np.ndarray, " mode"],
    phi: Float[np.ndarray, "channel mode"],
    measured: MeasuredModes,
    straight: Bool[np.ndarray, " channel"],
) -> tuple[str, ...]:
    """A warning where modes of one shape have frequencies that differ by a unit: three, or very alike."""
    shape, theirs = np.asarray(measured.shape), measured.frequency_hz
    least = ALIKE if len(theirs) >= FEWEST else VERY_ALIKE
    ours, there = _matches(phi, shape, straight, least).T
    known = len(there) >= FEWEST or (least == VERY_ALIKE and len(phi) >= FEW_CHANNELS)
    return warnings_on_frequencies(frequency_hz[ours], theirs[there]) if known else ()


def warnings_on_frequency_units(
    frequency_hz: Float[np.ndarray, " mode"], measured_hz: Float[np.ndarray, " measured"]
) -> tuple[str, ...]:
    """A warning where frequencies without shapes are the model's lowest, in order, in another unit."""
    count = min(len(frequency_hz), len(measured_hz))
    if count < FEWEST:
        return ()
    ratio = np.log(np.sort(measured_hz)[:count] / np.sort(frequency_hz)[:count])
    middle = float(np.median(ratio))
    unit = _unit(float(np.exp(middle)), FREQUENCY)
    if not unit or np.abs(ratio - middle).max() > IN_STEP:
        return ()
    times = f"{np.exp(middle):.4g} times the model's lowest {count}, one by one"
    return (f"the {count} lowest frequencies are {times}: {unit}?",)


def _matches(
    phi: np.ndarray, shape: np.ndarray, straight: np.ndarray, least: float = ALIKE
) -> Int[np.ndarray, "pair 2"]:
    """(mode of the model, measured mode) whose shapes are alike in every sort of channel."""
    score = np.ones((phi.shape[1], shape.shape[1]))
    for sort in (straight, ~straight):
        if np.any(sort):
            score = np.minimum(score, modal_assurance(phi[sort], shape[sort]))
    best = score.argmax(axis=0)
    keep = np.flatnonzero(score[best, np.arange(len(best))] > least)
    return np.stack([best[keep], keep], axis=1)


def _nearest(ours_hz: np.ndarray, theirs_hz: np.ndarray) -> Int[np.ndarray, "pair 2"]:
    """Pairs by frequency, where no shape is alike."""
    best = np.abs(np.log(ours_hz[:, None] / theirs_hz)).argmin(axis=0)
    near = np.abs(np.log(ours_hz[best] / theirs_hz)) < AGREE
    return np.stack([best[near], np.flatnonzero(near)], axis=1)


def _factor(ratios: np.ndarray) -> float | None:
    """The factor that most of the ratios share; None where there is none."""
    known = np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])
    if not len(known):
        return None
    middle = float(np.median(known))
    return float(np.exp(middle)) if np.mean(np.abs(known - middle) < AGREE) > 0.5 else None


def _unit(factor: float | None, units: dict[float, str]) -> str:
    return next((u for f, u in units.items() if factor and abs(np.log(factor / f)) < AGREE), "")


def warnings_on_frequencies(
    ours: Float[np.ndarray, " pair"], theirs: Float[np.ndarray, " pair"]
) -> tuple[str, ...]:
    """A warning where the frequencies of pairs differ by a unit."""
    factor = _factor(theirs / ours)
    unit = _unit(factor, FREQUENCY)
    if unit:
        modes = f"the frequencies of {len(ours)} mode{'s' if len(ours) > 1 else ''} are"
        return (f"{modes} {factor:.4g} times the model's of the same shapes: {unit}?",)
    if factor is not None and abs(np.log(factor)) < AGREE:
        return ()
    powers = (
        power
        for (size, p), power in POWERS.items()
        if len(ours) >= FEWEST and _unit(_factor(theirs / ours**p), {size: power})
    )
    return tuple(f"the frequencies are not those of the same shapes: {power}?" for power in powers)


def _damping(modes: Modes, measured: MeasuredModes, ours: np.ndarray, theirs: np.ndarray) -> list[str]:
    if len(ours) < FEWEST or not np.isfinite(measured.damping).all():
        return []
    zeta = ratios_by_cause(modes, count=int(ours.max()) + 1).zeta[ours]
    ratio = np.median(measured.damping[theirs]) / max(float(np.median(zeta)), 1e-12)
    high = float(np.median(measured.damping)) > LOSS
    unit = high and abs(np.log(max(ratio, 1e-12) / PERCENT)) < np.log(4.0)
    return [f"the damping is {ratio:.3g} times the model's: per cent in place of a ratio?"] if unit else []


def _sorts(phi: np.ndarray, shape: np.ndarray, straight: np.ndarray, pairs: np.ndarray) -> list[str]:
    """Rotations of another scale than translations, alike in all modes."""
    if len(pairs) < FEWEST - 1 or np.all(straight) or not np.any(straight):
        return []
    a, b = phi[:, pairs[:, 0]], shape[:, pairs[:, 1]]
    gains = [np.abs(np.sum(a[s] * b[s], axis=0)) / np.sum(a[s] ** 2, axis=0) for s in (~straight, straight)]
    factor = _factor(gains[0] / gains[1])
    unit = _unit(factor, SCALES)
    return (
        [f"rotations are {factor:.3g} times too large beside translations, by the model: {unit}?"]
        if unit
        else []
    )


def _channels(phi: np.ndarray, measured: MeasuredModes, straight: np.ndarray, pairs: np.ndarray) -> list[str]:
    """Channels whose scale differs from that of most others by a unit's factor, alike in all modes."""
    if len(pairs) < FEWEST:
        return []
    a, b = phi[:, pairs[:, 0]], np.asarray(measured.shape)[:, pairs[:, 1]]
    moves = np.abs(a) > MOVES * sort_rms(straight, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where(moves, np.abs(b) / np.abs(a), np.nan)
        gain = gain / np.array([np.nanmedian(g) if np.isfinite(g).any() else np.nan for g in gain.T])
    found: dict[str, list[str]] = {}
    for channel, row in zip(measured.channels, gain, strict=True):
        known = row[np.isfinite(row)]
        unit = _unit(_factor(known), SCALES) if len(known) >= FEWEST - 1 else ""
        if unit:
            found.setdefault(unit, []).append(channel)
    return [
        f"{len(names)} channels ({', '.join(names[:4])}{', ...' if len(names) > 4 else ''}) have another"
        f" scale than the rest, against the model: {unit}?"
        for unit, names in found.items()
    ]


def _decibels(phi: np.ndarray, measured: MeasuredModes) -> str:
    """Whether levels in place of shapes explain the test: powers of ten of them are the model's sizes."""
    level = np.real(measured.shape)
    if not measured.is_real or np.abs(level).max() > 400.0:
        return ""
    size = 10.0 ** (level / 20.0)
    as_level = np.median(modal_assurance(np.abs(phi), size).max(axis=0))
    as_shape = np.median(modal_assurance(phi, measured.shape).max(axis=0))
    alike = as_level > 0.95 and as_shape < ALIKE and np.ptp(level) > 10.0
    return "the shapes look like levels in dB; amplitudes with their signs are needed" if alike else ""
