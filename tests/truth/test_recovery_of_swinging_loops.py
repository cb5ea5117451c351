"""What is proved beside a hold of articles that swing on springs, against a search for motions that go on."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.gate.package_with_hold import drives_of, with_hold
from middeck.realtime.gate.recovery_proof import why_unproved
from middeck.realtime.package.filter_sections import LoopPath, Section
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw, SectionState
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from packaged_laws import ports
from repeats import repeats

PERIOD_S = 0.02
CHUNK, CHUNKS, STARTS, PUSHED = 1500, 6, 60, 250
"""Samples of a look at motions, looks, motions, and samples for which some are pushed at first."""
GOES_ON = 0.97
"""Of its size 90 s before; springs alone leave 0.7 of it at most."""
KINDS = ("lags", "observer", "unstable", "unlearned", "driven out")


class Path(NamedTuple):
    """A section of the hold: out = b0 in + b1 in/z + b2 in/z^2 - a1 out/z - a2 out/z^2."""

    sensor: int
    motor: int
    b: np.ndarray
    a: np.ndarray


class Loop(NamedTuple):
    """An article x+ = F x + G u, y = C x; a law; a hold; limits of the law's commands and of the sums."""

    article: tuple[np.ndarray, np.ndarray, np.ndarray]
    law: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    hold: list[Path]
    first: np.ndarray
    then: np.ndarray
    continuous: tuple[np.ndarray, np.ndarray, np.ndarray]

    def start(self, x, z):
        """A state of article and law, with the hold's sections at rest."""
        none = np.zeros((len(self.hold), x.shape[1]))
        return x, z, none, none, none, none


def run(loop, state, samples, pushes=None, limited=True):
    """Magnitudes of sensors, of the law's commands and of the sums, sample by sample, and the state left."""
    (F, G, C), (A, B, K, D, E) = loop.article, loop.law
    from_sensors = np.array([path.sensor for path in loop.hold])
    to_motors = np.array([[float(path.motor == i) for path in loop.hold] for i in range(len(K))])
    b0, b1, b2 = (np.array([[path.b[i]] for path in loop.hold]) for i in range(3))
    a1, a2 = (np.array([[path.a[i]] for path in loop.hold]) for i in range(2))
    first, then = (limits[:, None] if limited else np.inf for limits in (loop.first, loop.then))
    x, z, in1, in2, out1, out2 = state
    seen = np.empty((samples, len(C) + 2 * len(K), x.shape[1]))
    for k in range(samples):
        y = C @ x
        read = y[from_sensors]
        out = b0 * read + b1 * in1 + b2 * in2 - a1 * out1 - a2 * out2
        in1, in2, out1, out2 = read, in1, out, out1
        hold, own = to_motors @ out, K @ z + D @ y
        asked = hold + np.minimum(np.maximum(own, -first), first)
        u = np.minimum(np.maximum(asked, -then), then)
        seen[k] = np.concatenate([y, own, asked])
        z = A @ z + B @ y + E @ (u - hold - own)
        x = F @ x + G @ (u if pushes is None else u + pushes[k])
    return np.abs(seen), (x, z, in1, in2, out1, out2)


def radius(loop):
    """Largest magnitude of a root of the loop between its limits: one step of each unit vector."""
    sizes = [len(loop.article[0]), len(loop.law[0]), *[len(loop.hold)] * 4]
    state = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
    _, after = run(loop, state, 1, limited=False)
    return np.abs(np.linalg.eigvals(np.vstack(after))).max()


def draw_article(rng, inputs, outputs):
    """One to three modes on springs."""
    modes = int(rng.integers(1, 4))
    w, d = 2.0 * np.pi * 10.0 ** rng.uniform(-0.2, 0.7, modes), 10.0 ** rng.uniform(-3.0, -1.5, modes)
    A = sla.block_diag(*([[0.0, f], [-f, -2.0 * q * f]] for f, q in zip(w, d, strict=True)))
    B, C = np.zeros((2 * modes, outputs)), np.zeros((inputs, 2 * modes))
    B[1::2], C[:, ::2] = rng.standard_normal((modes, outputs)), rng.standard_normal((inputs, modes))
    return A, B, C


def sample(A, B):
    n, p = B.shape
    both = sla.expm(np.block([[A, B], [np.zeros((p, n + p))]]) * PERIOD_S)
    return both[:n, :n], both[:n, n:]


def draw_hold(rng, inputs, outputs, strength):
    """Gains, lags and differences, of any sign, from any sensor to any motor."""
    paths = []
    for motor in range(outputs):
        g, pole, turn = strength * rng.standard_normal(), rng.uniform(0.2, 0.9), rng.uniform(0.1, 1.0)
        b, a = [
            ([g, 0.0, 0.0], [0.0, 0.0]),
            ([0.0, g, 0.0], [0.0, 0.0]),
            ([g * (1.0 - pole), 0.0, 0.0], [-pole, 0.0]),
            ([3.0 * g, -3.0 * g, 0.0], [-pole, 0.0]),
            ([g * abs(1.0 - pole * np.exp(1j * turn)) ** 2, 0.0, 0.0], [-2.0 * pole * np.cos(turn), pole**2]),
        ][rng.integers(5)]
        paths.append(Path(int(rng.integers(inputs)), motor, np.array(b), np.array(a)))
    return paths


def draw_lags(rng, inputs, outputs):
    r, g = rng.uniform(0.1, 0.99, 3), 10.0 ** rng.uniform(-1.0, 2.5)
    B = rng.standard_normal((3, inputs)) * (1.0 - r)[:, None]
    K, D = g * rng.standard_normal((outputs, 3)), g * rng.standard_normal((outputs, inputs))
    return np.diag(r), B, K, D, np.zeros((3, outputs))


def draw_observer(rng, article, hold, weakest, learns):
    """LQG of any authority, on an article whose frequencies are off, beside the hold's gains at rest."""
    A, B, C = article
    F, G = sample(A * (1.0 + 0.03 * rng.standard_normal()), B)
    for path in hold:
        F = F + np.outer(G[:, path.motor], C[path.sensor]) * path.b.sum() / (1.0 + path.a.sum())
    n, p, m = len(F), B.shape[1], len(C)
    R, N = (10.0 ** rng.uniform(-7.0, weakest) * np.eye(k) for k in (p, m))
    S = sla.solve_discrete_are(F, G, np.eye(n), R)
    T = sla.solve_discrete_are(F.T, C.T, G @ G.T + 1e-8 * np.eye(n), N)
    gain = np.linalg.solve(G.T @ S @ G + R, G.T @ S @ F)
    L = np.linalg.solve(C @ T @ C.T + N, C @ T @ F.T).T
    return F - L @ C - G @ gain, L, -gain, np.zeros((p, m)), G if learns else np.zeros_like(G)


def draw_law(rng, kind, article, hold):
    if kind == "lags":
        return draw_lags(rng, len(article[2]), article[1].shape[1])
    return draw_observer(rng, article, hold, -4.0 if kind == "unstable" else 0.0, kind != "unlearned")


def draw(seed):
    """A loop that is stable between its limits, of the kind ``KINDS[seed % 5]``; sensors reach to one."""
    kind, rng = KINDS[seed % len(KINDS)], np.random.default_rng([47, seed])
    inputs, outputs = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    while True:
        article = draw_article(rng, inputs, outputs)
        strength = 10.0 ** rng.uniform(-1.0, 2.3)
        hold = draw_hold(rng, inputs, outputs, strength)
        try:
            law = draw_law(rng, kind, article, hold)
        except (np.linalg.LinAlgError, ValueError):  # of the Riccati equations
            continue
        still = tuple(np.zeros_like(M) for M in law)
        grows = np.abs(np.linalg.eigvals(law[0])).max() > 1.0 + 1e-6
        F, G = sample(*article[:2])
        reach = law_reach(law, inputs) * 10.0 ** rng.uniform(-2.0, 0.3)
        drive = (reach + strength) * 10.0 ** rng.uniform(-1.5, 0.5)
        spread = 10.0 ** rng.uniform(-0.3, 0.3, (2, outputs))
        loop = Loop((F, G, article[2]), law, hold, reach * spread[0], drive * spread[1], article)
        alone = radius(loop._replace(law=still))
        if radius(loop) > 1.0 - 1e-4 or grows != (kind == "unstable"):
            continue
        if (alone > 1.0) == (kind == "driven out") and abs(alone - 1.0) > 1e-4:
            return loop


def law_reach(law, inputs):
    """The law's largest gain at fifty frequencies."""
    A, B, K, D, _ = law
    z = np.exp(1j * np.geomspace(0.01, 3.0, 50))
    return max(np.linalg.norm(K @ np.linalg.solve(w * np.eye(len(A)) - A, B) + D, 2) for w in z)


def held_package(loop):
    """The package alone, the package beside the hold, its drives, and the article."""
    A, B, K, D, E = loop.law
    y, u = ports(0, len(loop.article[2]), len(K))
    law = SampledStateSpace(A, B, K, D, period_s=PERIOD_S)
    grows = bool(np.abs(np.linalg.eigvals(A)).max() > 1.0)
    package = package_law(
        Compensator(law, y, u, applied=E if E.any() else None), "law",
        input_range=1.0, limit=loop.first, form="dense", unstable=grows,
    )  # fmt: skip
    engine = EngineSettings(
        period_s=PERIOD_S, sensors=tuple(SensorTest(port=port, range=1.0) for port in package.inputs),
        drives=tuple(Drive(port=p, lower=-d, upper=d) for p, d in zip(u, loop.then, strict=True)),
        hold=tuple(LoopPath(one.sensor, one.motor, Section(one.b, one.a)) for one in loop.hold),
    )  # fmt: skip
    held = with_hold(package, engine)
    dynamics = StateSpace(*loop.continuous, np.zeros((len(y), len(u))))
    return package, held, drives_of(held, engine), Plant(dynamics=dynamics, inputs=u, outputs=y)


class Watched(NamedTuple):
    """Of motions from ``begun``: which go on, peaks of sensors at the end and ever, samples at some limit."""

    begun: tuple[np.ndarray, ...]
    on: np.ndarray
    tail: np.ndarray
    most: np.ndarray
    limited: np.ndarray


def draw_starts(rng, loop):
    """Article, law and both struck, or pushed for 5 s by square waves about the article's frequencies."""
    (F, G, _), count, third = loop.article, len(loop.law[0]), np.arange(STARTS) % 3
    x, z = (
        rng.standard_normal((n, STARTS)) * 10.0 ** rng.uniform(-2.0, 3.0, STARTS) for n in (len(F), count)
    )
    modes = rng.choice(np.abs(np.angle(np.linalg.eigvals(F))), STARTS)
    waves = np.sign(np.sin(np.arange(PUSHED)[:, None] * modes * 10.0 ** rng.normal(0.0, 0.05, STARTS)))
    sizes = 10.0 ** rng.uniform(-1.0, 3.0, STARTS) * rng.standard_normal((G.shape[1], STARTS))
    pushes = waves[:, None] * sizes * loop.then[:, None] * (third == 2)
    return run(loop, loop.start(x * (third < 2), z * (third == 1)), PUSHED, pushes)[1]


def watch(loop, begun, chunks=CHUNKS):
    """A motion goes on where limits act to the end, and it has not become smaller meanwhile."""
    sensors, limits = len(loop.article[2]), np.concatenate([loop.first, loop.then])[:, None]
    state, peaks, limited, half = begun, [], 0.0, chunks // 2 - 1
    for k in range(chunks):
        seen, state = run(loop, state, CHUNK)
        peaks.append(seen[:, :sensors].max(axis=0))
        acts = (seen[:, sensors:] > limits).any(axis=1)
        limited = np.where(acts.any(axis=0), (k + 1) * CHUNK - np.argmax(acts[::-1], axis=0), limited)
    early, late = (np.max(some, axis=0) for some in (peaks[1 : 1 + half], peaks[-half:]))
    size = late.max(axis=0)
    on = acts.any(axis=0) & np.isfinite(size) & (size > GOES_ON * early.max(axis=0))
    return Watched(begun, on, late, np.max(peaks, axis=0), limited)


def breed(rng, watched):
    """Starts near those whose limits act for longest while all sensors stay within ranges of one."""
    score = np.where(watched.most.max(axis=0) < 1.0, watched.limited, -watched.most.max(axis=0))
    parents = rng.choice(np.argsort(-score)[:10], STARTS)
    least = np.minimum(1.0, 1.0 / watched.most.max(axis=0)[parents])
    sizes = np.where(np.isfinite(least), least, 0.0) * 10.0 ** rng.normal(0.0, 0.1, STARTS)
    chosen = (M[:, parents] * sizes for M in watched.begun)
    return tuple(M * (1.0 + 0.2 * rng.standard_normal(M.shape)) for M in chosen)


def search(loop, seed, rounds):
    """Motions that are watched: from random starts, then from starts that are bred."""
    rng = np.random.default_rng([48, seed])
    found = [watch(loop, draw_starts(rng, loop))]
    for _ in range(rounds):
        found.append(watch(loop, breed(rng, found[-1])))
    return found


def least_that_goes_on(found):
    """Its peaks of the sensors and its start."""
    sizes = [np.where(one.on, one.tail.max(axis=0), np.inf) for one in found]
    round_, k = np.unravel_index(np.argmin(sizes), np.shape(sizes))
    one = found[round_]
    assert one.on[k]
    return one.tail[:, k], tuple(M[:, [k]] for M in one.begun)


def edge(loop, begun):
    """Peaks of the motion between those that die out and one that goes on, as far as digits tell them apart.

    It goes on too. None where no start on the way to ``begun`` dies out, or one that parts too soon.
    """
    low, high = 1e-4, 1.0
    for _ in range(7):
        sizes = np.geomspace(low, high, 40)
        watched = watch(loop, tuple(M * sizes for M in begun), 4)
        k = int(np.argmax(watched.on))
        if not (watched.on[k] and k):
            return None
        low, high = sizes[k - 1], sizes[k]
    seen, _ = run(loop, tuple(M * np.array([low, high]) for M in begun), 4 * CHUNK)
    reads = seen[:, : len(loop.article[2])]
    parted = np.abs(reads[:, :, 1] - reads[:, :, 0]).max(axis=1) > 1e-3 * reads.max()
    end = int(np.argmax(parted))
    return reads[end // 2 : end, :, 0].max(axis=0) if end > 1000 else None


def reason(loop, reach):
    """Why it is not proved where the sensors reach so far; empty where it is."""
    _, held, drives, plant = held_package(loop)
    held = dataclasses.replace(held, input_range=np.broadcast_to(reach, len(held.inputs)), vectors=None)
    return why_unproved(held, plant, drives=drives, required=True)


PROVED = [0, 1, 2, 3, 5, 6, 7, 8, 11, 12, 13, 15, 16, 18, 20, 21, 22, 23, 25, 26, 28, 30, 34, 35, 38]
"""With sensors that reach to one, of the first forty loops; all forty reach one to four limits there."""

SWINGING_ON = [
    14, 310, 174, 91, 168, 300, 37, 87, 112, 132, 157, 271, 277, 4, 9, 39, 49, 54, 59, 64,
    69, 84, 109, 114, 124, 149, 154, 164, 169, 179, 184, 189, 199, 209, 214, 224, 244, 269, 279, 284,
]  # fmt: skip
"""Forty of some fifty that are found up to seed 330."""
BETWEEN = [54, 91, 168, 271, 39, 84]


@pytest.mark.parametrize("seed", repeats(SWINGING_ON))
def test_no_loop_in_which_a_motion_goes_on_is_proved(seed):
    """With the sensors' ranges no larger than the least motion that is found to go on, of 120."""
    loop = draw(seed)
    peaks, _ = least_that_goes_on(search(loop, seed, 1))
    assert reason(loop, 1.001 * peaks)


@pytest.mark.parametrize("seed", repeats(BETWEEN))
def test_none_is_proved_at_the_motion_between_those_that_die_out_and_those_that_go_on(seed):
    """Which is smaller than the one that is found to go on, by 3 to 60 times."""
    loop = draw(seed)
    going, begun = least_that_goes_on(search(loop, seed, 0))
    peaks = edge(loop, begun)
    assert peaks is not None
    assert np.all(peaks < 0.5 * going)
    assert reason(loop, 1.001 * peaks)


@pytest.mark.parametrize(("seed", "rounds"), repeats([(2, 1), *((s, 4) for s in range(40))]))
def test_of_forty_loops_none_that_is_proved_has_a_motion_that_goes_on(seed, rounds):
    """Within the ranges, of 60 random starts and of 60 a round that are bred to keep limits acting."""
    loop = draw(seed)
    proved = reason(loop, 1.0) == ""
    assert proved or seed not in PROVED
    if proved:
        found = search(loop, seed, rounds)
        assert not any(np.any(one.on & np.all(one.tail <= 1.0, axis=0)) for one in found)


@pytest.mark.parametrize("seed", repeats(range(40), 3))
def test_what_is_simulated_is_what_package_and_engine_compute(seed):
    """Sensors and commands of 300 samples, with limits, what the law learns, and the hold's sections."""
    loop, rng = draw(seed), np.random.default_rng([49, seed])
    package, *_ = held_package(loop)
    F, G, C = loop.article
    x = rng.standard_normal((len(F), 1)) * 300.0
    package = dataclasses.replace(package, input_range=np.full(len(C), 1e9), vectors=None)
    seen, _ = run(loop, loop.start(x, np.zeros((len(loop.law[0]), 1))), 300)
    law, sections = ReferenceLaw(package), [SectionState(Section(path.b, path.a)) for path in loop.hold]
    x, again = x[:, 0], []
    for _ in range(300):
        y = C @ x
        hold = np.zeros(len(loop.then))
        for path, section in zip(loop.hold, sections, strict=True):
            hold[path.motor] += section.step(y[path.sensor])
        asked = hold + law.compute(y)
        again.append([*y, *law.wanted, *asked])
        u = np.clip(asked, -loop.then, loop.then)
        law.commit(u - hold)
        x = F @ x + G @ u
    assert seen[:, :, 0] == pytest.approx(np.abs(again), rel=1e-6, abs=1e-9)
    assert np.any(seen[:, len(C) :, 0] > np.concatenate([loop.first, loop.then]))
