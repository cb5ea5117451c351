"""Pairs, verdicts and the probability that a correct model would pass."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import scipy.special as ssp
from test_correlation import CANTILEVER, clamped

import middeck as md
from cli_runner import ROOT
from coarse_articles import coarse
from middeck.structure.correlation.correlate import Correlation, correlate_modes
from middeck.structure.correlation.effective_mass import measure_effective_mass
from middeck.structure.correlation.evaluation import nearby_pairs
from middeck.structure.correlation.measured_modes import (
    MeasuredModes,
    MeasurementNoise,
    measure_modes,
    sensor_rows,
)
from middeck.structure.correlation.pass_probability import Probability
from middeck.structure.correlation.reduction import Reduction
from middeck.structure.correlation.review_criteria import (
    PROFILES,
    RECALLED,
    Criterion,
    Profile,
    Quantity,
    Scope,
    find_profile,
)
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.residuals.pairing import pair
from repeats import LONG, repeats
from structure_builders import straight_beam

ARTICLE, LAB = coarse("mace-simple"), ROOT / "environments/lab.toml"
GIMBALS = [(joint, "angle") for joint in ("pri_x", "pri_z", "sec_x", "sec_z")]
TRANSLATIONS = [(f"n{i}", d) for i in range(1, 6) for d in "xyz"] + GIMBALS
WITH_ROLL = [(f"n{i}", d) for i in range(1, 6) for d in ("x", "y", "z", "rx")] + GIMBALS
FLEXIBLE = range(10, 18)
PERFECT = MeasurementNoise(0.0, 0.0)
ORION = find_profile("orion-adequate")
RUNS = 2000 if LONG else 400  # in whose deviations chances are judged


def solved(*overrides: str) -> Modes:
    return md.solve_modes(md.solve_equilibrium(*md.load_setup(ARTICLE, LAB, overrides)))


@pytest.fixture(scope="module")
def lab() -> Modes:
    return solved()


def one(quantity: Quantity, limit: float, group: Scope = Scope.ALL) -> Profile:
    return Profile(
        "one",
        "one",
        (Criterion(quantity=quantity, group=group, limit=limit, source="this test", recalled=False),),
    )


def correlate(modes: Modes, measured: MeasuredModes, profile: Profile = ORION, **options) -> Correlation:
    """With a fixed seed and few runs unless asked otherwise."""
    settings = {"noise": PERFECT, "runs": 5, "rng": np.random.default_rng(3)} | options
    return correlate_modes(modes, measured, profile, **settings)


# A test of the model itself


def test_a_model_is_its_own_perfect_test(lab: Modes):
    found = correlate(lab, measure_modes(lab, TRANSLATIONS, chosen=FLEXIBLE))
    assert found.pairs.tolist() == [[10 + j, j] for j in range(8)]
    assert np.all(found.evaluation.frequency_error == 0.0)
    # SEREP inverts the sights of the sensors: rounding times the square of a condition of 15.
    assert found.evaluation.cross_orthogonality == pytest.approx(np.eye(8), abs=1e-11)
    assert found.evaluation.self_orthogonality == pytest.approx(np.eye(8), abs=1e-11)
    assert found.evaluation.comac == pytest.approx(1.0, abs=1e-12)
    assert found.passed
    assert found.probability == Probability(5, 5)
    assert found.warnings == ()


def test_order_scale_and_phase_of_the_test_do_not_matter(lab: Modes):
    plain = measure_modes(lab, TRANSLATIONS, chosen=FLEXIBLE)
    order = np.array([5, 2, 7, 0, 1, 6, 3, 4])
    turned = 1e3 * np.exp(1j * np.arange(8.0))
    mixed = dataclasses.replace(
        plain, frequency_hz=plain.frequency_hz[order], shape=plain.shape[:, order] * turned
    )
    found, straight = correlate(lab, mixed), correlate(lab, plain)
    assert found.pairs.tolist() == [[10 + m, j] for j, m in enumerate(order)]
    cross = np.empty((8, 8))
    cross[np.ix_(order, order)] = found.evaluation.cross_orthogonality
    assert cross == pytest.approx(straight.evaluation.cross_orthogonality, abs=1e-11)
    assert found.phase_collinearity == pytest.approx(1.0, abs=1e-12)


def test_two_meshes_of_one_article_are_compared_at_common_nodes(lab: Modes):
    """4 and 8 elements a strut: frequencies differ by the error of the coarser mesh, shapes by no more."""
    coarse = solved("mesh.elements_per_strut=4")
    found = correlate(coarse, measure_modes(lab, chosen=FLEXIBLE))
    # Bernoulli elements: (omega h^2 / c)^2 / 720 is below 1e-5 for the highest of these modes.
    assert np.all(np.abs(found.evaluation.frequency_error) < 1e-5)
    assert np.any(found.evaluation.frequency_error != 0.0)
    assert np.diag(found.evaluation.cross_orthogonality) == pytest.approx(1.0, abs=1e-6)
    assert found.passed


def test_stiffer_material_is_a_frequency_error_and_nothing_else():
    """In orbit all stiffness is the material's: frequencies grow as its root, shapes stay."""
    articles = [md.load_setup(ARTICLE, LAB, o)[0] for o in ([], ["material.lexan.E_pa=2.59e9"])]
    ours, true = (solve_modes(solve_equilibrium(a, Environment.orbit())) for a in articles)
    found = correlate(ours, measure_modes(true, TRANSLATIONS, chosen=FLEXIBLE), find_profile("nasa-std-5002"))
    expected = math.sqrt(2.35 / 2.59) - 1.0
    # Rounding of the stiffness, which spans 1e8, on the lowest of these modes.
    assert found.evaluation.frequency_error == pytest.approx(expected, abs=1e-8)
    assert found.evaluation.cross_orthogonality == pytest.approx(np.eye(8), abs=1e-6)
    assert found.passed
    error = [f for f in found.findings if f.criterion.quantity is Quantity.FREQUENCY_ERROR]
    assert [f.worst for f in error] == [pytest.approx(-expected, abs=1e-8)]
    assert not correlate(ours, found.measured, one(Quantity.FREQUENCY_ERROR, 0.04)).passed


def test_modes_without_a_partner_are_named_and_spoil_the_verdict(lab: Modes):
    measured = measure_modes(lab, TRANSLATIONS, chosen=[10, 12, 13])
    found = correlate(lab, measured)
    assert found.unmeasured == (11,)
    assert any("mode 11 'first bending x-z'" in w and "not measured" in w for w in found.warnings)
    alone = dataclasses.replace(measured, frequency_hz=measured.frequency_hz * [1.0, 1.0, 1e9])
    spoilt = correlate(lab, alone, one(Quantity.FREQUENCY_ERROR, 0.5))
    assert spoilt.unpaired == (2,)
    assert all(f.passed for f in spoilt.findings)
    assert not spoilt.passed
    assert any("has no partner" in w for w in spoilt.warnings)


def test_alike_shapes_octaves_apart_are_no_pair():
    """One channel sees every shape alike; the frequencies keep them apart."""
    pairs = nearby_pairs(np.ones((2, 2)), np.array([1.0, 5.0]), np.array([5.2, 1.1]))
    assert pairs.tolist() == [[1, 0], [0, 1]]


def test_a_channel_that_nothing_moves_has_no_comac():
    """A beam that bends across x: what sensors along x read is noise, and the model is correct."""
    held = Environment.clamped("a", gravity=0.0)
    modes = solve_modes(solve_equilibrium(straight_beam(CANTILEVER, 2.0, 4), held))
    at = [(f"a-b/{i}", d) for i in (1, 2, 3) for d in "xz"]
    noise = MeasurementNoise(0.001, 0.02)
    test = measure_modes(modes, at, chosen=[0, 1, 2], noise=noise, rng=np.random.default_rng(5))
    judging = one(Quantity.COMAC, 0.99)
    found = correlate(modes, test, judging, noise=None, runs=50)
    assert found.evaluation.at_rest.tolist() == [True, False] * 3
    assert found.findings[0].items == tuple(f"a-b/{i} z" for i in (1, 2, 3))
    assert found.passed
    assert found.probability.value == 1.0
    for k, size in ((0, 0.2), (1, 0.0)):  # a motion that the test has alone, and one that it lacks
        shape = np.array(test.shape)
        shape[k] = size * np.abs(shape).max(axis=0)
        wrong = correlate(modes, dataclasses.replace(test, shape=shape), judging, noise=None)
        assert wrong.evaluation.at_rest.tolist() == [k > 0, False, *[True, False] * 2]
        assert not wrong.passed


# Profiles


def test_a_mode_that_no_sensor_sees_resembles_none():
    """The torsion of a straight beam moves no point of its axis: its MAC is zero."""
    soft = dataclasses.replace(CANTILEVER, GJ=1e-4)
    held = Environment.clamped("a", gravity=0.0)
    beam = solve_modes(solve_equilibrium(straight_beam(soft, 2.0, 12), held), 12)
    channels = [(f"a-b/{i}", d) for i in (2, 5, 9, 11) for d in "xyz"]
    bent = [i for i, name in enumerate(beam.name) if "bending" in name][:3]
    turned = [i for i, name in enumerate(beam.name[: bent[-1]]) if "torsion" in name]
    noise = MeasurementNoise(0.001, 0.02)
    test = measure_modes(beam, channels, chosen=bent, noise=noise, rng=np.random.default_rng(4))
    found = correlate_modes(beam, test, ORION, rng=np.random.default_rng(5), runs=20)
    unseen = np.isin(found.candidates, turned)
    assert unseen.any()
    assert not found.evaluation.mac[unseen].any()
    assert found.evaluation.mac[~unseen].max(axis=0) == pytest.approx(1.0, abs=0.01)
    assert not set(turned) & set(found.pairs[:, 0].tolist())
    rounding = np.asarray(sensor_rows(beam, *zip(*channels, strict=True)) @ beam.shapes)[:, turned]
    alike = dataclasses.replace(
        test,
        frequency_hz=beam.frequency_hz[turned],
        damping=np.full(len(turned), 0.001),
        shape=rounding / np.abs(rounding).max(axis=0),
        frequency_std_hz=None,
        damping_std=None,
        shape_std=None,
    )
    assert not set(turned) & set(pair(beam, alike)[:, 0].tolist())


def test_groups_are_the_fundamental_the_massive_and_the_others():
    """A cantilever's bendings: 61, 19, 6 and 3 % of the mass, 38, 19, 11 and 7 % of the inertia."""
    modes = clamped(straight_beam(CANTILEVER, 2.0, 8))
    fraction = measure_effective_mass(modes).fraction
    bending = [int(i) for i in np.flatnonzero(fraction[:, 2] > 0.02)[:4]]
    measured = measure_modes(modes, [(f"a-b/{k}", "z") for k in range(1, 8)], chosen=bending)
    found = correlate(modes, measured, find_profile("ecss-e-st-32-11c"))
    groups = {
        f.criterion.group: [measured_index(found, n) for n in f.items]
        for f in found.findings
        if f.criterion.quantity is Quantity.FREQUENCY_ERROR
    }
    assert groups == {Scope.FUNDAMENTAL: [0], Scope.SIGNIFICANT: [1, 2], Scope.OTHER: [3]}


def measured_index(found: Correlation, name: str) -> int:
    index = found.modes.name.index(name)
    return int(found.pairs[found.pairs[:, 0] == index, 1][0])


def test_recalled_limits_say_so_and_seen_ones_do_not(lab: Modes):
    """The table of users-and-reviews: three documents whose numbers were not read, three that were."""
    recalled = {p.name for p in PROFILES if all(c.status == RECALLED for c in p.criteria)}
    seen = {p.name for p in PROFILES if not p.recalled}
    assert recalled == {"ecss-e-st-32-11c", "nasa-std-5002", "smc-s-004"}
    assert seen == {"orion-well", "orion-adequate", "coppolino"}
    assert all(c.source for p in PROFILES for c in p.criteria)
    measured = measure_modes(lab, TRANSLATIONS, chosen=FLEXIBLE)
    for profile in PROFILES:
        message = any(RECALLED in w for w in correlate(lab, measured, profile, runs=1).warnings)
        assert message == profile.recalled


# How often a correct model passes


def within(probability: Probability, expected: float) -> bool:
    """Four standard deviations of a binomial count: a chance of 6e-5 with the fixed seed."""
    deviation = math.sqrt(expected * (1.0 - expected) / probability.runs)
    return abs(probability.value - expected) < 4.0 * deviation


@pytest.mark.parametrize(
    ("noise", "modes"), repeats([(0.02, 4), (0.04, 1), (0.02, 1), (0.04, 4), (0.005, 1), (0.005, 4)], 2)
)
def test_probability_of_one_frequency_criterion_in_closed_form(lab: Modes, noise: float, modes: int):
    """f_test = f (1 + s n), n standard normal: |f / f_test - 1| <= L is 1/(1+L) <= 1 + s n <= 1/(1-L)."""
    limit = 0.03

    def below(edge: float) -> float:
        return 0.5 * (1.0 + math.erf((edge - 1.0) / (noise * math.sqrt(2.0))))

    expected = (below(1.0 / (1.0 - limit)) - below(1.0 / (1.0 + limit))) ** modes
    measured = measure_modes(lab, TRANSLATIONS, chosen=[10, 12, 13, 16][:modes])
    profile = one(Quantity.FREQUENCY_ERROR, limit)
    found = correlate(lab, measured, profile, noise=MeasurementNoise(noise, 0.0), runs=RUNS)
    assert within(found.probability, expected)
    assert found.findings[0].probability == found.probability


def test_probability_of_one_mac_criterion_in_closed_form(lab: Modes):
    """Two channels of one sort: the noise turns the shape (1, 1) by an angle of normal tangents."""
    limit, noise = 0.999, 0.03
    measured = measure_modes(lab, [("n2", "y"), ("n4", "y")], chosen=[10])
    a = np.real(measured.shape[:, 0])
    found = correlate(lab, measured, one(Quantity.MAC, limit), noise=MeasurementNoise(0.0, noise), runs=RUNS)
    # Along and across the shape, in units of its length, which is sqrt(2) times its rms.
    s = noise / math.sqrt(2.0)
    along = 1.0 + s * np.linspace(-8.0, 8.0, 4001)
    edge = along * math.sqrt(1.0 / limit - 1.0)
    density = np.exp(-0.5 * ((along - 1.0) / s) ** 2) / (s * math.sqrt(2.0 * math.pi))
    expected = float(np.trapezoid(density * ssp.erf(edge / (s * math.sqrt(2.0))), along))
    assert 0.5 < expected < 0.99
    assert a.shape == (2,)
    assert within(found.probability, expected)


def test_noise_is_relative_to_the_shape_whatever_its_scale(lab: Modes):
    """A test in other units of modal mass, with its standard deviations, is the same test."""
    rng = np.random.default_rng(5)
    measured = measure_modes(lab, WITH_ROLL, chosen=FLEXIBLE, noise=MeasurementNoise(1e-3, 0.03), rng=rng)
    assert measured.shape_std is not None
    scaled = dataclasses.replace(measured, shape=1e3 * measured.shape, shape_std=1e3 * measured.shape_std)
    ends = [correlate(lab, m, noise=None, runs=200) for m in (measured, scaled)]
    assert 0.5 < ends[0].probability.value < 1.0
    assert ends[0].probability == ends[1].probability


def test_complex_shapes_have_noise_in_both_parts(lab: Modes):
    """Of the same size together: half the variance in phase, so that a correct model passes more often."""
    measured = measure_modes(lab, WITH_ROLL, chosen=FLEXIBLE)
    turned = dataclasses.replace(measured, shape=measured.shape * np.exp(0.3j))
    noise = MeasurementNoise(0.0, 0.05)
    real, other = (correlate(lab, m, noise=noise, runs=300).findings[0] for m in (measured, turned))
    assert real.expected is not None
    assert other.expected is not None
    # The median of the largest of 28 terms, real or complex, of equal variance: 2.3 and 1.9 deviations.
    assert 0.7 < other.expected[1] / real.expected[1] < 1.0


def test_same_seed_same_answer(lab: Modes):
    measured = measure_modes(lab, WITH_ROLL, chosen=FLEXIBLE)
    noise = MeasurementNoise(0.001, 0.05)
    first, second = (correlate(lab, measured, noise=noise, runs=50) for _ in range(2))
    assert first.probability == second.probability
    assert first.findings == second.findings


@pytest.mark.parametrize(("passed", "runs"), [(0, 50), (1, 50), (37, 50), (50, 50)])
def test_the_interval_holds_what_the_count_does_not_contradict(passed: int, runs: int):
    """Clopper and Pearson: at either end the count, or one as extreme, has a chance of 2.5 %."""
    low, high = Probability(passed, runs).interval
    if passed:
        assert 1.0 - ssp.bdtr(passed - 1, runs, low) == pytest.approx(0.025, rel=1e-9)
    if passed < runs:
        assert ssp.bdtr(passed, runs, high) == pytest.approx(0.025, rel=1e-9)
    assert low <= passed / runs <= high


# What Bergman, Allen, Kammer and Mayes found


def test_guyan_orthogonality_fails_true_shapes_with_little_noise(lab: Modes):
    """Rotations that are not measured have inertia: no noise is small enough for the static mass."""
    measured = measure_modes(lab, TRANSLATIONS, chosen=FLEXIBLE)
    chance = {
        r: correlate(lab, measured, noise=MeasurementNoise(0.0, 0.01), reduction=r, runs=300).probability
        for r in Reduction
    }
    assert chance[Reduction.GUYAN].interval[1] < 0.02
    assert chance[Reduction.IRS].interval[1] < 0.02
    assert chance[Reduction.SEREP].interval[0] > 0.98


def test_irs_passes_true_shapes_without_noise_and_fails_them_with_little(lab: Modes):
    """Sensitivity alone: 2 % of noise, and the same true shapes pass by their own modes' mass."""
    measured = measure_modes(lab, WITH_ROLL, chosen=FLEXIBLE)

    def chance(reduction: Reduction, noise: float) -> tuple[float, float]:
        noisy = MeasurementNoise(0.0, noise)
        return correlate(lab, measured, noise=noisy, reduction=reduction, runs=300).probability.interval

    assert chance(Reduction.IRS, 0.0)[0] > 0.98
    assert chance(Reduction.IRS, 0.02)[1] < 0.5
    assert chance(Reduction.IRS, 0.05)[1] < 0.02
    assert chance(Reduction.SEREP, 0.02)[0] > 0.95


def test_measured_with_noise_passes_as_often_as_predicted(lab: Modes):
    """The prediction from one test holds for other tests of the same article with their own noise."""
    noise, draws = MeasurementNoise(0.001, 0.05), 100 if LONG else 50
    first = measure_modes(lab, WITH_ROLL, chosen=FLEXIBLE, noise=noise, rng=np.random.default_rng(0))
    predicted = correlate(lab, first, noise=None, runs=1000 if LONG else 400).probability
    rng = np.random.default_rng(1)
    passed = sum(
        correlate(
            lab, measure_modes(lab, WITH_ROLL, chosen=FLEXIBLE, noise=noise, rng=rng), noise=None, runs=1
        ).passed
        for _ in range(draws)
    )
    # The first test's own scatter changes by 5 % what its noise is relative to: a tenth of the probability.
    low, high = Probability(passed, draws).interval
    assert low - 0.1 < predicted.value < high + 0.1
    assert 0.1 < predicted.value < 0.9
