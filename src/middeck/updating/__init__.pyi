"""Names of this room that ``middeck`` itself does not have."""

from .candidates.candidate_survey import CandidateSurvey as CandidateSurvey
from .candidates.rank_tests import rank_tests as rank_tests
from .orbit.deflections import predict_deflections as predict_deflections
from .promise.draws import LoopSpread as LoopSpread
from .promise.plan import Ladder as Ladder
from .promise.slip import JointSlip as JointSlip
from .residuals.surveyed_friction import SurveyedFriction as SurveyedFriction
from .residuals.gauges import (
    Gauge as Gauge,
    GaugeKind as GaugeKind,
)
from .residuals.static_tests import StaticTest as StaticTest

__all__: list[str]
