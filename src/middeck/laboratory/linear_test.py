"""Figure 6 on the linear rig of an article in the laboratory: a torque command in, sampled outputs out."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.laboratory.settings import LoopTest, RigSettings
from middeck.realtime.rig import LinearRig, build_linear_rig, run_open_loop
from middeck.signals.excitation import random_multisine
from middeck.signals.record import Record
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.systems.plant import Plant
from middeck.values import record

RIG_MODES_HZ = 60.0  # the linear rig carries every mode up to here
EXCITATION_NM = 0.1  # rms of the torque command; the rig is linear, the noise relative


@record
class RigExperiment:
    """An open-loop record, the rig it was taken on, and one period of the torque command."""

    rig: LinearRig
    excitation: Float[np.ndarray, " sample"]
    record: Record


def rig_plant(modes: Modes, actuator: str, sensors: tuple[str, ...]) -> Plant:
    """All modes up to `RIG_MODES_HZ` between one actuator, which also disturbs, and the sensors."""
    count = int(np.searchsorted(modes.frequency_hz, RIG_MODES_HZ))
    w = u = (actuator,)
    return build_plant(modes, inputs=u, outputs=sensors, count=count, w=w, u=u, z=sensors, y=sensors)


def run_rig_experiment(
    plant: Plant, settings: RigSettings, test: LoopTest, rng: np.random.Generator
) -> RigExperiment:
    """Random-phase multisine over the band; noise as a fraction of each output's own rms."""
    excitation = random_multisine(test.band_hz, test.period_s, settings.sample_hz, EXCITATION_NM, rng)
    silent = np.zeros(len(plant.outputs))
    quiet = build_linear_rig(plant, sample_hz=settings.sample_hz, delay_s=settings.delay_s, noise_rms=silent)
    clean = run_open_loop(quiet, excitation[:, None], periods=1, rng=rng)
    noise = settings.noise_share * np.sqrt(np.mean(clean.y[0, 0] ** 2, axis=0))
    real = build_linear_rig(plant, sample_hz=settings.sample_hz, delay_s=settings.delay_s, noise_rms=noise)
    taken = run_open_loop(real, excitation[:, None], periods=test.periods, rng=rng)
    return RigExperiment(real, excitation, taken)
