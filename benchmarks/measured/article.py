"""`simple` in 0-g with its PD loops closed: 5 torques to 14 angles and rates.

26 modes less 3 translations. Orthogonal multisines of equal amplitude on 0.1-60 Hz in 5 experiments of 3
periods of 16384 samples at 256 Hz, 1 % white noise at each output, as in the case `mimo` of the gimbal.
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from measured.rows import row
from middeck import estimate_response, fit_response, model_response
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.files.studies.documents import load_study
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.study.chapters.zero_g_control.computation import control_plant
from middeck.systems.plants.plant import subsystem

STUDY = Path(__file__).resolve().parents[2] / "studies" / "mace-1993.toml"
SAMPLES, SAMPLE_HZ, PERIODS = 16384, 256.0, 3
BAND_HZ = (0.1, 60.0)
SCORED_HZ = np.geomspace(*BAND_HZ, 4000)
NOISE = 0.01


@dataclasses.dataclass(frozen=True)
class Truth:
    """Pairs of poles [rad/s] with their output vectors (output, pair) and input vectors (pair, input)."""

    poles: np.ndarray
    c: np.ndarray
    b: np.ndarray
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    def response(self, hz: np.ndarray) -> np.ndarray:
        """Sum of c b / (s - pole) and conjugates, (line, output, input)."""
        s = 2j * np.pi * hz[:, None, None]
        ends = ((self.c, self.b, self.poles), (self.c.conj(), self.b.conj(), self.poles.conj()))
        return sum((c / (s - p)) @ b for c, b, p in ends)


def truth() -> Truth:
    """From the structure of the study's file, to the ports that Figure 7's controllers use."""
    study = load_study(STUDY)
    control = study.control
    modes = solve_modes(solve_equilibrium(*study.case("simple", "orbit")))
    gains = np.array(control.pd_kp_nm_per_rad), np.array(control.pd_kd_nms_per_rad)
    plant = close_inner_loop(control_plant(modes, study), PDLoops(control.pd_loops, *gains))
    system = subsystem(plant, control.inputs, plant.y)
    poles, shapes = scipy.linalg.eig(system.A)
    rows = np.linalg.solve(shapes, system.B)
    upper = np.flatnonzero(poles.imag > 0.0)
    upper = upper[np.argsort(np.abs(poles[upper]))]
    inputs = tuple(plant.inputs[i] for i in plant.input_indices(control.inputs))
    outputs = tuple(plant.outputs[i] for i in plant.output_indices(plant.y))
    return Truth(poles[upper], (system.C @ shapes)[:, upper], rows[upper], inputs, outputs)


def _lines() -> tuple[np.ndarray, np.ndarray]:
    f = np.fft.rfftfreq(SAMPLES, 1.0 / SAMPLE_HZ)
    return f, (f >= BAND_HZ[0]) & (f <= BAND_HZ[1])


def record(article: Truth, seed: int) -> Record:
    """One test."""
    rng = np.random.default_rng(seed)
    f, on = _lines()
    n = len(article.inputs)
    turn = np.exp(2j * np.pi * np.outer(np.arange(n), np.arange(n)) / n)
    U = np.zeros((n, len(f), n), dtype=complex)
    U[:, on] = np.exp(2j * np.pi * rng.random((on.sum(), n))) * turn[:, None, :]
    Y = np.zeros((n, len(f), len(article.outputs)), dtype=complex)
    Y[:, on] = np.einsum("koi,eki->eko", article.response(f[on]), U[:, on])
    u, y = (np.fft.irfft(X, n=SAMPLES, axis=1) for X in (U, Y))
    u, y = (np.repeat(x[:, None] / u.std(), PERIODS, axis=1) for x in (u, y))
    y = y + NOISE * np.sqrt(np.mean(y**2, axis=(0, 1, 2))) * rng.standard_normal(y.shape)
    return Record(
        sample_hz=SAMPLE_HZ, u=u, y=y, inputs=article.inputs, outputs=article.outputs, periodic=True
    )


def error_bound(article: Truth) -> float:
    """Root mean square of the relative complex error that poles, vectors and nothing else must have.

    Of the 38 real unknowns of a pair, 28 are its output vector: those are eliminated output by output.
    """
    f, on = _lines()
    n = len(article.inputs)
    size = np.sqrt(np.mean(np.abs(article.response(f[on])) ** 2, axis=0).sum(axis=1))
    # Every experiment has |U| = A on all lines: H = Y U^-1 is scattered by sigma / (A sqrt(n periods)). With
    # rms one of an input, its lines' count K: A^2 = N^2 / (2 K); an output's rms^2 is the mean over lines of
    # sum_i |H_oi|^2, and white noise of rms r has N r^2 on each line.
    per_line = NOISE**2 * size**2 * 2.0 * on.sum() / (SAMPLES * n * PERIODS)
    blocks = [_slopes(article, f[on], o) / np.sqrt(per_line[o]) for o in range(len(size))]
    shared = blocks[0].shape[0] - 2 * len(article.poles)
    information = np.zeros((shared, shared))
    factors: list[tuple[np.ndarray, np.ndarray]] = []
    for rows in blocks:
        G = 2.0 * rows @ rows.T
        own = _inverse(G[shared:, shared:])
        information += G[:shared, :shared] - G[:shared, shared:] @ own @ G[shared:, :shared]
        factors.append((own, own @ G[shared:, :shared]))
    common = _inverse(information)
    spread = 0.0
    for o, (own, lead) in enumerate(factors):
        rows = _slopes(article, SCORED_HZ, o)
        S = rows @ rows.T
        spread += float(np.sum(S[:shared, :shared] * common))
        spread -= 2.0 * float(np.sum(S[:shared, shared:] * (common @ lead.T)))
        spread += float(np.sum(S[shared:, shared:] * (own + lead @ common @ lead.T)))
    return float(np.sqrt(spread / np.sum(np.abs(article.response(SCORED_HZ)) ** 2)))


def _slopes(article: Truth, hz: np.ndarray, output: int) -> np.ndarray:
    """Real and imaginary part of the slopes of one output: poles, input vectors (all but the largest entry),
    then its own output vector."""
    s = 2j * np.pi * hz
    rows: list[np.ndarray] = []
    own: list[np.ndarray] = []
    for p, c, b in zip(article.poles, article.c[output], article.b, strict=True):
        up, low = 1.0 / (s - p), 1.0 / (s - p.conj())
        first, second = np.multiply.outer(c * up**2, b), np.multiply.outer(c.conj() * low**2, b.conj())
        rows += [first + second, 1j * (first - second)]
        for i in np.delete(np.arange(len(b)), np.argmax(np.abs(b))):
            column = np.zeros((2, len(s), len(b)), dtype=complex)
            column[:, :, i] = c * up + c.conj() * low, 1j * (c * up - c.conj() * low)
            rows += list(column)
        first, second = np.multiply.outer(up, b), np.multiply.outer(low, b.conj())
        own += [first + second, 1j * (first - second)]
    return np.ascontiguousarray(np.array(rows + own)).reshape(len(rows) + len(own), -1).view(float)


def _inverse(G: np.ndarray) -> np.ndarray:
    size = 1.0 / np.sqrt(np.diag(G))
    return size[:, None] * np.linalg.pinv(G * size[:, None] * size, rcond=1e-13, hermitian=True) * size


def rows(seeds: int = 3) -> list[dict[str, Any]]:
    """Order chosen by the program, then by hand."""
    article = truth()
    bound = error_bound(article)
    G = article.response(SCORED_HZ)
    found: list[dict[str, Any]] = []
    for case, states in (("article", None), ("article, order by hand", 2 * len(article.poles))):
        errors, seconds, orders = [], [], []
        for seed in range(seeds):
            measured = estimate_response(record(article, seed))
            begun = time.process_time()
            model = fit_response(measured, states=states, constants="complex", delay=False).model
            seconds.append(time.process_time() - begun)
            E = model_response(model, SCORED_HZ)
            errors.append(np.sqrt(np.sum(np.abs(E - G) ** 2) / np.sum(np.abs(G) ** 2)))
            orders.append(model.states)
        note = f"1.3 times the bound {bound:.3g}; 5 inputs, 14 outputs, 46 states in truth; orders {orders}"
        found += [
            row(case, f"relative complex error, worst of {seeds} seeds", "", max(errors), 1.3 * bound,
                states=max(orders), note=note),
            row(case, "time of the fit", "CPU s", float(np.mean(seconds)), states=max(orders)),
        ]  # fmt: skip
    return found
