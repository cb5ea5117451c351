"""Figure 6 on the rig of an article in the laboratory, linear but for noise."""

import numpy as np

from middeck.laboratory.rig.parts.sensors import Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.laboratory.rig_settings import LoopTest, RigSettings
from middeck.signals.excitation.multisine import random_multisine
from middeck.signals.record import Record
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.systems.plants.plant import Plant

RIG_MODES_HZ = 60.0  # the rig of Figure 6 carries every mode up to here
EXCITATION_NM = 0.1  # rms of the torque command; the rig is linear, the noise relative


def rig_plant(modes: Modes, actuator: str, sensors: tuple[str, ...]) -> Plant:
    """All modes up to `RIG_MODES_HZ` between one actuator, which also disturbs, and the sensors."""
    count = int(np.searchsorted(modes.frequency_hz, RIG_MODES_HZ))
    w = u = (actuator,)
    return build_plant(modes, inputs=u, outputs=sensors, count=count, w=w, u=u, z=sensors, y=sensors)


def run_rig_experiment(
    plant: Plant, settings: RigSettings, test: LoopTest, rng: np.random.Generator
) -> Record:
    """Record under a random-phase multisine over the band; noise as a share of each output's own rms."""
    excitation = random_multisine(test.band_hz, test.period_s, settings.sample_hz, EXCITATION_NM, rng)

    def take(noise_rms: np.ndarray, periods: int) -> Record:
        sensors = {p.name: Sampler(float(n)) for p, n in zip(plant.outputs, noise_rms, strict=True)}
        rig = build_rig(plant, sample_hz=settings.sample_hz, delay_s=settings.delay_s, sensors=sensors)
        run = run_open_loop(rig, excitation[:, None], periods=periods, rng=rng, settle=0, steady=True)
        assert run.record is not None, run.cause
        return run.record

    clean = take(np.zeros(len(plant.outputs)), 1)
    return take(settings.noise_share * np.sqrt(np.mean(clean.y[0, 0] ** 2, axis=0)), test.periods)
