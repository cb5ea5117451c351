"""What is proved of limits that come and go: inequalities, sum, bounds; of what swings on nothing."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as sla
from scipy.signal import fftconvolve
from test_gate import lead, negative_pair, one_port

from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.gate import limited_loop, multipliers, reached_limits
from middeck.realtime.gate.package_with_hold import with_drives
from middeck.realtime.gate.recovery_proof import why_unproved
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.single_precision import to_single
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from packaged_laws import ports
from repeats import repeats

STARTS, SLOW_S = 12, 0.01


def drawn(seed, outputs):
    """Lags and gains on modes or lags, stable without limits: package, plant and its sampled matrices."""
    rng, p = np.random.default_rng([15, seed]), outputs
    y, u = ports(0, p, p)
    while True:
        w, d = 2.0 * np.pi * 10.0 ** rng.uniform(-0.3, 1.0, 2), 10.0 ** rng.uniform(-2.5, -1.3, 2)
        A = sla.block_diag(*([[0.0, f], [-f, -2.0 * q * f]] for f, q in zip(w, d, strict=True)))
        B, C = np.zeros((4, p)), np.zeros((p, 4))
        B[1::2], C[:, ::2] = rng.standard_normal((2, p)) * np.sqrt(w)[:, None], rng.standard_normal((p, 2))
        if rng.random() < 0.3:
            A, B, C = -np.diag(10.0 ** rng.uniform(-1.0, 1.0, 4)), 3.0 * rng.standard_normal((4, p)), B.T
        r, g = rng.uniform(0.1, 0.99, 3), 10.0 ** rng.uniform(-2.0, 1.5)
        law = SampledStateSpace(
            np.diag(r), rng.standard_normal((3, p)) * (1.0 - r)[:, None], g * rng.standard_normal((p, 3)),
            g * rng.standard_normal((p, p)), period_s=SLOW_S,
        )  # fmt: skip
        both = sla.expm(np.block([[A, B], [np.zeros((p, 4 + p))]]) * SLOW_S)
        F, G = both[:4, :4], both[:4, 4:]
        loop = np.block([[F + G @ law.D @ C, G @ law.C], [law.B @ C, law.A]])
        if np.abs(np.linalg.eigvals(loop)).max() < 1.0 - 1e-3:
            package = package_law(
                Compensator(law, y, u), "law", input_range=1.0, limit=10.0 ** rng.uniform(-1.5, 0.3, p),
                slew_rate=10.0 ** rng.uniform(-1.0, 2.0, p), form="dense",
            )  # fmt: skip
            return (
                package,
                Plant(dynamics=StateSpace(A, B, C, np.zeros((p, p))), inputs=u, outputs=y),
                (F, G, C),
            )


def run(package, matrices, x, samples):
    """Magnitudes of sensors, of what is asked and of its steps, by slew and size in the order of the C."""
    (F, G, C), law, s, L = matrices, package.core, package.slew[:, None], package.upper[:, None]
    z, u = np.zeros((len(law.A), x.shape[1])), np.zeros((len(C), x.shape[1]))
    seen = np.empty((3, samples, *u.shape))
    for k in range(samples):
        y = C @ x
        asked = law.C @ z + law.D @ y
        seen[:, k] = y, asked, asked - u
        u = np.clip(np.clip(asked, u - s, u + s), -L, L)
        z, x = law.A @ z + law.B @ y + law.E @ (u - asked), F @ x + G @ u
    return np.abs(seen)


def swings(package, matrices, seed):
    """Peaks of sensors, of what is asked and of its steps in the least motion that goes on for 45 s after 30.

    None where none does. Without the law all motions lose a third and more in that time.
    """
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((len(matrices[0]), STARTS)) * 10.0 ** rng.uniform(-2.0, 2.0, STARTS)
    seen = run(package, matrices, x, 9000)
    first, last = seen[0, 3000:4500].max(axis=(0, 1)), seen[0, 7500:].max(axis=(0, 1))
    on = np.flatnonzero((last > 0.95 * first) & (last > 1e-6) & np.isfinite(last))
    return seen[:, 3000:, :, on[np.argmin(last[on])]].max(axis=1) if len(on) else None


FOUND = [(7, 1), (9, 2), (15, 2), (40, 2), (55, 2), (59, 2)]
SWINGING = FOUND + [(s, p) for s in range(200) for p in (1, 2)]


@pytest.mark.parametrize(("seed", "outputs"), repeats(SWINGING, 4))
def test_no_law_that_swings_on_is_proved_harmless(seed, outputs):
    """With the sensors' range no larger than the motion that goes on."""
    package, plant, matrices = drawn(seed, outputs)
    found = swings(package, matrices, seed)
    assert found is not None or (seed, outputs) not in FOUND
    if found is not None:
        reached = dataclasses.replace(package, input_range=1.001 * found[0], vectors=None)
        assert why_unproved(reached, plant)


def test_one_motor_of_two_that_swings_on_while_the_other_is_weak():
    plant, law = negative_pair()
    assert why_unproved(package_law(law, "law", input_range=100.0, limit=[1.0, 1e-3]), plant)


@pytest.mark.parametrize(("reach", "proved"), [(1.0, False), (0.02, True)])
def test_the_range_of_the_sensor_decides(reach, proved):
    """A lead limited in slew swings on from far away (`test_gate`), where its sensor reaches so far."""
    w = 4.0 * np.pi
    system = StateSpace([[0.0, w], [-w, -0.004 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    package = package_law(lead(0.5, 3.0, 60.0), "law", input_range=reach, limit=1.0, slew_rate=5.0)
    assert (why_unproved(package, one_port(system)) == "") == proved


def edge(package, matrices, start):
    """Peaks, as those of `swings`, of the motion between those that die out and those that go on.

    It goes on too, as long as the digits last: until two that start beside it part.
    """
    low, high = 1e-2, 1e3
    for _ in range(10):
        sizes = np.geomspace(low, high, 16)
        seen = run(package, matrices, start[:, None] * sizes, 2500)
        first, last = seen[0, 500:1000].max(axis=(0, 1)), seen[0, -500:].max(axis=(0, 1))
        k = int(np.argmax(last > 0.6 * first))
        low, high = sizes[k - 1], sizes[k]
    parted = np.abs(seen[0, :, :, k] - seen[0, :, :, k - 1]).max(axis=1) > 1e-3 * seen[0, :, :, k].max()
    end = int(np.argmax(parted))
    assert end > 1000
    return seen[:, end // 2 : end, :, k - 1].max(axis=1)


@pytest.mark.parametrize(("seed", "outputs", "start", "least"), repeats([(7, 1, 0, 0.4), (9, 2, 3, 0.6)]))
def test_the_proof_ends_below_the_smallest_motion_that_goes_on_and_not_far_from_it(
    seed, outputs, start, least
):
    """By what is asked and its steps: none at those of that motion, one at this share of them.

    Starts differ in the motion that goes on between them: that of the smallest steps, of four, is taken.
    """
    package, plant, matrices = drawn(seed, outputs)
    loop = limited_loop.close_loop(limited_loop.split_loop(package, plant))
    _, asked, steps = edge(package, matrices, np.random.default_rng(start).standard_normal(len(matrices[0])))

    def proved(share):
        bounds = ((package.upper, asked, False), (package.slew, steps, True))
        limits = [
            reached_limits.Limit(i, slew, 1.0 - limit / (share * most))
            for limits, peaks, slew in bounds
            for i, (limit, most) in enumerate(zip(limits, peaks, strict=True))
            if share * most > limit
        ]
        assert limits
        return multipliers.dies_out(loop, limits)

    assert not proved(1.0)
    assert proved(least)


def alone(parts):
    """A law whose plant is not known: sensors may read anything within their ranges."""
    count = len(parts.C)
    return parts._replace(A=np.zeros((0, 0)), B=np.zeros((0, len(parts.K))), C=np.zeros((count, 0)))


@pytest.mark.parametrize(("seed", "outputs"), repeats(FOUND, 2))
def test_no_motion_asks_for_more_than_its_bound(seed, outputs):
    """Nor for a tenth of it, of what swings on within ranges of its own.

    A known plant makes none larger, as the bound without it is one of those of which the least is taken, and
    some smaller: an output on which what a sensor's jump does is all there is keeps its bound.
    """
    package, plant, matrices = drawn(seed, outputs)
    parts = limited_loop.split_loop(package, plant)
    reads, asked, _ = swings(package, matrices, seed)
    reached = dataclasses.replace(package, input_range=reads, vectors=None)
    bound = reached_limits.bound_commands(reached, parts)
    assert np.all((asked <= bound) & (bound < 10.0 * asked))
    jumping = reached_limits.bound_commands(reached, alone(parts))
    # Sums of so many terms, none negative, may be of another order, in each settling.
    summed = reached_limits.SETTLINGS * 2 * outputs * np.finfo(float).eps
    assert np.all(bound <= jumping * (1.0 + summed))
    assert np.any(bound < 0.99 * jumping)


def test_limits_of_law_and_engine_are_the_tighter_ones():
    """One after the other, as the engine has them, about the last output."""
    package, _, _ = drawn(2, 2)
    y, u = package.inputs, package.outputs
    drives = tuple(
        Drive(port=port, lower=-size, upper=size, slew_rate=rate)
        for port, size, rate in zip(u, (0.1, 5.0), (500.0, 3.0), strict=True)
    )
    sensors = tuple(SensorTest(port=port, range=1.0) for port in y)
    engine = EngineSettings(period_s=SLOW_S, sensors=sensors, drives=drives)
    package = dataclasses.replace(
        package,
        upper=np.array([0.3, 0.2]),
        lower=-np.array([0.3, 0.2]),
        slew=np.array([0.2, 0.1]),
        vectors=None,
    )
    both, motors = with_drives(package, engine), np.array([[0.1, 5.0], [5.0, 0.03]])
    assert (both.upper.tolist(), both.slew.tolist()) == ([0.1, 0.2], [0.2, 0.03])
    law, one, rng = ReferenceLaw(package), ReferenceLaw(both), np.random.default_rng(2)
    last = np.zeros(2)
    for reading in 3.0 * rng.standard_normal((400, 2)):
        last = np.clip(
            np.clip(law.compute(reading), last - motors[1], last + motors[1]), -motors[0], motors[0]
        )
        law.commit(last)
        assert np.array_equal(one.step(reading), last)


def held_back(package, seed):
    """Of a law on random inputs within its ranges: asked, applied, n and m, sample by sample."""
    rng, law = np.random.default_rng(seed), ReferenceLaw(package)
    y = np.cumsum(rng.standard_normal((600, len(package.inputs))), axis=0)
    y *= np.sin(np.arange(600) / 7.0)[:, None] / np.abs(y).max(axis=0)
    u, asked = np.array([(law.step(one), law.wanted) for one in y]).swapaxes(0, 1)
    by_size = np.abs(u) == package.upper
    return asked, u, np.where(by_size, asked - u, 0.0), np.where(by_size, 0.0, asked - u)


@pytest.mark.parametrize("seed", range(3))
def test_each_inequality_holds_of_what_the_law_does(seed):
    """Within last bits: of the package's own sequence, with random kernels either way in time."""
    package, plant, _ = drawn(seed, 2)
    package = dataclasses.replace(package, upper=package.upper / 9, lower=package.lower / 9, vectors=None)
    asked, u, n, m = held_back(package, seed)
    before = np.vstack([np.zeros((1, 2)), u[:-1]])
    assert not np.any(n * m)
    kernel = np.random.default_rng(seed).standard_normal(41)
    kernel /= np.abs(kernel).sum()
    for held, moved in ((n, u), (m, u - before)):
        others = np.array([np.convolve(one, kernel, mode="same") for one in moved.T]).T
        assert np.all(held * (moved - others) >= -1e-12)
    parts = alone(limited_loop.split_loop(package, plant))
    for limit in reached_limits.reached_limits(package, reached_limits.bound_commands(package, parts)):
        i = limit.output
        held, by = (m, asked - before) if limit.slew else (n, asked)
        assert np.all(held[:, i] * (limit.sector * by[:, i] - held[:, i]) >= -1e-12)


@pytest.mark.parametrize("outputs", [1, 2])
def test_the_sum_is_that_of_the_motions(outputs):
    """By Parseval: in time, of the loop that is simulated with what is held back, and over frequencies."""
    package, plant, (F, G, C) = drawn(2, outputs)
    loop, law = limited_loop.close_loop(limited_loop.split_loop(package, plant)), package.core
    limits = [reached_limits.Limit(i, slew, 0.7 - 0.1 * i) for slew in (False, True) for i in range(outputs)]
    rng, count = np.random.default_rng(outputs), 1 << 14
    forces = np.zeros((count, len(limits)))
    forces[:30] = rng.standard_normal((30, len(limits)))
    x, z, asked = np.zeros(len(F)), np.zeros(len(law.A)), np.zeros((count, outputs))
    held = forces[:, :outputs] + forces[:, outputs:]
    for k in range(count):
        y = C @ x
        asked[k] = law.D @ y + law.C @ z
        u = asked[k] - held[k]
        x, z = F @ x + G @ u, law.A @ z + law.B @ y + law.E @ (u - asked[k])
    u = asked - held
    before = np.vstack([np.zeros((1, outputs)), u[:-1]])
    weights = rng.uniform(0.0, 1.0, (len(limits), 64))
    weights[:, [1 + 15 * k + 6 + j for k in range(4) for j in range(6, 9)]] = (
        0.0  # longer than what is summed
    )
    lags, decays = multipliers.DELAYS, multipliers.DECAYS
    taps = np.arange(1, count)
    h = [np.eye(1, count, n)[0] for n in lags] + [np.append(0.0, (1.0 - a) * a ** (taps - 1)) for a in decays]
    total = 0.0
    for limit, x_i, f in zip(limits, weights, forces.T, strict=True):
        moved = u[:, limit.output] - limit.slew * before[:, limit.output]
        by = asked[:, limit.output] - limit.slew * before[:, limit.output]
        # sum of f (h * moved), one way in time and the other
        late = [f @ fftconvolve(k, moved)[:count] for k in h]
        early = [fftconvolve(k, f)[:count] @ moved for k in h]
        both, own = np.array([*early, *late]), f @ moved
        total += x_i[0] * own + x_i[1:31] @ (own - both) + x_i[31:61] @ (own + both)
        total += x_i[61] * f @ (limit.sector * by - f)
        partner = [
            o for j, o in enumerate(forces.T) if limits[j] != limit and limits[j].output == limit.output
        ]
        total += (x_i[62] - x_i[63]) * f @ partner[0]
    omega = 2.0 * np.pi * np.arange(count) / count
    seen = np.fft.fft(forces, axis=0)
    form = multipliers.form_sum(loop, limits, omega).sum(weights)
    found = 0.5 * np.real(np.einsum("zi,zij,zj->", seen.conj(), form, seen)) / count
    assert found == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize("outputs", [1, 2])
def test_the_second_derivative_stays_within_its_bound(outputs):
    """Against differences of the sum, about the poles and away from them."""
    package, plant, _ = drawn(5, outputs)
    loop, rng = limited_loop.close_loop(limited_loop.split_loop(package, plant)), np.random.default_rng(5)
    limits = [reached_limits.Limit(i, slew, 0.7) for slew in (False, True) for i in range(outputs)]
    x = rng.uniform(0.0, 1.0, (len(limits), 64)) * (rng.random((len(limits), 64)) < 0.2)
    poles = np.angle(loop.poles[np.abs(loop.poles) > 0.9])
    middle = np.concatenate(
        [rng.uniform(0.0, 3.0, 100), *(abs(p) + 0.01 * rng.standard_normal(100) for p in poles)]
    )
    low = np.clip(middle, 1e-3, 3.0)
    high = low + 10.0 ** rng.uniform(-6.0, -2.0, len(low))
    _, bound = multipliers.bound_sum(loop, limits, x, low, high)
    at, h = low + rng.uniform(0.0, 1.0, len(low)) * (high - low), 1e-5
    before, here, after = (multipliers.form_sum(loop, limits, at + d).sum(x) for d in (-h, 0.0, h))
    found = np.linalg.norm((before - 2.0 * here + after) / h**2, ord=2, axis=(1, 2))
    assert np.all(found <= 1.01 * bound + 4e-13 * np.linalg.norm(here, axis=(1, 2)) / h**2 * 1e-2)
    assert np.max(found / bound) > 0.1


def exact_solve(M, b):
    """By Gauss in fractions."""
    rows = [[Fraction(v) for v in row] + [Fraction(c)] for row, c in zip(M, b, strict=True)]
    for k in range(len(rows)):
        pivot = next(i for i in range(k, len(rows)) if rows[i][k])
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(len(rows)):
            if i != k and rows[i][k]:
                part = rows[i][k] / rows[k][k]
                rows[i] = [v - part * w for v, w in zip(rows[i], rows[k], strict=True)]
    return [row[-1] / row[k] for k, row in enumerate(rows)]


@pytest.mark.parametrize("apart", [1e-1, 1e-4, 1e-6])
def test_rounding_moves_the_loop_by_less_than_its_bound(apart):
    """Against fractions, where modes nearly coincide and next to a pole: both limits held back by one."""
    poles = np.array([0.999, 0.999 - apart, 0.9 - apart])
    A, rng = np.diag(poles) + np.triu(np.full((3, 3), 0.7), 1), np.random.default_rng(3)
    F, G, E, K = np.array([[0.5]]), np.zeros((1, 1)), rng.standard_normal((1, 1)), rng.standard_normal((1, 1))
    B, C, D = rng.standard_normal((3, 1)), rng.standard_normal((1, 3)), np.zeros((1, 1))
    parts = limited_loop.Parts(A, B, C, F, G, E, K, D, np.zeros((1, 1)), (K, D))
    loop = limited_loop.close_loop(parts)
    closed = np.block([[A, B @ K], [np.zeros((1, 3)), F]])
    for t in (1e-4, 1e-2, 1.0):  # z = (1 - t^2 + 2 j t) / (1 + t^2), which fractions hold
        one = Fraction(t)
        re, im = (1 - one * one) / (1 + one * one), 2 * one / (1 + one * one)
        n, x = len(closed), []
        M = [[Fraction(0)] * (2 * n) for _ in range(2 * n)]
        for i in range(n):
            for j in range(n):
                value = (re if i == j else 0) - Fraction(float(closed[i, j]))
                M[i][j], M[n + i][n + j] = value, value
            M[i][n + i], M[n + i][i] = -im, im
        x = exact_solve(M, [*(-v for v in (*B[:, 0], E[0, 0])), *[0.0] * n])
        out = [Fraction(0)] * 3 + [Fraction(float(K[0, 0]))]
        true = [sum(c * v for c, v in zip(out, x[k : k + n], strict=True)) for k in (0, n)]
        z = complex(float(re), float(im))
        found = complex((loop.residues[:, 0, 0] / (z - loop.poles)).sum())
        error = max(abs(Fraction(found.real) - true[0]), abs(Fraction(found.imag) - true[1]))
        assert float(error) <= limited_loop.bound_error(loop, np.abs(z - loop.poles)[None])[0]


def test_in_single_precision_nothing_is_proved_to_die_out():
    w = 4.0 * np.pi
    light = one_port(StateSpace([[0.0, w], [-w, -0.004 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]))
    law = package_law(lead(0.5, 3.0, 60.0), "law", input_range=1.0, limit=0.5)
    assert not why_unproved(law, light)
    assert "single precision" in why_unproved(to_single(law), light)
