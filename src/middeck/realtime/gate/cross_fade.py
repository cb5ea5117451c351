"""The cross-fade from the law that is engaged to the one that takes over, closed on every model."""

import dataclasses
import math
from collections.abc import Iterator, Mapping

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.settings import EngineSettings
from middeck.realtime.gate.linear_law import faded_laws
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_on_rig import package_settings
from middeck.realtime.gate.steps_without_rig import FADES, GateMargins, GateStep, Tried, check_loops
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.reference import fade_at
from middeck.systems.plants.plant import Plant


def check_cross_fade(
    engaged: ControllerPackage,
    package: ControllerPackage,
    models: Mapping[str, Plant],
    least: GateMargins,
    engine: EngineSettings | None = None,
    share: float = 1.0,
) -> Iterator[GateStep]:
    """While ``engaged`` fades out and ``package`` in, the loop with each model is stable with margin.

    From full authority of one to that of the other, and to a ``share`` of it, at eleven points of either
    fade, beside the hold of the ``engine``; without one, by the times of an engine's default settings. A step
    for each model, as it ends.
    """
    try:
        plain = package_settings(package) if engine is None else engine
        fits = dataclasses.replace(package_settings(engaged), period_s=plain.period_s)
        first = with_hold(engaged, fits if engine is None else dataclasses.replace(engine, hold=()))
        second = with_hold(package, plain)
        faded = faded_laws([first, second])
        tried = [
            Tried(
                f"{engaged.name} at {leaves:.3g}, {package.name} at {rises:.3g}",
                faded([leaves, rises]),
            )
            for top in sorted({share, 1.0})
            for leaves, rises in fade_points(engaged.ramp, package.ramp, plain, top)
        ]
    except ConfigError as error:
        said = f"{error.what}: {error.hint}"
        yield GateStep(name=f"cross-fade from {engaged.name}", passed=False, said=said)
        return
    for name, plant in models.items():
        yield check_loops(f"cross-fade from {engaged.name} on {name}", plant, tried, least)


def fade_points(
    leaves: int, rises: int, settings: EngineSettings, share: float = 1.0
) -> list[tuple[float, float]]:
    """Fades of the law that leaves and of the one that rises, where either is at a tenth of its authority.

    Args:
        leaves, rises: Samples of their own ramps.
        settings: Settings of the engine: its least ramp, and its longest way out.
        share: Share of full authority to which the second rises on its ramp.

    Eleven points for ramps of one length.
    """
    least, most = settings.fade_samples
    fall, rise = min(max(leaves, least), most), max(rises, least)
    # Where a fade is a tenth, two tenths ...: `fade_at` inverted.
    parts = [0.5 - math.sin(math.asin(1.0 - 2.0 * fade) / 3.0) for fade in FADES]
    times = sorted({round(part * length, 6) for part in parts for length in (fall, rise)})
    return [(1.0 - fade_at(min(time / fall, 1.0)), fade_at(min(time / rise, share))) for time in times]
