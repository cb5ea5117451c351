"""Stability, margins and worst cases of loops with exact delays, continuous or sampled."""

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, form_loop
from middeck.control.analysis.margins.disk import DiskMargin, measure_disk_margin
from middeck.control.analysis.margins.margins import LoopMargins, Margins, Peak, measure_margins
from middeck.control.analysis.margins.return_ratio import ReturnRatio, trace_return_ratio
from middeck.control.analysis.rms.rms import measure_metric, measure_rms
from middeck.control.analysis.shifts.inversion import Inversion, find_inversion
from middeck.control.analysis.shifts.shifts import AllowedShift, find_allowed_shifts
from middeck.control.analysis.shifts.worst_case import WorstCase, find_worst_case
from middeck.control.analysis.stability.stability import LoopStability, decide_stability

__all__ = [
    "AllowedShift",
    "DiskMargin",
    "FeedbackLoop",
    "Inversion",
    "LoopMargins",
    "LoopStability",
    "Margins",
    "Peak",
    "ReturnRatio",
    "WorstCase",
    "decide_stability",
    "find_allowed_shifts",
    "find_inversion",
    "find_worst_case",
    "form_loop",
    "measure_disk_margin",
    "measure_margins",
    "measure_metric",
    "measure_rms",
    "trace_return_ratio",
]
