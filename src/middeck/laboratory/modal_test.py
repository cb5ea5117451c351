"""A modal test on a rig: every motor driven in several experiments, every sensor read."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.control.law.pd_loops import PDLoops
from middeck.errors import NumericalError
from middeck.laboratory.article_rig import build_article_rig
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.laboratory.rig_settings import RigSettings
from middeck.laboratory.tested_article import RigArticle
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.record import Record
from middeck.values import record

SETTLE = 2  # unrecorded periods of an experiment


@record(kw_only=True)
class ModalTest:
    """A modal test: one experiment for each motor, and one more at a smaller drive.

    Two drives distinguish friction from the structure.

    Attributes:
        torque_nm: Rms of each motor's command.
        weaker: Drive of the last experiment, as a share.
        period_s, periods: Period of the multisines, and how many periods of each are recorded.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    torque_nm: Float[np.ndarray, " input"]
    weaker: float
    band_hz: tuple[float, float]
    period_s: float
    periods: int


def take_modal_test(
    article: RigArticle,
    settings: RigSettings,
    test: ModalTest,
    rng: np.random.Generator,
    inner: PDLoops | None = None,
) -> Record:
    """The record of all experiments on the rig of ``article``, held by its analogue loops ``inner``.

    Raises `NumericalError` where an experiment is stopped.
    """
    rig = build_article_rig(article, settings, inputs=test.inputs, outputs=test.outputs, inner=inner)
    limits = [Limits(rms=float(rms)) for rms in test.torque_nm]
    drives = design_multisine(
        test.band_hz, test.period_s, settings.sample_hz, limits, rng, inputs=len(test.inputs)
    ).u
    taken = [_take(rig, u, settings, test, rng) for u in (*drives, test.weaker * drives[0])]
    u, y = (np.concatenate([getattr(one, side) for one in taken]) for side in ("u", "y"))
    return dataclasses.replace(taken[0], u=u, y=y)


def _take(
    rig: Rig, u: np.ndarray, settings: RigSettings, test: ModalTest, rng: np.random.Generator
) -> Record:
    run = run_open_loop(rig, u, periods=test.periods, rng=rng, settle=SETTLE, rest_s=settings.rest_s)
    if run.record is None:
        raise NumericalError(run.cause, where="modal test", hint="a smaller drive, or a motor that can hold")
    return run.record
