"""Settings of a simulated rig and its experiments, without an article."""

from middeck.joints.element import JointElement
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro
from middeck.values import record


@record(kw_only=True)
class RigSettings:
    """A simulated rig, whatever article it carries.

    Attributes:
        sample_hz, delay_s: Sampling rate; delay from torque command to sampled angle, half a sample of hold
            included.
        wheel, gimbal: Motors that act on nodes and at joints, the gimbal's without the torque that holds its
            payload.
        gimbal_elements: Friction and play at every free gimbal axis, commanded or not.
        encoder, gyro: Sensors of a joint angle, and of an inertial one.
        noise_share: White noise at the outputs of the rig of Figure 6, as a share of the rms of each.
        rest_s: Rest before a run, in which the gyros' biases are measured.
        modes_hz, mesh_factor, shear: The article on the rig: its modes up to here, elements per element of
            the model, and the shear coefficient of its struts (None: rigid in shear).
        umbilical_hz: Frequency that a weak cable gives the article in orbit; zero for none.
        hidden_seed: Seed of the article's hidden errors; None for none.
    """

    sample_hz: float
    delay_s: float
    wheel: Motor
    gimbal: Motor
    gimbal_elements: tuple[JointElement, ...]
    encoder: Encoder
    gyro: Gyro
    noise_share: float
    rest_s: float
    modes_hz: float
    mesh_factor: int
    shear: float | None
    umbilical_hz: float
    hidden_seed: int | None


@record(kw_only=True)
class LoopTest:
    """Experiments with one motor, in open and in closed loop.

    Attributes:
        actuator: The motor that is driven and that a compensator commands.
        band_hz, period_s, periods: Band and period of the multisines, and how many periods are recorded.
        open_nm, closed_nm: Rms of the torque command in open and in closed loop.
        pair_shift_hz: Frequency near which a pair of modes drifts.
    """

    actuator: str
    band_hz: tuple[float, float]
    period_s: float
    periods: int
    open_nm: float
    closed_nm: float
    pair_shift_hz: float
