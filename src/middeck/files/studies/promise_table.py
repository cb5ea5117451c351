"""The table ``[promise]`` of a study: ground tests, the refinement, and the promise for orbit."""

from typing import Annotated

from pydantic import Field

from middeck.files.refinements.unknown_form import UnknownForm
from middeck.files.toml.form import (
    Band,
    Finite,
    Form,
    Log10Authority,
    Names,
    NotNegative,
    NotNegatives,
    Positive,
    Positives,
    rule,
    whole,
    within,
)

States = Annotated[int, whole(2, 1000), rule(lambda n: n % 2 == 0, "must be even: two for each mode")]


class SetUpForm(Form):
    """One set-up of the ground test; ``set`` has the parameters that it set, by name."""

    name: str
    set: dict[str, Finite] = Field(default_factory=dict)


class PromiseForm(Form):
    """Test on the ground, refine, take gravity out, promise one loop, and fly it."""

    article: str
    environment: str
    hidden_seed: Annotated[int, whole(0, 2**63 - 1)]
    inputs: Names
    outputs: Names
    joints: Names
    drag_nms_per_rad: NotNegative
    slip_tolerance: Annotated[float, within(least=0.0, below=1.0)]
    torque_nm: Positives
    weaker: Annotated[float, within(above=0.0, below=1.0)]
    band_hz: Band
    period_s: Positive
    periods: Annotated[int, whole(2, 1000)]
    states: Annotated[tuple[States, ...], Field(strict=False, min_length=1)]
    gain_std: Annotated[float, within(least=0.0, below=1.0)]
    test: Annotated[tuple[SetUpForm, ...], Field(strict=False, min_length=1)]
    unknown: Annotated[tuple[UnknownForm, ...], Field(strict=False, min_length=1)]
    actuator: str
    sensor: str
    disturbance_nm: Positive
    loop_band_hz: Band
    angle_noise_rad_per_rthz: Positive
    delay_tolerance_s: NotNegative
    gain_tolerance: Annotated[float, within(least=0.0, below=1.0)]
    umbilical_hz: NotNegative
    pd_loops: Names
    pd_kp_nm_per_rad: NotNegatives
    pd_kd_nms_per_rad: NotNegatives
    modes_kept: Annotated[int, whole(7, 10000)]
    draws: Annotated[int, whole(2, 1000000)]
    log10_authority: Annotated[tuple[Log10Authority, ...], Field(strict=False, min_length=1)]
    flight_period_s: Positive
    flight_periods: Annotated[int, whole(2, 1000)]
    flight_states: States
    ground_log10_authority: Log10Authority
