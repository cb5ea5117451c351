"""Test vectors: inputs that move every part of a law, and what the law gives for them."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from middeck.errors import ConfigError
from middeck.realtime.package.package import SAMPLES, ControllerPackage, TestVectors, largest
from middeck.realtime.package.reference import ReferenceLaw

USUAL = 48
UNBOUNDED = 1.0
"""Amplitude at an input without a range."""


def add_test_vectors(package: ControllerPackage, samples: int | None = None) -> ControllerPackage:
    """``package`` with test vectors: what its computer must reproduce to the last bit before it may run.

    Three thirds: noise of a tenth of the range, where most laws stay within their limits; the ends of the
    range, in the signs of a random sequence; and noise of twice the range, which is cut. The ramp is full at
    first, falls in the second third and rises in the last. If ``samples`` is left out there are `USUAL`, or
    so many more that a law of long delays moves all its outputs. Raises `ConfigError` for a law whose outputs
    leave the numbers on the way, and for a number of samples outside 3 to `SAMPLES`.
    """
    if samples is not None:
        return _with_vectors(package, samples)
    latest = max((first for first in _first_moves(package) if first is not None), default=0)
    longer = USUAL * (latest // USUAL + 1)
    made = _with_vectors(package, longer)
    while 2 * longer <= SAMPLES and find_unmoved(made):
        longer *= 2
        made = _with_vectors(package, longer)
    return made


def find_unmoved(package: ControllerPackage) -> tuple[str, ...]:
    """Ports that stand still in the test vectors of ``package``, though the law moves them, and its ramp."""
    stored = package.vectors
    if stored is None:
        return ()
    columns = [(f"input {p.name}", column) for p, column in zip(package.inputs, stored.y.T, strict=True)]
    columns += [
        (f"output {p.name}", column)
        for p, column, first in zip(package.outputs, stored.u.T, _first_moves(package), strict=True)
        if first is not None
    ]
    return tuple(name for name, column in [*columns, ("ramp", stored.engaged)] if (column == column[0]).all())


def _first_moves(package: ControllerPackage) -> list[int | None]:
    """The sample, from 0, at which inputs reach each output first; None for one that they never reach.

    Told by what is not zero; delays of sections, a few samples, are left out.
    """
    core, sample = package.core, 0
    read = np.ones(len(package.inputs), dtype=bool)
    read[[place.input for place in package.filters if not place.section.b.any()]] = False
    fresh = np.asarray(core.D[:, read].any(axis=1))
    fresh[[path.output for path in package.paths if path.section.b.any()]] = True
    first: list[int | None] = [None] * len(fresh)
    reached = np.zeros(len(fresh), dtype=bool)
    known, late = np.zeros(len(core.A), dtype=bool), core.B[:, read].any(axis=1)
    while fresh.any() or late.any():
        for k in np.flatnonzero(fresh):
            first[k] = sample
        reached |= fresh
        late = (late | core.E[:, fresh].any(axis=1)) & ~known
        known |= late
        fresh = core.C[:, late].any(axis=1) & ~reached
        late, sample = core.A[:, late].any(axis=1) & ~known, sample + 1
    return first


def _with_vectors(package: ControllerPackage, samples: int) -> ControllerPackage:
    if not 3 <= samples <= SAMPLES:
        raise ConfigError(f"{samples} test samples", hint=f"3 to {SAMPLES}")
    rng = np.random.default_rng(samples)
    reach = np.where(np.isfinite(package.input_range), package.input_range, UNBOUNDED)
    third = np.arange(samples) * 3 // samples
    noise = rng.uniform(-1.0, 1.0, (samples, len(reach)))
    most = largest(package.single)
    with np.errstate(over="ignore"):  # twice the largest range is no number
        y = np.choose(third[:, None], [0.1 * noise, np.sign(noise), 2.0 * noise]) * reach
        y = np.clip(y, -most, most)
    if package.single:
        y = y.astype(np.float32).astype(float)
    vectors = run_vectors(package, y, third != 1, package.ramp)
    if not np.isfinite(vectors.u).all():
        raise ConfigError("the law gives numbers that are not finite", hint="limits of its outputs")
    return dataclasses.replace(package, vectors=vectors)


def run_vectors(
    package: ControllerPackage,
    y: Float[np.ndarray, "sample input"],
    engaged: Bool[np.ndarray, " sample"],
    start_level: int,
) -> TestVectors:
    """The outputs of the reference for ``y`` from a reset."""
    law = ReferenceLaw(package)
    law.level = start_level
    u = np.empty((len(y), len(package.outputs)))
    for k, (row, rising) in enumerate(zip(y, engaged.tolist(), strict=True)):
        law.engaged = rising
        u[k] = law.step(row)
    return TestVectors(start_level=start_level, engaged=engaged, y=y, u=u)
