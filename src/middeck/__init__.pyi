"""The public names, each from the room that holds it; ``import middeck`` loads one when it is first used."""

from .control.analysis.rms import (
    measure_control_rms as measure_control_rms,
    measure_metric as measure_metric,
    measure_rms as measure_rms,
)
from .control.analysis.disk import measure_disk_margin as measure_disk_margin
from .control.analysis.inversion import find_inversion as find_inversion
from .control.analysis.margins import measure_margins as measure_margins
from .control.analysis.margins_table import margins_table as margins_table
from .control.analysis.return_ratio import trace_return_ratio as trace_return_ratio
from .control.analysis.shifts import find_allowed_shifts as find_allowed_shifts
from .control.analysis.stability import decide_stability as decide_stability
from .control.analysis.worst_case import find_worst_case as find_worst_case
from .control.loop.authority import (
    find_first_instability as find_first_instability,
    sweep_authority as sweep_authority,
)
from .control.law.classical import (
    PDLoops as PDLoops,
    close_inner_loop as close_inner_loop,
)
from .control.loop.closed_loop import (
    ClosedLoop as ClosedLoop,
    close_loop as close_loop,
    leave_open as leave_open,
)
from .control.law.compensator import Compensator as Compensator
from .control.lqg.coloured_plant import colour_disturbances as colour_disturbances
from .control.lqg.design import design_lqg as design_lqg
from .control.lqg.estimator import design_filter as design_filter
from .control.lqg.levels import design_levels as design_levels
from .control.lqg.shaping import Shaping as Shaping
from .control.lqg.spectra import (
    fit_spectrum as fit_spectrum,
    line_filter as line_filter,
    sum_spectra as sum_spectra,
)
from .control.lqg.topologies import compare_topologies as compare_topologies
from .control.lqg.weights import LQGWeights as LQGWeights
from .control.loop.participation import (
    find_participation as find_participation,
    find_participations as find_participations,
)
from .control.loop.performance import Performance as Performance
from .control.loop.pointing import (
    PointingWindow as PointingWindow,
    budget_pointing as budget_pointing,
)
from .control.qualification import qualify_compensator as qualify_compensator
from .control.reduction.compensators import reduce_compensator as reduce_compensator
from .control.reduction.modal import reduce_modes as reduce_modes
from .control.reduction.plants import reduce_plant as reduce_plant
from .control.riccati.continuous import solve_riccati as solve_riccati
from .control.riccati.discrete import solve_discrete_riccati as solve_discrete_riccati
from .control.robust.comparison import (
    compare_designs as compare_designs,
    comparison_table as comparison_table,
)
from .control.robust.exchange import design_for_worst as design_for_worst
from .control.robust.monte_carlo import verify_robustness as verify_robustness
from .control.robust.multimodel import design_multimodel as design_multimodel
from .control.robust.popov import design_popov as design_popov
from .control.noise import measure_noise_rms as measure_noise_rms
from .control.robust.sampled_plant import plant_as_sampled as plant_as_sampled
from .control.robust.sensitivity_weighted import design_sensitivity_weighted as design_sensitivity_weighted
from .control.sampled.aliases import find_aliases as find_aliases
from .control.sampled.antialias import filter_measurements as filter_measurements
from .control.sampled.comparison import compare_sampling as compare_sampling
from .control.sampled.design import design_sampled_lqg as design_sampled_lqg
from .control.sampled.emulation import emulate as emulate
from .control.sampled.sampling_table import sampling_table as sampling_table
from .control.shaping.sections import (
    design_pd as design_pd,
    first_order_section as first_order_section,
    notch as notch,
    roll_off as roll_off,
    second_order_section as second_order_section,
    shape_compensator as shape_compensator,
)
from .control.law.uncertainty import (
    ModeShift as ModeShift,
    Uncertainty as Uncertainty,
    draw_positions as draw_positions,
)
from .errors import MiddeckError as MiddeckError
from .files.compensators import (
    load_compensator as load_compensator,
    write_compensator as write_compensator,
)
from .files.documents import (
    load_case as load_case,
    load_environment as load_environment,
    load_structure as load_structure,
)
from .files.exchange.mat import (
    load_mat as load_mat,
    write_mat as write_mat,
)
from .files.exchange.named import (
    as_compensator as as_compensator,
)
from .files.exchange.python_control import (
    from_control as from_control,
    to_control as to_control,
)
from .files.exchange.scipy_signal import (
    from_scipy as from_scipy,
    to_scipy as to_scipy,
)
from .files.measured_modes import (
    load_measured_modes as load_measured_modes,
    write_measured_modes as write_measured_modes,
)
from .files.models import (
    load_fitted as load_fitted,
    load_model as load_model,
    write_model as write_model,
)
from .files.records import (
    load_campaign as load_campaign,
    load_record as load_record,
    load_records as load_records,
    load_response as load_response,
    open_record as open_record,
    read_record as read_record,
    write_record as write_record,
    write_response as write_response,
    write_stream as write_stream,
)
from .files.records.columns import name_columns as name_columns
from .files.records.together import split_periods as split_periods
from .files.studies import load_study as load_study
from .identification.faults.detect import detect_faults as detect_faults
from .identification.fit.fit_response import fit_response as fit_response
from .identification.order.stabilisation import stabilisation as stabilisation
from .identification.impact.average import average_blows as average_blows
from .identification.impact.damping import fit_impact as fit_impact
from .identification.model.measurement_model import (
    MeasurementModel as MeasurementModel,
    model_response as model_response,
)
from .identification.plants.delays import merge_delays as merge_delays
from .identification.plants.measured_plant import measured_plant as measured_plant
from .identification.plants.modal_parameters import modal_parameters as modal_parameters
from .identification.plants.pole_zero_gain import (
    from_pole_zero_gain as from_pole_zero_gain,
    pole_zero_gain as pole_zero_gain,
)
from .identification.plants.reduction import minimal_model as minimal_model
from .identification.model.selection import (
    scale_channels as scale_channels,
    select_channels as select_channels,
)
from .identification.plants.zeros import (
    matrix_zeros as matrix_zeros,
    name_zeros as name_zeros,
    path_zeros as path_zeros,
)
from .identification.record_fit.fit_record import fit_record as fit_record
from .identification.record_fit.simulation import (
    record_nrmse as record_nrmse,
    simulate_record as simulate_record,
)
from .identification.model.simulation import nrmse as nrmse
from .identification.spectra.averages import estimate_spectra as estimate_spectra
from .identification.spectra.coherence import (
    multiple_coherence as multiple_coherence,
    ordinary_coherence as ordinary_coherence,
    partial_coherence as partial_coherence,
)
from .identification.spectra.distortion import estimate_distortion as estimate_distortion
from .identification.spectra.estimate import (
    estimate_response as estimate_response,
    response_scatter as response_scatter,
)
from .identification.spectra.ratios import spectra_response as spectra_response
from .identification.tracking.follow import start_tracking as start_tracking
from .identification.tracking.history import track_modes as track_modes
from .identification.tracking.update import update_tracking as update_tracking
from .identification.uncertainty.accuracy import (
    expected_accuracy as expected_accuracy,
    periods_needed as periods_needed,
)
from .identification.uncertainty.drift import compare_fits as compare_fits
from .identification.uncertainty.model_set import sample_models as sample_models
from .identification.uncertainty.parameters import parameters_of as parameters_of
from .identification.uncertainty.response_bounds import (
    response_bounds as response_bounds,
    simultaneous_bounds as simultaneous_bounds,
)
from .identification.uncertainty.response_drift import compare_responses as compare_responses
from .realtime.drift import (
    Drift as Drift,
    age_plant as age_plant,
    nearest_modes as nearest_modes,
)
from .realtime.events import StopRule as StopRule
from .realtime.hardware_rig import build_hardware_rig as build_hardware_rig
from .realtime.hardware_runs import (
    run_hardware_closed_loop as run_hardware_closed_loop,
    run_hardware_open_loop as run_hardware_open_loop,
)
from .realtime.motors import Motor as Motor
from .realtime.nonlinear_rig import (
    build_nonlinear_rig as build_nonlinear_rig,
    run_nonlinear_open_loop as run_nonlinear_open_loop,
)
from .realtime.sensors import (
    Encoder as Encoder,
    Gyro as Gyro,
)
from .structure.model.article import (
    Damping as Damping,
    Structure as Structure,
)
from .structure.summary.summary import summarise as summarise
from .structure.gravity.comparison import compare_modes as compare_modes
from .structure.correlation.correlate import correlate_modes as correlate_modes
from .structure.correlation.effective_mass import measure_effective_mass as measure_effective_mass
from .structure.correlation.measured_modes import (
    MeasuredModes as MeasuredModes,
    MeasurementNoise as MeasurementNoise,
    measure_modes as measure_modes,
)
from .structure.correlation.profiles import find_profile as find_profile
from .structure.correlation.reduction import Reduction as Reduction
from .structure.model.environment import (
    AnchoredSpring as AnchoredSpring,
    Device as Device,
    DeviceKind as DeviceKind,
    Environment as Environment,
    Suspension as Suspension,
)
from .structure.rest.equilibrium import (
    Equilibrium as Equilibrium,
    solve_equilibrium as solve_equilibrium,
)
from .structure.gimbals.amplitude import sweep_amplitude as sweep_amplitude
from .structure.gimbals.family import sweep_gimbals as sweep_gimbals
from .structure.gravity.budget import build_budget as build_budget
from .structure.gravity.path import follow_gravity as follow_gravity
from .structure.gravity.places import (
    find_place as find_place,
    tilt_place as tilt_place,
)
from .structure.modes.solve import (
    Modes as Modes,
    solve_modes as solve_modes,
)
from .structure.plants.damping import estimate_damping as estimate_damping
from .structure.plants.modal_plant import build_plant as build_plant
from .structure.plants.port_rows import accelerometer_offset as accelerometer_offset
from .structure.plants.residual import compare_static_gain as compare_static_gain
from .structure.sensitivity.frequencies import differentiate_frequencies as differentiate_frequencies
from .structure.sensitivity.parameters import (
    find_parameters as find_parameters,
    list_parameters as list_parameters,
)
from .structure.sensitivity.plants import differentiate_plant as differentiate_plant
from .structure.sensitivity.rest import differentiate_rest as differentiate_rest
from .structure.sensitivity.shapes import differentiate_modes as differentiate_modes
from .structure.suspension.attitude import estimate_attitude as estimate_attitude
from .structure.suspension.device_friction import (
    estimate_rest_band as estimate_rest_band,
    sweep_device_amplitude as sweep_device_amplitude,
)
from .structure.suspension.levelling import level as level
from .joints.deadband import Deadband as Deadband
from .systems.delay_approximation import approximate_delays as approximate_delays
from .signals.excitation.binary import (
    design_binary as design_binary,
    design_mls as design_mls,
)
from .signals.excitation.limits import Limits as Limits
from .signals.excitation.multisine import design_multisine as design_multisine
from .signals.excitation.noise import (
    design_burst as design_burst,
    design_noise as design_noise,
)
from .signals.excitation.recognition import (
    cut_periods as cut_periods,
    recognise_excitation as recognise_excitation,
)
from .signals.excitation.signal import Excitation as Excitation
from .signals.excitation.sweep import (
    design_stepped_sine as design_stepped_sine,
    design_sweep as design_sweep,
)
from .joints.friction import Friction as Friction
from .systems.peak_gain import peak_gain as peak_gain
from .systems.own_plant import make_plant as make_plant
from .systems.plant import (
    Plant as Plant,
    delay_plant as delay_plant,
    group_ports as group_ports,
    remove_delays as remove_delays,
)
from .signals.ports import (
    Channel as Channel,
    Port as Port,
)
from .signals.record import (
    Campaign as Campaign,
    Record as Record,
    RecordStream as RecordStream,
)
from .systems.response import (
    FrequencyResponse as FrequencyResponse,
    evaluate_plant as evaluate_plant,
)
from .systems.sampled_plant import sample_plant as sample_plant
from .systems.sampling import tustin as tustin

__version__: str
__all__: list[str]
