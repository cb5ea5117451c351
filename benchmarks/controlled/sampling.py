"""The paper's single loop at 100 to 1000 Hz: direct designs beside emulated ones and beside dlqr, dlqe."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from measured.rows import cell, peer, row
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.compare_sampling import SamplingRow, compare_sampling
from middeck.control.sampled.held_plant import hold_plant
from middeck.control.sampled.sampled_design import design_sampled_lqg, sample_cost
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.modal_system import ModalSystem

CASE = "sampling"
RATES_HZ, AUTHORITY, MATCH_HZ, REPEATS = (100.0, 250.0, 500.0, 1000.0), 100.0, 5.0, 9
UNIT = 2.0 * np.pi * 3.0  # the multi-model case counts time in units of 1/(2 pi 3 Hz)


def rows(options: Any) -> list[dict]:
    plant, weights = _plant(), _weights()
    compared = compare_sampling(plant, weights, AUTHORITY, RATES_HZ, match_hz=MATCH_HZ)
    made: list[dict] = []
    for rate in RATES_HZ:
        at = [r for r in compared.rows if r.rate_hz == rate]
        made += [_described(r, compared.open_metric) for r in at if r.outcome.stable]
        emulated = [r.outcome for r in at if not r.method.startswith("direct")]
        made.append(row(CASE, f"{rate:g} Hz: unstable emulations of {len(emulated)}", "laws",
                        sum(not o.stable for o in emulated)))  # fmt: skip
        best = min((o.cost for o in emulated if o.stable), default=np.inf)
        made.append(row(CASE, f"{rate:g} Hz: cost of direct over best emulation", "ratio",
                        at[0].outcome.cost / best, 1.0))  # fmt: skip
    return made + _beside_peers(options, plant, weights)


def _described(r: SamplingRow, reference: float) -> dict:
    assert r.margins is not None
    loop, outcome = r.margins.loops[0], r.outcome
    note = (
        f"cost {outcome.cost:.4f}, control rms {outcome.control_rms[0]:.3f}, gain {loop.gain_db:.2f} dB, "
        f"phase {np.degrees(loop.phase_limit_rad):.1f} deg, disk {loop.disk.alpha:.3f}"
    )
    db = 20.0 * np.log10(outcome.metric / reference)
    return row(CASE, f"{r.rate_hz:g} Hz: {r.method}", "dB", db, states=len(r.law.system.A), note=note)


def _beside_peers(options: Any, plant: Plant, weights: LQGWeights) -> list[dict]:
    made: list[dict] = []
    name = "python-control, slycot"
    for rate in (100.0, 1000.0):
        period = 1.0 / rate
        times = []
        for _ in range(REPEATS):
            start = time.process_time()
            law = design_sampled_lqg(plant, weights, AUTHORITY, period)
            times.append(time.process_time() - start)
        seconds = float(np.median(times))
        n = len(law.system.A)
        difference = abs(measure_sampled_loop(plant, law, weights, AUTHORITY).cost / law.cost - 1.0)
        residual = max(law.regulator.residual, law.estimator.residual)
        made += [
            row(CASE, f"{rate:g} Hz: design from the continuous problem", "CPU s", seconds, states=n),
            row(CASE, f"{rate:g} Hz: Riccati residual", "relative", residual, 1e-10),
            row(CASE, f"{rate:g} Hz: cost against the loop's covariance", "relative", difference, 1e-10),
        ]
        held = hold_plant(plant, weights, period)
        price = sample_cost(held, weights, AUTHORITY)
        found = peer(
            options.peer_python, "control_sampling.py", A=held.system.A, B=held.system.B, C=held.system.C,
            Q=price.Q, R=price.R, S=price.S, noise=held.noise, sensor=np.diag(held.sensor), repeats=REPEATS,
        )  # fmt: skip
        if found is None:
            continue
        made[-3]["peers"] = cell(name, found, found["seconds_slycot"])
        made[-3]["note"] = "the peers' time is dlqr and dlqe alone, of the problem that ours has sampled"
        made[-2]["peers"] = cell(name, found, found["residual_slycot"]) | cell(
            "python-control, scipy", found, found["residual_scipy"]
        )
        errors = [np.abs(mine - found[f"{k}_scipy"]).max() / np.abs(mine).max()
                  for k, mine in (("K", law.regulator.gain), ("L", law.estimator.gain.T))]  # fmt: skip
        made.append(row(CASE, f"{rate:g} Hz: gains against dlqr and dlqe", "relative", max(errors), 1e-8))
    return made


def _plant() -> Plant:
    """Five modes, torque to angle, 10 ms late."""
    omega = 2.0 * np.pi * np.array([1.1, 1.7, 7.0, 8.8, 9.4])
    phi = UNIT**2 * np.array([[1.0, 0.6, 0.6, 0.8, 0.7]])
    modal = ModalSystem(
        omega=omega,
        zeta=np.full(5, 0.01),
        psi=np.ones((5, 1)),
        phi=phi,
        phi_rate=np.zeros((1, 5)),
        names=tuple(f"mode {k}" for k in range(5)),
    )
    ports = (Port("torque", "N m"),), (Port("angle", "rad"),)
    return delay_plant(
        Plant(
            dynamics=modal,
            inputs=ports[0],
            outputs=ports[1],
            w=("torque",),
            u=("torque",),
            z=("angle",),
            y=("angle",),
        ),
        0.010,
    )


def _weights() -> LQGWeights:
    return LQGWeights(
        output=[1.0], input=[1.0], disturbed=("torque",), process=[[1.0 / UNIT]], sensor=[1e-6 / UNIT]
    )
