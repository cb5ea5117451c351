"""Some of the lines of a response, for inexact steps: no more than its modes need to be drawn.

Every n-th line, or lines in proportion to frequency, as modes of one damping ratio are wide: whichever needs
fewer. Both only as long as straight lines between those kept restore the response: a mode narrower than the
gaps would be lost.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex, Int

from middeck.identification.problem.data import Data
from middeck.identification.spectra.excess_variance import ExcessVariance

# Numbers that are enough for a race, and for each unknown of it.
RACE_NUMBERS = 3000
NUMBERS_PER_UNKNOWN = 10
# Share of the response that interpolation may miss, noise apart: lines a half-power bandwidth apart miss 0.1.
MISSED = 0.1
# Evenly thinned lines that are no more than so many times what is wanted will do.
ENOUGH = 2.0
# The widest gap in proportion to frequency, the half-power bandwidth of 1 % damping, narrowed in such steps.
WIDEST_GAP = 0.02
NARROWER = 0.7


def thin_lines(data: Data, spread: ExcessVariance, unknowns: int = 0) -> Int[np.ndarray, " kept"]:
    """Lines to keep for a race of models of so many unknowns."""
    lines = len(data.s)
    wanted = max(RACE_NUMBERS, NUMBERS_PER_UNKNOWN * unknowns) * lines / data.H.size
    steps = range(int(lines / wanted), 1, -1)
    step = next((n for n in steps if _restores(data, spread, np.arange(0, lines, n))), 1)
    even = np.arange(0, lines, step)
    if len(even) <= ENOUGH * wanted:
        return even
    omega = data.omega
    gap = WIDEST_GAP
    while (kept := _apart(omega, gap)).size < len(even):
        if len(kept) >= wanted and _restores(data, spread, kept):
            return kept
        gap *= NARROWER
    return even


def take_lines(
    data: Data, spread: ExcessVariance, kept: Int[np.ndarray, " kept"]
) -> tuple[Data, ExcessVariance]:
    """Data and spread on some lines."""
    drive = None if data.drive is None else data.drive[kept]
    part = Data(
        s=data.s[kept], H=data.H[:, kept], weight=data.weight[:, kept], drive=drive, transient=data.transient
    )
    chance = spread.chance * float(np.sqrt(data.H.size / max(part.H.size, 1)))
    alike = max(spread.alike * len(part.s) / len(data.s), 1.0)
    return part, dataclasses.replace(
        spread, variance=spread.variance[:, kept], size=spread.size[:, kept], chance=chance, alike=alike
    )


def _apart(omega: np.ndarray, gap: float) -> Int[np.ndarray, " kept"]:
    """The first line of each interval of so much log frequency."""
    return np.unique(np.floor(np.log(omega / omega[0]) / gap), return_index=True)[1]


def _restores(data: Data, spread: ExcessVariance, kept: np.ndarray) -> bool:
    omega = data.omega
    right = np.clip(np.searchsorted(omega[kept], omega, side="right"), 1, len(kept) - 1)
    left, right = kept[right - 1], kept[right]
    share = ((omega - omega[left]) / (omega[right] - omega[left]))[:, None]
    between: Complex[np.ndarray, "output line column"]
    between = data.H[:, left] * (1.0 - share) + data.H[:, right] * share
    # Three noises are in the difference: the line's own and its share of the two it is drawn from.
    noise = spread.variance * (1.0 + (1.0 - share) ** 2 + share**2)
    level = np.mean(np.abs(data.H) ** 2, axis=(1, 2))
    missed = np.mean(np.abs(between - data.H) ** 2 - noise, axis=(1, 2))
    return bool(np.all(missed <= MISSED**2 * level))
