"""A plant as the measurement model that a perfect test would give."""

import numpy as np

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.state_space.modal_system import ModalSystem, output_rows
from middeck.systems.state_space.statespace import StateSpace

# A real part of a pole below this share of its size is rounding: the plant does not decay.
ROUNDING = 1e-12


def model_of_plant(plant: Plant, *, delay_s: float = 0.0) -> MeasurementModel:
    """Poles and residues of ``plant`` from its inputs u to its outputs y (all of them if it names none).

    ``delay_s`` is that of the test beyond the plant's own, hold and computer included, on every output. Modal
    plants keep their real constants to rounding.

    Raises `ConfigError` for a plant with a pole that does not decay (a rigid-body mode): a test of finite
    length has no steady response of it.

    >>> from middeck.signals.ports import Port
    >>> mode = ModalSystem(omega=[10.0], zeta=[0.01], psi=[[2.0]], phi=[[3.0]], phi_rate=[[0.0]],
    ...     names=("bounce",))
    >>> model = model_of_plant(Plant(dynamics=mode, inputs=(Port("force", "N"),), outputs=(Port("way",
    ...     "m"),)))
    >>> model.poles.round(4).tolist()
    [(-0.1+9.9995j)]
    """
    rows = plant.output_indices(plant.y or [p.name for p in plant.outputs])
    columns = plant.input_indices(plant.u or [p.name for p in plant.inputs])
    modal = plant.modal
    damped = modal is not None and bool(np.all(modal.zeta < 1.0))
    on_time = remove_delays(plant)
    poles, c, b, direct = _of_modes(modal) if modal is not None and damped else _of_states(on_time.system)
    if np.any(np.real(poles) >= -ROUNDING * np.abs(poles)):
        raise ConfigError(
            "the plant has a pole that does not decay",
            where=f"pole at {np.abs(poles[np.argmax(np.real(poles))]) / (2.0 * np.pi):.4g} Hz",
            hint="hold the rigid-body modes, damp all others, or leave the mode out",
        )
    own = plant.delay_s[np.ix_(rows, columns)]
    beyond = own - own.min(axis=1, keepdims=True, initial=np.inf)
    return MeasurementModel(
        poles=poles,
        shapes=c[rows],
        participation=b[:, columns],
        direct=direct[np.ix_(rows, columns)],
        lower=np.zeros((len(rows), len(columns))),
        delay_s=own.min(axis=1, initial=np.inf) + delay_s,
        inputs=tuple(plant.inputs[i] for i in columns),
        outputs=tuple(plant.outputs[o] for o in rows),
        path_delay_s=beyond if np.any(beyond) else None,
    )


def _of_modes(modal: ModalSystem) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    omega_d = modal.omega * np.sqrt(1.0 - modal.zeta**2)
    poles = -modal.zeta * modal.omega + 1j * omega_d
    if not omega_d.all():
        raise ConfigError("the plant has a rigid-body mode", hint="hold it, or leave it out")
    rows = output_rows(modal)
    c = (rows.position + poles * rows.rate) / (2j * omega_d)
    return poles, c, modal.psi.astype(complex), rows.direct


def _of_states(system: StateSpace) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    poles, right = np.linalg.eig(system.A)
    keep = np.imag(poles) >= 0.0
    c, b = system.C @ right, np.linalg.solve(right, system.B.astype(complex))
    return poles[keep], c[:, keep], b[keep], system.D
