"""Modal parameters followed on streaming data: blocks of samples in, a new frozen state out.

state = start_tracking(fitted.model, sample_hz=256.0, noise_rms=noise)
state = update_tracking(state, u_block, y_block)
state.natural_hz, state.frequency_std_hz, state.trusted
"""

from middeck.identification.tracking.history import Tracked, track_modes
from middeck.identification.tracking.kalman_filter import update_tracking
from middeck.identification.tracking.tracked_state import Drift, Tracking, start_tracking

__all__ = ["Drift", "Tracked", "Tracking", "start_tracking", "track_modes", "update_tracking"]
