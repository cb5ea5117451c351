"""Channels that stand still, or repeat others, tell a refinement no more than the others do."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

import structure_builders as build
from middeck.errors import ConfigError
from middeck.structure.correlation.measured_modes import MeasurementNoise, measure_modes
from middeck.structure.model.article import Member, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.links import Link
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from repeats import repeats

PLACE = Environment(title="stand", gravity=np.array([0.0, -9.80665, 0.0]), clamps=(Clamp(node="foot"),))
UNKNOWNS = (
    Unknown(name="modulus", parameters=("members.E",), spread=0.1),
    Unknown(name="top", parameters=("node.top.mass",), spread=0.1),
)
TOP, FOOT, TWIN = ([(n, d) for d in ("x", "y", "z")] for n in ("top", "foot", "twin"))


def mast(stiff: float = 1.0, heavy: float = 1.0) -> Structure:
    """A body on a tube, at whose place a massless twin is bolted to it; bending in its planes 4 % apart."""
    section = Section(
        EA=1e5, GJ=40.0 * stiff, EI_y=50.0 * stiff, EI_z=54.0 * stiff, GA_y=1e13, GA_z=1e13,
        rho_A=0.3, rho_I_y=0.0, rho_I_z=0.0,
    )  # fmt: skip
    top = build.body(0.4 * heavy, (0.0, 0.0, 0.0), (0.02, 0.011, 0.012))
    up = np.array([0.0, 0.0, 1.0])
    return dataclasses.replace(
        build.structure(
            [build.node("foot", (0, 0, 0)), build.node("top", (0, 1, 0), top), build.node("twin", (0, 1, 0))],
            [Member(name="mast", start="foot", end="top", section=section, elements=4, up=up)],
        ),
        links=(Link(name="bolts", first="top", second="twin"),),
    )


def refined(
    channels: list[tuple[str, str]], count: int, repeated: float = 1.0, still: float = 1.0
) -> Refined:
    """On the ``count`` lowest modes of a stiffer, heavier mast; shapes ``repeated`` times as uncertain.

    What stands still has ``still`` times the deviation of the others.
    """
    modes = solve_modes(solve_equilibrium(mast(1.06, 1.04), PLACE))
    noise = MeasurementNoise(1e-4, 0.01)
    read = measure_modes(modes, TOP, chosen=range(count), noise=noise, rng=np.random.default_rng(2))
    row = [next((i for i, (_, d) in enumerate(TOP) if n != "foot" and d == e), -1) for n, e in channels]
    spread = np.full(count, 0.01) * np.abs(read.shape).max(axis=0)
    there = np.array(row)[:, None] >= 0
    measured = dataclasses.replace(
        read,
        node=tuple(n for n, _ in channels),
        direction=tuple(d for _, d in channels),
        shape=np.where(there, read.shape[row], 0.0),
        shape_std=repeated * np.where(there, 1.0, still) * spread,
        position_m=None,
    )
    return refine(mast(), [Survey(name="stand", measured=measured, environment=PLACE)], UNKNOWNS)


@functools.cache
def of_the_top(count: int) -> Refined:
    return refined(TOP, count)


@pytest.mark.parametrize("count", repeats([5, 2, 4]))
@pytest.mark.parametrize(("more", "repeated"), [(FOOT, 1.0), (TWIN, np.sqrt(2.0))])
def test_channels_that_say_nothing_new_change_nothing(
    count: int, more: list[tuple[str, str]], repeated: float
):
    """Three at a clamped foot read zero; three at a twin of deviations root two larger repeat the reading."""
    alone, with_more = of_the_top(count), refined([*TOP, *more], count, repeated)
    np.testing.assert_allclose(with_more.x, alone.x, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(with_more.estimate.x_std, alone.estimate.x_std, rtol=1e-6)
    np.testing.assert_allclose(alone.x, np.log([1.06, 1.04]), atol=4.0 * alone.estimate.x_std.max())


def test_a_channel_without_a_deviation_leaves_the_others_theirs():
    """A deviation in parts of the reading is zero where it is zero: 0.01 and not the usual 0.05 elsewhere."""
    stated, without = (refined([*TOP, *FOOT], 4, still=still) for still in (1.0, 0.0))
    np.testing.assert_allclose(without.compared[0].std, stated.compared[0].std, rtol=1e-6)
    np.testing.assert_allclose(without.estimate.x_std, stated.estimate.x_std, rtol=1e-6)


def test_a_frequency_without_a_deviation_is_named():
    survey = refined(TOP, 2).compared[0].survey
    hz = survey.measured.frequency_hz
    measured = dataclasses.replace(survey.measured, frequency_std_hz=np.array([1e-3, 0.0]))
    with pytest.raises(ConfigError, match=f"{hz[1]:.6g} Hz"):
        _ = dataclasses.replace(survey, measured=measured).std
    stated = dataclasses.replace(survey, measured=measured, frequency_std=0.002)
    assert stated.std == pytest.approx([1e-3 / hz[0], 0.002])
