"""The simulated rig with friction, gaps and stops at its joints; all else as the linear rig has it.

Between two ticks of the computer it takes a number of internal steps, see `middeck.joints.simulation`.
Commands are held over a tick and delayed exactly as in `build_linear_rig`, outputs sampled at the tick.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.joints.simulation import JointElements, JointStepper, build_joint_stepper, simulate_joints
from middeck.realtime.rig import pure_delay
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plant import Plant
from middeck.values import record

STEADY = 1e-6
"""Two periods that differ by less than this part of their rms are the same: sixty decibels below a noise of
a thousandth."""


@record(kw_only=True)
class NonlinearRig:
    """A sampled test article whose joints rub, stick or knock.

    Parameters
    ----------
    stepper:
        The continuous plant at the internal step, with its joints' elements.
    steps:
        Internal steps in a tick.
    sample_hz, noise_rms, inputs, outputs:
        As in `LinearRig`.
    """

    stepper: JointStepper
    steps: int
    sample_hz: float
    noise_rms: Float[np.ndarray, " output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


def build_nonlinear_rig(
    plant: Plant,
    joints: Sequence[JointElements],
    *,
    sample_hz: float,
    delay_s: float,
    noise_rms: Float[np.ndarray, " output"],
    steps: int = 8,
) -> NonlinearRig:
    """The rig of ``plant`` with ``joints``, and a total delay from torque command to sampled output.

    ``steps`` internal steps h in a tick lower the frequency w of a mode that the elements alone would hold by
    (w h)^2/12 of itself; without elements the rig is exact. Half a sample of ``delay_s`` is the hold's own.
    Raises `ConfigError` if less than that is left, for ports as `build_joint_stepper` does, or for no step.
    """
    if steps < 1:
        raise ConfigError(f"{steps} internal steps in a tick", hint="one or more")
    stepper = build_joint_stepper(
        plant, joints, step_s=1.0 / (sample_hz * steps), delay_s=pure_delay(sample_hz, delay_s)
    )
    return NonlinearRig(
        stepper=stepper,
        steps=steps,
        sample_hz=sample_hz,
        noise_rms=noise_rms,
        inputs=plant.inputs,
        outputs=plant.outputs,
    )


def run_nonlinear_open_loop(
    rig: NonlinearRig,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
    settle: int = 4,
) -> Record:
    """``periods`` periods of the response to a repeated ``excitation``, after ``settle`` from rest.

    What rubs need not have a steady state, and may take long to find it. The record is ``periodic`` where two
    successive periods agree to `STEADY` without noise; otherwise it is one run, the periods end to end.
    Raises `ConfigError` for periods that are none, `NumericalError` where the plant is unstable.
    """
    if periods < 1 or settle < 0:
        raise ConfigError(
            f"{periods} periods after {settle} to settle", hint="one or more after zero or more"
        )
    u = np.asarray(excitation, dtype=float)
    held = np.repeat(u, rig.steps, axis=0)
    state, rows = None, list[np.ndarray]()
    for _ in range(settle + periods):
        y, state = simulate_joints(rig.stepper, held, state)
        rows.append(y[:: rig.steps])
    # With one period to judge by, the one before it, settled or not, is its like.
    seen = np.array(rows[max(settle - 1, 0) :])
    clean = np.array(rows[settle:])
    steady = _is_steady(seen)
    noise = rng.standard_normal(clean.shape) * rig.noise_rms
    y, taken = clean + noise, np.broadcast_to(u, (periods, *u.shape))
    if not steady:
        y, taken = y.reshape(1, -1, y.shape[2]), taken.reshape(1, -1, u.shape[1])
    return Record(
        sample_hz=rig.sample_hz,
        u=taken[None],
        y=y[None],
        inputs=rig.inputs,
        outputs=rig.outputs,
        periodic=steady,
        held=True,
    )


def _is_steady(periods: Float[np.ndarray, "period sample output"]) -> bool:
    """Whether no output changes from period to period; a single period cannot tell."""
    if len(periods) < 2:
        return False
    size = np.sqrt(np.mean(periods[-1] ** 2, axis=0))
    change = np.sqrt(np.mean(np.diff(periods, axis=0) ** 2, axis=1))
    return bool(np.all(change <= STEADY * size))
