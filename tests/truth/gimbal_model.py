"""The benchmark's gimbal as a plant and as the measurement model that a perfect test would give."""

import dataclasses

import gimbal_record
import numpy as np

from middeck.identification.model.plant_model import model_of_plant
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem

NAMES = ("first", "second", "third", "fourth", "fifth")


def plant(outputs=1, inputs=1):
    phi = gimbal_record.PHI[:outputs]
    modal = ModalSystem(
        omega=2.0 * np.pi * gimbal_record.MODES_HZ,
        zeta=np.full(5, gimbal_record.ZETA),
        psi=gimbal_record.PSI[:inputs].T,
        phi=phi,
        phi_rate=np.zeros_like(phi),
        names=NAMES,
    )
    return Plant(
        dynamics=modal, inputs=gimbal_record.INPUTS[:inputs], outputs=gimbal_record.OUTPUTS[:outputs]
    )


def model(outputs=1, inputs=1):
    perfect = model_of_plant(plant(outputs, inputs))
    return dataclasses.replace(perfect, delay_s=gimbal_record.DELAY_S[:outputs])
