"""Names of this room that ``middeck`` itself does not have."""

from .tested_article import (
    rig_article_plant as rig_article_plant,
    solve_rig_article as solve_rig_article,
)
from .article_rig import build_article_rig as build_article_rig
from .rig.plant.drifting_modes import (
    Drift as Drift,
    age_plant as age_plant,
    nearest_modes as nearest_modes,
)
from .rig.run_events import StopRule as StopRule
from .rig.parts.motors import Motor as Motor
from .rig.parts.sensors import (
    Encoder as Encoder,
    Gyro as Gyro,
    Sampler as Sampler,
)
from .rig.ticks.stepped import SteppedRig as SteppedRig

__all__: list[str]
