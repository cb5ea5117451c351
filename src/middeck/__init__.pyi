"""The public names, each from the room that holds it; ``import middeck`` loads one when it is first used.

What is asked for less often has its place in the list of a room: ``middeck.control.find_aliases``.
"""

from .control.analysis.margins.margins import measure_margins as measure_margins
from .control.analysis.rms.measure_rms import (
    measure_metric as measure_metric,
    measure_rms as measure_rms,
)
from .control.analysis.shifts.shifts import find_allowed_shifts as find_allowed_shifts
from .control.analysis.stability.stability import decide_stability as decide_stability
from .control.law.pd_loops import (
    close_inner_loop as close_inner_loop,
    PDLoops as PDLoops,
)
from .control.law.compensator import Compensator as Compensator
from .control.law.uncertainty import (
    ModeShift as ModeShift,
    Uncertainty as Uncertainty,
)
from .control.loop.authority import (
    AuthoritySweep as AuthoritySweep,
    find_first_instability as find_first_instability,
    sweep_authority as sweep_authority,
)
from .control.loop.closed_loop import (
    close_loop as close_loop,
    ClosedLoop as ClosedLoop,
    leave_open as leave_open,
)
from .control.loop.performance import Performance as Performance
from .control.lqg.design import design_lqg as design_lqg
from .control.lqg.estimator import design_filter as design_filter
from .control.lqg.weights import Shaping as Shaping
from .control.lqg.weights import LQGWeights as LQGWeights
from .control.noise import measure_noise_rms as measure_noise_rms
from .control.qualification import qualify_compensator as qualify_compensator
from .control.reduction.reduced_compensators import reduce_compensator as reduce_compensator
from .control.reduction.modal import reduce_modes as reduce_modes
from .control.robust.verification.compare_designs import compare_designs as compare_designs
from .control.robust.designs.multimodel import design_multimodel as design_multimodel
from .control.sampled.sampled_design import design_sampled_lqg as design_sampled_lqg
from .control.sampled.emulation import emulate as emulate
from .control.shaping.leads_and_notches import shape_compensator as shape_compensator
from .errors import MiddeckError as MiddeckError
from .files.any_value import write as write
from .files.setups import (
    load_environment as load_environment,
    load_setup as load_setup,
    load_structure as load_structure,
)
from .files.exchange.python_control import (
    from_control as from_control,
    to_control as to_control,
)
from .files.laws.compensators import load_compensator as load_compensator
from .files.laws.packages import load_package as load_package
from .files.measured.modes import load_measured_modes as load_measured_modes
from .files.records import (
    load_record as load_record,
    open_record as open_record,
)
from .files.studies.documents import (
    load_study as load_study,
    Study as Study,
)
from .identification.faults.detect import detect_faults as detect_faults
from .identification.fit.fit_response import fit_response as fit_response
from .identification.free_decay.decay_fit import fit_free_decay as fit_free_decay
from .identification.impact.fit_of_blows import fit_impact as fit_impact
from .identification.model.measurement_model import (
    MeasurementModel as MeasurementModel,
    model_response as model_response,
)
from .identification.order.stabilisation import stabilisation as stabilisation
from .identification.plants.measured_plant import measured_plant as measured_plant
from .identification.record_fit.fit_record import fit_record as fit_record
from .identification.spectra.estimate import estimate_response as estimate_response
from .identification.tracking.history import track_modes as track_modes
from .identification.uncertainty.accuracy import expected_accuracy as expected_accuracy
from .identification.uncertainty.fit_drift import compare_fits as compare_fits
from .joints.friction import Friction as Friction
from .laboratory.rig.rig import (
    build_rig as build_rig,
    Rig as Rig,
)
from .laboratory.rig.runs import (
    run_closed_loop as run_closed_loop,
    run_open_loop as run_open_loop,
)
from .realtime.engine.process.supervisor import Supervisor as Supervisor
from .realtime.gate.gate import examine_package as examine_package
from .realtime.package.package_law import package_law as package_law
from .realtime.package.package import ControllerPackage as ControllerPackage
from .signals.excitation.limits import Limits as Limits
from .signals.excitation.multisine import design_multisine as design_multisine
from .signals.ports import Port as Port
from .signals.record import Record as Record
from .structure.correlation.correlate import correlate_modes as correlate_modes
from .structure.correlation.measured_modes import MeasuredModes as MeasuredModes
from .structure.gimbals.family import sweep_gimbals as sweep_gimbals
from .structure.gravity.budget import build_budget as build_budget
from .structure.gravity.compare_modes import compare_modes as compare_modes
from .structure.gravity.path import follow_gravity as follow_gravity
from .structure.model.article import (
    Damping as Damping,
    LoadCase as LoadCase,
    Structure as Structure,
)
from .structure.model.clamps import Clamp as Clamp
from .structure.model.environment import Environment as Environment
from .structure.modes.craig_bampton import reduce_structure as reduce_structure
from .structure.modes.solve import (
    Modes as Modes,
    solve_modes as solve_modes,
)
from .structure.plants.whirl_modes import solve_gyroscopic_modes as solve_gyroscopic_modes
from .structure.plants.modal_plant import build_plant as build_plant
from .structure.rest.equilibrium import (
    Equilibrium as Equilibrium,
    solve_equilibrium as solve_equilibrium,
)
from .structure.sensitivity.frequency_derivatives import (
    differentiate_frequencies as differentiate_frequencies,
)
from .structure.hanging.levelling import level as level
from .systems.delay.delay_approximation import approximate_delays as approximate_delays
from .systems.plants.plant_from_matrices import make_plant as make_plant
from .systems.plants.plant import (
    delay_plant as delay_plant,
    Plant as Plant,
    remove_delays as remove_delays,
)
from .systems.plants.response import (
    evaluate_plant as evaluate_plant,
    FrequencyResponse as FrequencyResponse,
)
from .systems.sampling.sampled_plant import sample_plant as sample_plant
from .updating.orbit.predicted_frequencies import predict_modes as predict_modes
from .updating.promise.plan import Plan as Plan
from .updating.promise.promise import promise as promise
from .updating.refinement.refine import refine as refine
from .updating.residuals.surveys import Survey as Survey
from .updating.unknowns.unknowns import Unknown as Unknown
from . import (
    campaign as campaign,
    control as control,
    files as files,
    identification as identification,
    laboratory as laboratory,
    plot as plot,
    realtime as realtime,
    signals as signals,
    structure as structure,
    systems as systems,
    updating as updating,
)

__version__: str
__all__: list[str]
