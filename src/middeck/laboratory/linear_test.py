"""Figure 6 on the rig of an article in the laboratory with nothing switched on but noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.laboratory.settings import LoopTest, RigSettings
from middeck.realtime.rig import Rig, build_rig
from middeck.realtime.runs import run_open_loop
from middeck.realtime.sensors import Sampler
from middeck.signals.excitation import random_multisine
from middeck.signals.record import Record
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.systems.plant import Plant
from middeck.values import record

RIG_MODES_HZ = 60.0  # the rig of Figure 6 carries every mode up to here
EXCITATION_NM = 0.1  # rms of the torque command; the rig is linear, the noise relative


@record
class RigExperiment:
    """An open-loop record, the rig it was taken on, and one period of the torque command."""

    rig: Rig
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

    def take(noise_rms: np.ndarray, periods: int) -> tuple[Rig, Record]:
        sensors = {p.name: Sampler(float(n)) for p, n in zip(plant.outputs, noise_rms, strict=True)}
        rig = build_rig(plant, sample_hz=settings.sample_hz, delay_s=settings.delay_s, sensors=sensors)
        run = run_open_loop(rig, excitation[:, None], periods=periods, rng=rng, settle=0, steady=True)
        assert run.record is not None, run.cause
        return rig, run.record

    _, clean = take(np.zeros(len(plant.outputs)), 1)
    noise = settings.noise_share * np.sqrt(np.mean(clean.y[0, 0] ** 2, axis=0))
    rig, taken = take(noise, test.periods)
    return RigExperiment(rig, excitation, taken)
