"""Twenty-five authorities on two plants of 60 states under PD: designs, stability and rms in a band."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from measured.rows import cell, peer, row
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.loop.authority import AuthoritySweep, sweep_authority
from middeck.control.loop.performance import Performance
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, subsystem
from middeck.systems.state_space.modal_system import ModalSystem

CASE = "sweep"
LEVELS = 10.0 ** np.linspace(-1.5, 4.5, 25)
BAND_HZ, POINTS, REPEATS = (0.1, 60.0), 2000, 5
RIGID, FLEXIBLE, INPUTS = 7, 23, 5
INTENSITY = 1e-6


def rows(options: Any) -> list[dict]:
    plants = {"orbit": _plant(0.0), "lab": _plant(0.01)}
    times, sweep = [], None
    for _ in range(REPEATS):
        start = time.process_time()
        sweep = _sweep(plants)
        times.append(time.process_time() - start)
    assert sweep is not None
    seconds = float(np.median(times))
    made = [row(CASE, "25 levels on two plants", "CPU s", seconds, states=60)]
    given: dict[str, Any] = {f"{name}_{k}": v for name, p in plants.items() for k, v in _parts(p).items()}
    found = peer(
        options.peer_python, "control_sweep.py", **given, levels=LEVELS, band_hz=np.array(BAND_HZ),
        points=POINTS, process=_weights().process, sensor=_weights().sensor, repeats=REPEATS,
    )  # fmt: skip
    if found is not None:
        name = "python-control, slycot"
        made[0]["peers"] = cell(name, found, found["seconds"])
        made.append(row(CASE, "time over python-control's", "ratio", seconds / float(found["seconds"]), 0.25))
        both = np.isfinite(sweep.db) & np.isfinite(found["db"])
        made.append(row(CASE, "verdicts on stability that differ", "loops",
                        np.sum(np.isfinite(sweep.db) != np.isfinite(found["db"])), 0))  # fmt: skip
        made.append(row(CASE, "largest difference, its grid included", "dB",
                        np.abs(sweep.db - found["db"])[both].max()))  # fmt: skip
    return made


def _plant(shift: float) -> Plant:
    """Seven rigid-body modes (on a suspension where ``shift``), 23 flexible ones to 50 Hz, PD closed."""
    rng = np.random.default_rng(7)
    psi = np.vstack([rng.standard_normal((RIGID, RIGID)) + 2.0 * np.eye(RIGID),
                     0.5 * rng.standard_normal((FLEXIBLE, RIGID))])  # fmt: skip
    hz = np.geomspace(1.5, 50.0, FLEXIBLE)
    drift = np.random.default_rng(8).standard_normal(FLEXIBLE)
    rigid = np.linspace(0.05, 0.3, RIGID) if shift else np.zeros(RIGID)
    omega = 2.0 * np.pi * np.concatenate([rigid, hz * (1.0 + shift * drift)])
    zeta = np.concatenate([np.full(RIGID, 0.03) if shift else np.zeros(RIGID), np.full(FLEXIBLE, 0.01)])
    phi = psi.T + 0.05 * np.hstack([np.zeros((RIGID, RIGID)), rng.standard_normal((RIGID, FLEXIBLE))])
    nothing = np.zeros_like(phi)
    # Collocated angles and rates for the PD loops; lines of sight, not quite collocated, to be controlled.
    modal = ModalSystem(
        omega=omega,
        zeta=zeta,
        psi=psi,
        phi=np.vstack([psi.T, nothing, phi]),
        phi_rate=np.vstack([nothing, psi.T, nothing]),
        names=tuple(f"mode {k}" for k in range(RIGID + FLEXIBLE)),
    )
    loops = tuple(f"joint {k}" for k in range(RIGID))
    seen = tuple(f"line {k}" for k in range(RIGID))
    outputs = [Port(n, "rad") for n in loops] + [Port(f"{n}_rate", "rad/s") for n in loops]
    plant = Plant(
        dynamics=modal,
        inputs=tuple(Port(n, "N m") for n in loops),
        outputs=(*outputs, *(Port(n, "rad") for n in seen)),
        w=loops[INPUTS:],
        u=loops[:INPUTS],
        z=seen[:INPUTS],
        y=(*seen, *(f"{n}_rate" for n in loops)),
    )
    w0 = 2.0 * np.pi * 0.1
    return close_inner_loop(plant, PDLoops(loops, np.full(RIGID, w0**2 / 5.0), np.full(RIGID, w0 / 5.0)))


def _weights() -> LQGWeights:
    names = tuple(f"joint {k}" for k in (*range(INPUTS, RIGID), *range(INPUTS)))
    process = INTENSITY * np.diag([1.0] * (RIGID - INPUTS) + [1e-5] * INPUTS)
    sensor = np.array([4e-10] * RIGID + [4e-8] * RIGID)
    return LQGWeights(
        output=np.ones(INPUTS), input=np.ones(INPUTS), disturbed=names, process=process, sensor=sensor
    )


def _sweep(plants: dict[str, Plant]) -> AuthoritySweep:
    weights, orbit = _weights(), plants["orbit"]
    performance = Performance(np.ones(INPUTS), INTENSITY * np.eye(RIGID - INPUTS), BAND_HZ)
    design = partial(design_lqg, orbit, weights, kalman=design_filter(orbit, weights))
    return sweep_authority(design, LEVELS, on=plants, performance=performance, reference=1e-3)


def _parts(plant: Plant) -> dict[str, np.ndarray]:
    names = _weights().disturbed
    noise, control = subsystem(plant, names, plant.y), subsystem(plant, plant.u, plant.z)
    return {"A": noise.A, "G": noise.B, "Bu": control.B, "Cz": control.C, "Cy": noise.C}
