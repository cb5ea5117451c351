"""One million samples of a closed loop, and what a tick costs where motors and sensors are not linear."""

from __future__ import annotations

import time
import tracemalloc
from typing import Any

import numpy as np

from measured.rows import cell, peer, row
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.computer import build_computer
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Encoder
from middeck.laboratory.rig.rig import Rig, build_rig
from middeck.laboratory.rig.ticks.simulate_rig import BLOCK, cut_blocks, simulate_rig
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.verdict import is_stable
from middeck.systems.sampling.sampling import sample_dynamics, tustin
from middeck.systems.sampling.simulation import stream
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.modal_system import ModalSystem, select_modes
from middeck.systems.state_space.statespace import SampledStateSpace

CASE = "simulation"
PERIOD_S, SAMPLES, PIECE, REPEATS = 1e-3, 1_000_000, 50_000, 3
MODES, KEPT_MODES, INPUTS, OUTPUTS = 30, 20, 5, 14
LAST, TICKS = 1000, 50_000
SHORT, LONG = 100_000, 1_000_000  # ticks of the runs whose memory is compared


def rows(options: Any) -> list[dict]:
    plant = _plant()
    law = _law(plant)
    held = sample_dynamics(plant.dynamics, PERIOD_S, PERIOD_S)
    loop = feedback(held, law, range(INPUTS), range(OUTPUTS))
    # Disturbed at the inputs; the measured outputs.
    system = SampledStateSpace(
        loop.A, loop.B[:, :INPUTS], loop.C[:OUTPUTS], loop.D[:OUTPUTS, :INPUTS], period_s=PERIOD_S
    )
    assert is_stable(system)
    seconds, y, peak = _ours(system)
    made = [row(CASE, "million closed-loop samples", "CPU s", seconds, states=len(system.A)),
            row(CASE, "memory in all", "MB", peak,
                note="ours what it allocates, the peer's resident")]  # fmt: skip
    found = peer(
        options.peer_python, "control_simulation.py", A=system.A, B=system.B, C=system.C, D=system.D,
        period_s=PERIOD_S, samples=SAMPLES, kept=LAST, seed=0, repeats=3,
    )  # fmt: skip
    if found is not None:
        name = "python-control"
        made[0]["peers"] = cell(name, found, found["seconds"])
        made[1]["peers"] = cell(name, found, found["peak_mb"])
        made.append(row(CASE, "time over python-control's", "ratio", seconds / float(found["seconds"]), 0.25))
        error = np.abs(y - found["y"]).max() / np.abs(found["y"]).max()
        made.append(row(CASE, "difference from python-control", "relative", error, 1e-12))
    return made + _hybrid(plant, law)


def _plant() -> Plant:
    """The frozen case's: 30 modes log-spaced 0.3 to 60 Hz at 1 %."""
    rng = np.random.default_rng(60)
    omega = 2.0 * np.pi * np.geomspace(0.3, 60.0, MODES)
    psi = rng.standard_normal((MODES, INPUTS))
    phi = np.vstack([psi.T, rng.standard_normal((OUTPUTS - INPUTS, MODES))])
    names = tuple(f"mode {k}" for k in range(MODES))
    modal = ModalSystem(
        omega=omega, zeta=np.full(MODES, 0.01), psi=psi, phi=phi, phi_rate=np.zeros_like(phi), names=names
    )
    inputs = tuple(Port(f"u{i}", "N m") for i in range(INPUTS))
    outputs = tuple(Port(f"y{i}", "rad") for i in range(OUTPUTS))
    u, y = tuple(p.name for p in inputs), tuple(p.name for p in outputs)
    return Plant(dynamics=modal, inputs=inputs, outputs=outputs, w=u, u=u, z=y, y=y)


def _law(plant: Plant) -> SampledStateSpace:
    """An LQG of 40 states on the 20 lowest modes, of an authority that the other ten let live."""
    modal = plant.dynamics
    assert isinstance(modal, ModalSystem)
    design = Plant(
        dynamics=select_modes(modal, np.arange(KEPT_MODES)),
        inputs=plant.inputs,
        outputs=plant.outputs,
        w=plant.w,
        u=plant.u,
        z=plant.z,
        y=plant.y,
    )
    weights = LQGWeights(
        output=np.ones(OUTPUTS),
        input=np.ones(INPUTS),
        disturbed=plant.u,
        process=np.eye(INPUTS),
        sensor=np.full(OUTPUTS, 1e-2),
    )
    return tustin(design_lqg(design, weights, 1e-2).system, PERIOD_S)


def _ours(system: SampledStateSpace) -> tuple[float, np.ndarray, float]:
    """CPU seconds (median), the last outputs, and the memory that a run takes at its most."""

    def run() -> np.ndarray:
        rng = np.random.default_rng(0)
        pieces = (rng.standard_normal((PIECE, INPUTS)) for _ in range(SAMPLES // PIECE))
        y = np.empty((0, OUTPUTS))
        for piece in stream(system, pieces):
            y = piece
        return y[-LAST:]

    def draw() -> None:
        rng = np.random.default_rng(0)
        for _ in range(SAMPLES // PIECE):
            rng.standard_normal((PIECE, INPUTS))

    times = []
    for _ in range(REPEATS):
        times.append(_cpu(run)[0] - _cpu(draw)[0])  # the peer's noise is not counted either
    tracemalloc.start()
    y = run()
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    return float(np.median(times)), y, peak


def _hybrid(plant: Plant, law: SampledStateSpace) -> list[dict]:
    """Saturation, slew, converters and encoders at every tick; then one rubbing joint besides."""
    motors = {p.name: Motor(torque_limit=1.0, slew_limit=300.0, resolution=1e-4) for p in plant.inputs}
    sensors = {p.name: Encoder(1e-5) for p in plant.outputs}
    rub = JointElements("u0", "y0", (Friction(0.05, 50.0, 0.01),))
    made = []
    for joints, what in (((), "hybrid tick: limits, slew and converters"), ((rub,), "the same and friction")):
        rig = build_rig(
            plant, motors=motors, sensors=sensors, joints=joints, sample_hz=1.0 / PERIOD_S, delay_s=1.5e-3
        )
        placed = Compensator(law, plant.outputs, plant.inputs)
        times = []
        for _ in range(REPEATS):
            rng = np.random.default_rng(0)
            noise = rng.standard_normal((TICKS, INPUTS))
            run = simulate_rig(rig, placed, cut_blocks(noise), rng)
            times.append(_cpu(lambda run=run: [None for _ in run])[0])
        made.append(row(CASE, what, "CPU us", 1e6 * float(np.median(times)) / TICKS, 20.0, states=100))
    made.append(row(CASE, "of which products with matrices", "CPU us", _products(rig, law), states=100))
    short, long = (_peak(rig, placed, ticks) for ticks in (SHORT, LONG))
    made.append(row(CASE, "memory of a million such ticks", "MB", long / 2**20, states=100))
    made.append(row(CASE, "the same over that of 100,000 ticks", "ratio", long / short, 1.1, states=100))
    return made


def _products(rig: Rig, law: SampledStateSpace) -> float:
    """CPU microseconds of a tick's three products alone, the least that it can take."""
    plant, computer = rig.plant, build_computer(rig.sensors, law)
    pairs = [np.vstack([plant.step[0], plant.read]), computer.step, plant.drive[0]]
    parts = [(m.copy(), np.ones(m.shape[1]), np.empty(len(m))) for m in pairs]

    def run() -> None:
        for _ in range(TICKS):
            for matrix, x, y in parts:
                np.dot(matrix, x, out=y)

    return 1e6 * float(np.median([_cpu(run)[0] for _ in range(REPEATS)])) / TICKS


def _peak(rig: Rig, law: Compensator, ticks: int) -> int:
    """Bytes that a run takes at its most, excitation and answer going by in pieces."""
    rng = np.random.default_rng(0)
    tracemalloc.start()
    pieces = (rng.standard_normal((BLOCK, INPUTS)) for _ in range(0, ticks, BLOCK))
    for _ in simulate_rig(rig, law, pieces, rng):
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def _cpu(work: Any) -> tuple[float, Any]:
    start = time.process_time()
    answer = work()
    return time.process_time() - start, answer
