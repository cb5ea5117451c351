"""The public names, each from the room that holds it; ``import middeck`` loads one when it is first used."""

from .control.analysis.disk import measure_disk_margin as measure_disk_margin
from .control.analysis.inversion import find_inversion as find_inversion
from .control.analysis.margins import measure_margins as measure_margins
from .control.analysis.return_ratio import trace_return_ratio as trace_return_ratio
from .control.analysis.rms import (
    measure_metric as measure_metric,
    measure_rms as measure_rms,
)
from .control.analysis.shifts import find_allowed_shifts as find_allowed_shifts
from .control.analysis.stability import decide_stability as decide_stability
from .control.analysis.worst_case import find_worst_case as find_worst_case
from .control.law.classical import (
    PDLoops as PDLoops,
    close_inner_loop as close_inner_loop,
)
from .control.law.compensator import Compensator as Compensator
from .control.law.uncertainty import (
    ModeShift as ModeShift,
    Uncertainty as Uncertainty,
    draw_positions as draw_positions,
)
from .control.loop.authority import (
    find_first_instability as find_first_instability,
    sweep_authority as sweep_authority,
)
from .control.loop.closed_loop import (
    ClosedLoop as ClosedLoop,
    close_loop as close_loop,
    leave_open as leave_open,
)
from .control.loop.performance import Performance as Performance
from .control.loop.pointing import (
    PointingWindow as PointingWindow,
    budget_pointing as budget_pointing,
)
from .control.lqg.design import design_lqg as design_lqg
from .control.lqg.estimator import design_filter as design_filter
from .control.lqg.shaping import Shaping as Shaping
from .control.lqg.weights import LQGWeights as LQGWeights
from .control.noise import measure_noise_rms as measure_noise_rms
from .control.qualification import qualify_compensator as qualify_compensator
from .control.reduction.compensators import reduce_compensator as reduce_compensator
from .control.reduction.modal import reduce_modes as reduce_modes
from .control.robust.comparison import (
    compare_designs as compare_designs,
)
from .control.robust.monte_carlo import verify_robustness as verify_robustness
from .control.robust.multimodel import design_multimodel as design_multimodel
from .control.sampled.aliases import find_aliases as find_aliases
from .control.sampled.antialias import filter_measurements as filter_measurements
from .control.sampled.comparison import compare_sampling as compare_sampling
from .control.sampled.design import design_sampled_lqg as design_sampled_lqg
from .control.sampled.emulation import emulate as emulate
from .control.shaping.sections import (
    roll_off as roll_off,
    shape_compensator as shape_compensator,
)
from .errors import MiddeckError as MiddeckError
from .files.laws.blacklists import (
    load_blacklist as load_blacklist,
    write_blacklist as write_blacklist,
)
from .files.articles.components import (
    load_component as load_component,
    write_component as write_component,
)
from .files.laws.compensators import (
    load_compensator as load_compensator,
    write_compensator as write_compensator,
)
from .files.documents import (
    load_setup as load_setup,
    load_environment as load_environment,
    load_structure as load_structure,
)
from .files.exchange.mat import (
    load_mat as load_mat,
    write_mat as write_mat,
)
from .files.exchange.named import as_compensator as as_compensator
from .files.exchange.python_control import (
    from_control as from_control,
    to_control as to_control,
)
from .files.exchange.scipy_signal import (
    from_scipy as from_scipy,
    to_scipy as to_scipy,
)
from .files.measured.modes import (
    load_measured_modes as load_measured_modes,
    write_measured_modes as write_measured_modes,
)
from .files.measured.models import (
    load_model as load_model,
    write_model as write_model,
)
from .files.laws.packages import (
    load_package as load_package,
    write_package as write_package,
)
from .files.records import (
    load_record as load_record,
    load_response as load_response,
    open_record as open_record,
    write_record as write_record,
)
from .files.records.together import split_periods as split_periods
from .files.studies.documents import load_study as load_study
from .files.exchange.vtu import write_vtu as write_vtu
from .identification.faults.detect import detect_faults as detect_faults
from .identification.fit.fit_response import fit_response as fit_response
from .identification.free_decay.fit import fit_free_decay as fit_free_decay
from .identification.friction.find import find_friction as find_friction
from .identification.friction.remove import without_friction as without_friction
from .identification.impact.average import average_blows as average_blows
from .identification.impact.damping import fit_impact as fit_impact
from .identification.model.measurement_model import (
    MeasurementModel as MeasurementModel,
    model_response as model_response,
)
from .identification.model.selection import select_channels as select_channels
from .identification.model.simulation import nrmse as nrmse
from .identification.order.stabilisation import stabilisation as stabilisation
from .identification.plants.measured_plant import measured_plant as measured_plant
from .identification.plants.modal_parameters import modal_parameters as modal_parameters
from .identification.plants.zeros import (
    name_zeros as name_zeros,
    path_zeros as path_zeros,
)
from .identification.record_fit.fit_record import fit_record as fit_record
from .identification.spectra.estimate import estimate_response as estimate_response
from .identification.tracking.follow import start_tracking as start_tracking
from .identification.tracking.history import track_modes as track_modes
from .identification.tracking.update import update_tracking as update_tracking
from .identification.uncertainty.accuracy import expected_accuracy as expected_accuracy
from .identification.uncertainty.drift import compare_fits as compare_fits
from .identification.uncertainty.model_set import sample_models as sample_models
from .identification.uncertainty.parameters import parameters_of as parameters_of
from .identification.uncertainty.response_bounds import (
    response_bounds as response_bounds,
    simultaneous_bounds as simultaneous_bounds,
)
from .joints.friction import Friction as Friction
from .laboratory.article import (
    rig_article_plant as rig_article_plant,
    solve_rig_article as solve_rig_article,
)
from .laboratory.rig.drift import (
    Drift as Drift,
    age_plant as age_plant,
    nearest_modes as nearest_modes,
)
from .laboratory.rig.events import StopRule as StopRule
from .laboratory.rig.motors import Motor as Motor
from .laboratory.rig.rig import build_rig as build_rig
from .laboratory.rig.runs import (
    run_closed_loop as run_closed_loop,
    run_open_loop as run_open_loop,
)
from .laboratory.rig.sensors import (
    Encoder as Encoder,
    Gyro as Gyro,
    Sampler as Sampler,
)
from .laboratory.rig.stepped import SteppedRig as SteppedRig
from .plot.amplitude import draw_amplitude as draw_amplitude
from .plot.gimbal_family import draw_gimbal_family as draw_gimbal_family
from .plot.nichols import draw_nichols as draw_nichols
from .plot.nyquist import draw_nyquist as draw_nyquist
from .plot.shapes import draw_shapes as draw_shapes
from .realtime.engine.interface.adaptive_gain import AdaptiveGain as AdaptiveGain
from .realtime.engine.rigs.article import linear_article as linear_article
from .realtime.engine.process.build import build_engine as build_engine
from .realtime.engine.rigs.rig import EngineRig as EngineRig
from .realtime.engine.trials.served_rig import ServedRig as ServedRig
from .realtime.engine.interface.settings import (
    Drive as Drive,
    EngineSettings as EngineSettings,
    SensorTest as SensorTest,
)
from .realtime.engine.process.launch import DriverRig as DriverRig
from .realtime.engine.process.launch import UdpRig as UdpRig
from .realtime.engine.process.supervisor import Supervisor as Supervisor
from .realtime.engine.trials.trial import (
    Stage as Stage,
    run_trial as run_trial,
)
from .realtime.gate.adaptive import prove_gain as prove_gain
from .realtime.gate.gate import examine_package as examine_package
from .realtime.gate.steps import GateMargins as GateMargins
from .realtime.gate.trials import (
    GateRig as GateRig,
    GateTrials as GateTrials,
)
from .realtime.generate.c_source import generate_c as generate_c
from .realtime.package.build import package_law as package_law
from .realtime.package.package import ControllerPackage as ControllerPackage
from .realtime.package.reference import ReferenceLaw as ReferenceLaw
from .realtime.package.single import to_single as to_single
from .signals.excitation.limits import Limits as Limits
from .signals.excitation.multisine import design_multisine as design_multisine
from .signals.excitation.recognition import cut_periods as cut_periods
from .signals.ports import Port as Port
from .signals.record import (
    Campaign as Campaign,
    Record as Record,
)
from .structure.correlation.correlate import correlate_modes as correlate_modes
from .structure.correlation.frequencies import compare_frequencies as compare_frequencies
from .structure.correlation.measured_modes import (
    MeasuredModes as MeasuredModes,
    MeasurementNoise as MeasurementNoise,
    measure_modes as measure_modes,
)
from .structure.correlation.profiles import (
    Quantity as Quantity,
    change_limit as change_limit,
    find_profile as find_profile,
)
from .structure.correlation.reduction import Reduction as Reduction
from .structure.gimbals.amplitude import sweep_amplitude as sweep_amplitude
from .structure.gimbals.family import sweep_gimbals as sweep_gimbals
from .structure.gravity.budget import build_budget as build_budget
from .structure.gravity.comparison import compare_modes as compare_modes
from .structure.gravity.path import follow_gravity as follow_gravity
from .structure.model.article import (
    Damping as Damping,
    LoadCase as LoadCase,
    Structure as Structure,
)
from .structure.model.clamps import Clamp as Clamp
from .structure.model.component import Component as Component
from .structure.model.environment import Environment as Environment
from .structure.modes.craig_bampton import reduce_structure as reduce_structure
from .structure.modes.drawing import (
    Drawing as Drawing,
    build_mode_drawing as build_mode_drawing,
    build_rest_drawing as build_rest_drawing,
)
from .structure.modes.recovery import recover_outputs as recover_outputs
from .structure.modes.solve import (
    Modes as Modes,
    solve_modes as solve_modes,
)
from .structure.plants.gyroscopic import solve_gyroscopic_modes as solve_gyroscopic_modes
from .structure.plants.modal_plant import build_plant as build_plant
from .structure.plants.residual import compare_static_gain as compare_static_gain
from .structure.rest.equilibrium import (
    Equilibrium as Equilibrium,
    solve_equilibrium as solve_equilibrium,
)
from .structure.rest.link_loads import link_loads as link_loads
from .structure.sensitivity.frequencies import differentiate_frequencies as differentiate_frequencies
from .structure.sensitivity.parameters import find_parameters as find_parameters
from .structure.sensitivity.rest import differentiate_rest as differentiate_rest
from .structure.suspension.attitude import estimate_attitude as estimate_attitude
from .structure.suspension.device_friction import (
    estimate_rest_band as estimate_rest_band,
    sweep_device_amplitude as sweep_device_amplitude,
)
from .structure.suspension.levelling import level as level
from .systems.delay.delay_approximation import approximate_delays as approximate_delays
from .systems.plants.mode_blocks import part_modes as part_modes
from .systems.plants.own_plant import make_plant as make_plant
from .systems.plants.plant import (
    Plant as Plant,
    delay_plant as delay_plant,
    group_ports as group_ports,
    remove_delays as remove_delays,
)
from .systems.plants.response import (
    FrequencyResponse as FrequencyResponse,
    evaluate_plant as evaluate_plant,
)
from .systems.sampling.sampled_plant import sample_plant as sample_plant
from .systems.sampling.sampling import tustin as tustin
from .updating.candidates.candidate_survey import CandidateSurvey as CandidateSurvey
from .updating.candidates.candidates import rank_tests as rank_tests
from .updating.promise.draws import LoopSpread as LoopSpread
from .updating.orbit.deflections import predict_deflections as predict_deflections
from .updating.residuals.gauges import Gauge as Gauge, GaugeKind as GaugeKind
from .updating.residuals.fitted_survey import survey_from_fit as survey_from_fit
from .updating.orbit.frequencies import predict_modes as predict_modes
from .updating.promise.plan import Ladder as Ladder
from .updating.promise.plan import Plan as Plan
from .updating.promise.promise import promise as promise
from .updating.refinement.refine import refine as refine
from .updating.residuals.statics import StaticTest as StaticTest
from .updating.promise.slip import JointSlip as JointSlip
from .updating.residuals.surveys import Survey as Survey
from .updating.unknowns.unknowns import Unknown as Unknown

__version__: str
__all__: list[str]
