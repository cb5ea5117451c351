"""Margins as a table of text, in dB, degrees, Hz and ms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.control.analysis.margins import LoopMargins, Margins

HEAD = ("broken at", "gain dB", "at Hz", "phase deg", "at Hz", "delay ms", "disk", "max |S|", "at Hz")


def margins_table(margins: Margins) -> str:
    """One row a loop: gain, phase and delay margins with their frequencies, disk margin and peak of S.

    The row of an unstable loop gives its fastest-growing root. ``-``: no limit. ``?``: a delay margin that
    was not computed (`LoopMargins`).

    >>> from middeck.control.analysis import measure_margins
    >>> from middeck.control.law.compensator import Compensator
    >>> from middeck.systems.plants.plant import Plant
    >>> from middeck.signals.ports import Port
    >>> from middeck.systems.state_space.statespace import StateSpace, gain_system
    >>> force, way = Port("force", "N"), Port("way", "m")
    >>> integrator = Plant(dynamics=StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), inputs=(force,),
    ...     outputs=(way,))
    >>> law = Compensator(gain_system(np.array([[-2.0]])), (way,), (force,))
    >>> print(margins_table(measure_margins(integrator, law)))
    broken at  gain dB  at Hz  phase deg  at Hz   delay ms  disk   max |S|  at Hz
    force      -        -      90.0       0.3183  785       2.000  1.000    954.9
    """
    if not margins.stable:
        root = margins.stability
        return f"unstable: a root at {root.frequency_hz:.4g} Hz grows by {-root.margin:.3g} 1/s"
    return align_columns([HEAD, *(_cells(loop) for loop in margins.loops)])


def align_columns(rows: Sequence[Sequence[str]]) -> str:
    """The cells of ``rows`` as lines of text with columns aligned at the left."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def _cells(loop: LoopMargins) -> tuple[str, ...]:
    gain = np.argmin(np.abs(np.log(loop.gain))) if len(loop.gain) else None
    phase = np.argmin(np.abs(loop.phase_rad)) if len(loop.phase_rad) else None
    return (
        loop.channel,
        "-" if gain is None else f"{20.0 * np.log10(loop.gain[gain]):+.1f}",
        "-" if gain is None else f"{loop.gain_hz[gain]:.4g}",
        "-" if phase is None else f"{np.degrees(abs(loop.phase_rad[phase])):.1f}",
        "-" if phase is None else f"{loop.phase_hz[phase]:.4g}",
        "?" if loop.delay_s is None else "-" if not len(loop.delay_s) else f"{1e3 * loop.delay_limit_s:.3g}",
        f"{loop.disk.alpha:.3f}",
        f"{loop.sensitivity.gain:.3f}",
        f"{loop.sensitivity.frequency_hz:.4g}",
    )
