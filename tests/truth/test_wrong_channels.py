"""Channels that read otherwise than the model moves are named, and none is without cause."""

from __future__ import annotations

import dataclasses
import itertools

import forked_case as case
import numpy as np
import pytest

import structure_builders as build
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.article import LoadCase, Member, PointLoad, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.refinement import search
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import refine
from middeck.updating.refinement.wrong_channels import wrong_channels
from middeck.updating.refinement.wrong_readings import wrong_readings
from middeck.updating.residuals.gauges import Gauge
from middeck.updating.residuals.static_tests import StaticTest, set_up_static
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from repeats import LONG, repeats

SHIFTS = [(n, d) for n in "abcd" for d in "xyz"]


def surveyed(seed: int, kept: list[tuple[str, str]] | None = None) -> Survey:
    _, modes, rng = case.drawn(seed)
    survey = case.survey(modes, range(16), rng, shape=0.005)
    return survey if kept is None else case.at_channels_of(survey, kept)


def with_rows(survey: Survey, change) -> Survey:
    """Rows of its shapes changed in place, by channel."""
    measured = survey.measured
    place = {channel: i for i, channel in enumerate(zip(measured.node, measured.direction, strict=True))}
    shape = np.array(measured.shape)
    change(shape, place)
    return dataclasses.replace(survey, measured=dataclasses.replace(measured, shape=shape))


def warned_channels(survey: Survey) -> tuple[str, ...]:
    found = refine(case.fork(), [survey], case.UNKNOWNS, model_error=3e-5)
    warnings = wrong_channels(found.compared[0])
    assert set(warnings) <= set(findings(found))
    return warnings


def turned(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
    shape[place["d", "y"]] *= -1.0


def thrice(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
    shape[place["d", "z"]] *= 3.0


def swapped(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
    shape[[place["c", "x"], place["c", "y"]]] = shape[[place["c", "y"], place["c", "x"]]]


@pytest.mark.parametrize(
    ("change", "what", "kept"),
    repeats(
        [
            (change, what, kept)
            for each in ((None, SHIFTS, None), (SHIFTS, None, SHIFTS))
            for kept, (change, what) in zip(
                each,
                (
                    (turned, ["channel d y reads with the opposite sign"]),
                    (swapped, ["channel c x does not follow", "channel c y does not follow"]),
                    (thrice, ["channel d z reads 3 times"]),
                ),
                strict=True,
            )
        ],
        2,
    ),
)
def test_a_channel_that_is_wrong_is_named(change, what: list[str], kept: list[tuple[str, str]] | None):
    for seed in repeats(range(8)):
        message = sorted(warned_channels(with_rows(surveyed(seed, kept), change)))
        assert len(message) == len(what)
        assert all(expected in line for expected, line in zip(what, message, strict=True))


MIXED = [("c", "x"), ("c", "y"), ("d", "z"), ("a", "x")]


def test_many_that_no_factor_sets_right_are_not_told_as_so_many_instruments():
    """Each reads the next one's motion, as turns of nodes have otherwise on a coarse mesh; one is turned."""

    def mix(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
        rows = [place[channel] for channel in MIXED]
        shape[rows] = shape[rows[1:] + rows[:1]]
        shape[place["b", "y"]] *= -1.0

    for seed in repeats(range(8)):
        alone, many = warned_channels(with_rows(surveyed(seed), mix))
        assert "channel b y reads with the opposite sign" in alone
        named = many.partition("channels ")[2].partition(" do not follow")[0]
        assert set(named.split(", ")) == {f"{n} {d}" for n, d in MIXED}
        assert "elements_per_strut" in many


def test_no_channel_is_named_without_cause():
    """Of right surveys, of few channels, and of another article than the model's, whose shapes all differ."""
    for seed in repeats(range(8)):
        for kept in (None, SHIFTS, SHIFTS[:3], SHIFTS[4:5]):
            assert warned_channels(surveyed(seed, kept)) == ()
    rng = np.random.default_rng(5)

    def all_of_them(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
        shape *= np.exp(0.5 * rng.standard_normal((len(shape), 1)))

    assert warned_channels(with_rows(surveyed(0), all_of_them)) == ()


DEAD = [("d", "z"), ("c", "x")]


@pytest.mark.parametrize(
    ("dead", "kept"),
    repeats([(dead, kept) for dead in (DEAD, DEAD[:1]) for kept in (None, SHIFTS)], 2),
)
@pytest.mark.filterwarnings("error")
def test_a_channel_that_reads_nothing_is_named(dead: list[tuple[str, str]], kept: list | None):
    def cut(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
        shape[[place[channel] for channel in dead]] = 0.0

    for seed in repeats(range(4)):
        message = warned_channels(with_rows(surveyed(seed, kept), cut))
        assert len(message) == len(dead)
        for n, d in dead:
            assert any(f"channel {n} {d} reads nothing" in line for line in message)


FLAT = Section(
    EA=1e6, GJ=400.0, EI_y=50.0, EI_z=540.0, GA_y=1e13, GA_z=1e13, rho_A=0.3, rho_I_y=1e-4, rho_I_z=1e-4
)
ROOT = Environment(title="mast", gravity=np.zeros(3), clamps=(Clamp(node="n0"),))
UP = [(f"n{i}", "z") for i in range(1, 8)]


def mast(EI: float) -> Structure:
    """Clamped at n0, with seven bodies; it bends along z and along y apart."""
    section = dataclasses.replace(FLAT, EI_y=EI)
    light = build.body(0.02, (0, 0, 0), (1e-6, 1e-6, 1e-6))
    nodes = [build.node(f"n{i}", (0.25 * i, 0, 0), light if i else build.NONE) for i in range(8)]
    members = [
        Member(
            name=f"m{i}",
            start=f"n{i}",
            end=f"n{i + 1}",
            section=section,
            elements=2,
            up=np.array([0, 0, 1.0]),
        )
        for i in range(7)
    ]
    return build.structure(nodes, members)


@pytest.mark.parametrize(
    ("others", "stated"),
    [
        ([("n7", "rx")], None),
        ([("n7", "rx"), ("n3", "rx")], None),
        ([("n7", "y"), ("n4", "y")], 2e-3),
        ([("n0", "z")], 1e-3),
    ],
)
def test_a_channel_that_the_modes_do_not_move_is_not_named(others: list, stated: float | None):
    """It reads rounding or noise; beside it one that is turned is named."""
    modes = solve_modes(solve_equilibrium(mast(51.5), ROOT))
    for noise in repeats([1e-8, 1e-2, 0.0, 1e-3], 2):
        seen = measure_modes(modes, [*UP, *others], chosen=[1, 4, 7])
        size = np.abs(seen.shape).max(axis=0)
        shape = seen.shape + noise * size * np.random.default_rng(3).standard_normal(seen.shape.shape)
        std = None if stated is None else stated * size * np.ones(shape.shape)
        for sign, count in ((1.0, 0), (-1.0, 1)):
            turned = np.vstack([shape[:5], sign * shape[5:6], shape[6:]])
            measured = dataclasses.replace(
                seen, shape=turned, shape_std=std, frequency_std_hz=1e-3 * seen.frequency_hz
            )
            survey = Survey(name="s", measured=measured, environment=ROOT)
            found = refine(
                mast(50.0), [survey], [Unknown(name="E", parameters=("member.*.EI_y",), spread=0.1)]
            )
            warnings = wrong_channels(found.compared[0])
            assert len(warnings) == count
            assert all("channel n6 z reads with the opposite sign" in line for line in warnings)


HELD = Environment(
    title="held", gravity=np.array([0.0, 0.0, -9.81]), suspension=None, clamps=(Clamp(node="a"),)
)
BENT = [u for u in case.UNKNOWNS if u.name in ("a-b", "b-c", "b-d", "twist")]
GAUGES = tuple(
    Gauge(name=f"{n}{d}", at=n, direction=way, std=2e-5)
    for n in "bcd"
    for d, way in zip("yz", np.eye(3)[1:], strict=True)
)


def loaded(seed: int, spoilt, ends: str = "cd") -> list[StaticTest]:
    """Readings of a fork with drawn values, each of its ``ends`` under two loads or four; ``spoilt`` changes
    them in place."""
    rng = np.random.default_rng(seed)
    x = np.array([u.spread for u in BENT]) * rng.standard_normal(len(BENT))
    tests = []
    for n, d, size in itertools.product(ends, (1, 2), (0.5, 1.0) if LONG else (1.0,)):
        push = PointLoad(name="push", frame=n, force=size * np.eye(3)[d])
        load = LoadCase(name=f"{n}{'xyz'[d]} {size:g}", loads=(push,))
        value = set_up_static(case.fork(), HELD, (), load, True, BENT).solve(x).value(GAUGES)
        value = value + 2e-5 * rng.standard_normal(len(GAUGES))
        spoilt(load.name, value)
        tests.append(StaticTest(name=load.name, environment=HELD, gauges=GAUGES, value=value, load_case=load))
    return tests


def in_millimetres(_: str, value: np.ndarray) -> None:
    value[3] *= 1000.0


def other_way(_: str, value: np.ndarray) -> None:
    value[2] *= -1.0


def thrice_the_load(name: str, value: np.ndarray) -> None:
    value *= 3.0 if name == "cz 1" else 1.0


@pytest.mark.parametrize(
    ("spoilt", "what", "by", "ends"),
    [
        (in_millimetres, "gauge 'cz' reads", 1000.0, "cd" if LONG else "d"),  # the search finds no end
        (other_way, "gauge 'cy' reads with the opposite sign", None, "cd"),
        (thrice_the_load, "test 'cz 1' reads", 3.0, "cd"),
    ],
)
def test_a_reading_that_is_wrong_is_named(spoilt, what: str, by: float | None, ends: str, monkeypatch):
    """By how much is said to the accuracy of the priors, which others allow."""
    if spoilt is in_millimetres and not LONG:
        monkeypatch.setattr(search, "STEPS", 3)  # as after twelve: far from any end
    for seed in repeats(range(1, 4)):
        found = refine(case.fork(), [], BENT, statics=loaded(seed, spoilt, ends))
        assert found.converged == (spoilt is not in_millimetres)
        (warning,) = wrong_readings(found)
        assert what in warning
        assert warning in findings(found)
        if by is not None:
            assert float(warning.split(" reads ")[1].split()[0]) == pytest.approx(by, rel=0.3)


def test_no_reading_is_named_without_cause():
    for seed in repeats(range(1, 4)):
        assert wrong_readings(refine(case.fork(), [], BENT, statics=loaded(seed, lambda *_: None))) == ()


@pytest.mark.parametrize("at", ["b", "a"])
def test_a_gauge_that_nothing_moves_is_not_named(at: str):
    """Loads along z alone, gauges along y with ten times their noise; or one on the clamp."""
    rng = np.random.default_rng(2)
    gauges = (*(g for g in GAUGES if g.name[1] == "z"), dataclasses.replace(GAUGES[0], at=at, name="still"))
    tests = []
    for n, size in itertools.product("bcd", (0.5, 1.0)):
        push = PointLoad(name="push", frame=n, force=np.array([0.0, 0.0, size]))
        load = LoadCase(name=f"{n} {size:g}", loads=(push,))
        value = (
            set_up_static(case.fork(), HELD, (), load, True, BENT).solve(np.zeros(len(BENT))).value(gauges)
        )
        value[:3] += 2e-5 * rng.standard_normal(3)
        value[3] += 2e-4 * rng.standard_normal()
        tests.append(StaticTest(name=load.name, environment=HELD, gauges=gauges, value=value, load_case=load))
    found = refine(case.fork(), [], BENT, statics=tests)
    assert wrong_readings(found) == ()


def test_a_gauge_that_reads_nothing_is_named():
    def cut(_: str, value: np.ndarray) -> None:
        value[3] = 0.0

    (reported,) = wrong_readings(refine(case.fork(), [], BENT, statics=loaded(1, cut)))
    assert "gauge 'cz' reads nothing" in reported
