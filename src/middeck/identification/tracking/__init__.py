"""Modal parameters followed on streaming data: blocks of samples in, a new frozen state out.

state = start_tracking(fitted.model, sample_hz=256.0, noise_rms=noise)
state = update_tracking(state, u_block, y_block)
state.natural_hz, state.frequency_std_hz, state.trusted
"""
