"""Names of this room that ``middeck`` itself does not have."""

from .engine.interface.adaptive_gain import AdaptiveGain as AdaptiveGain
from .engine.interface.settings import (
    Drive as Drive,
    EngineSettings as EngineSettings,
    SensorTest as SensorTest,
)
from .engine.process.compile import build_engine as build_engine
from .engine.process.launch import (
    DriverRig as DriverRig,
    UdpRig as UdpRig,
)
from .engine.recording.run_file import read_run as read_run
from .engine.rigs.linear_article import (
    LinearArticle as LinearArticle,
    linear_article as linear_article,
)
from .engine.rigs.engine_rig import EngineRig as EngineRig
from .engine.trials.standard_trips import guard as guard
from .engine.trials.served_rig import ServedRig as ServedRig
from .engine.trials.trial import (
    Stage as Stage,
    run_trial as run_trial,
)
from .gate.adaptive import prove_gain as prove_gain
from .gate.steps_without_rig import GateMargins as GateMargins
from .gate.steps_on_rig import (
    GateRig as GateRig,
    GateTrials as GateTrials,
)
from .package.reference import ReferenceLaw as ReferenceLaw
from .package.single_precision import to_single as to_single

__all__: list[str]
