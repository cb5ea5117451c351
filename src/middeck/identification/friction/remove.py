"""A record behind the friction of its joints."""

import dataclasses

import numpy as np

from middeck.errors import DataError
from middeck.identification.friction.find import JointFriction
from middeck.identification.friction.slider import joint_angles
from middeck.signals.ports import port_indices
from middeck.signals.record import Record


def without_friction(record: Record, found: JointFriction) -> Record:
    """The record with the joints' friction subtracted from its commands: that of a linear article.

    Each experiment's inputs and outputs are scaled by one factor, which leaves a linear response unchanged,
    so that all experiments have the same noise and averages weigh them rightly. Friction that remains adds
    to the scatter of the response if there are more experiments than inputs.

    Raises `ConfigError` for a record without these channels, `DataError` for one that is not periodic.
    """
    if not record.periodic:
        raise DataError("the record is not periodic", where="friction", hint="cut its periods first")
    motor = port_indices(record.inputs, found.inputs, "input")
    angle = port_indices(record.outputs, found.outputs, "output")
    angles = joint_angles(record, angle, found.band_hz[1])
    torque = found.slip_torque * angles.torques(found.slip_angle, found.delay_s)
    u = record.u.copy()
    u[..., motor] -= np.moveaxis(torque, 0, 1)[:, None]
    scale = _to_one_noise(record)[:, None, None, None]
    return dataclasses.replace(record, u=scale * u, y=scale * record.y)


def _to_one_noise(record: Record) -> np.ndarray:
    """A factor for each experiment that makes their noise equal; ones where periods do not show the noise."""
    if record.y.shape[1] < 2:
        return np.ones(len(record.y))
    noise = record.y.std(axis=1, ddof=1).mean(axis=1)
    return np.asarray(1.0 / np.exp(np.mean(np.log(noise / noise.mean(axis=0)), axis=1)))
