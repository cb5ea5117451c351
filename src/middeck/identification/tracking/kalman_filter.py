"""The recursion: an extended Kalman filter on modal states and the parameters that move them.

Without noise of their own the modal states are those of an output-error model, and the covariance between
them and the parameters carries the derivative of the output by the parameters from sample to sample: the
filter is the recursive prediction-error method of that model (Ljung and Soderstrom 1983, section 3.8), which
does not have the bias of a filter that takes its gain for constant (Ljung 1979).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.identification.tracking import lag, loss_and_restart
from middeck.identification.tracking.one_period import poles_at, step_modes
from middeck.identification.tracking.tracked_state import Followed, Tracking, log_places, motion_deviation

# An innovation pulls no further than so many of its deviations: a spike is no news.
CLIPPED = 5.0
# Corrections of one parameter are summed over this time [s]; by chance their sum stays within so many of its
# deviations, but for once in 150,000 times.
SUMMED_S = 4.0
JUMPED = 4.5
# Part of a mode's motion that is not known when it is found to have jumped: radians of phase.
LOST_PHASE = 0.5
# Modes nearer than this in log frequency are found again together: one alone would take the other's place.
NEAR = 0.1
# Samples between two looks at the sums.
LOOK = 16


def update_tracking(
    state: Tracking, u: Float[np.ndarray, "sample input"], y: Float[np.ndarray, "sample output"]
) -> Tracking:
    """The state after a block of samples: ``y[k]`` is taken when ``u[k]`` is issued.

    A sample of ``y`` that is not finite on all channels is taken as lost and passed over. Raises `DataError`
    for inputs that are not finite or blocks of other sizes.
    """
    followed = state.followed
    u, y = np.asarray(u, dtype=float), np.asarray(y, dtype=float)
    inputs, outputs = followed.participation.shape[1], len(followed.noise_rms)
    if u.ndim != 2 or u.shape[1] != inputs or y.shape != (len(u), outputs):
        raise DataError(
            f"a block of {u.shape} inputs and {y.shape} outputs",
            hint=f"as many samples of {inputs} inputs as of {outputs} outputs",
        )
    if not np.isfinite(u).all():
        raise DataError("inputs are not finite", hint="issued commands are known; fill them in")
    work = _Work(state)
    lost = np.isnan(np.sum(0.0 * y, axis=1))  # 0 times anything not finite
    for k in range(len(u)):
        work.take_input(u[k])
        if not lost[k]:
            work.correct(y[k])
        work.predict()
        if (state.samples + k) % LOOK == 0:
            work.look_for_jumps()
            work.look_for_lag()
            work.look_for_loss(state.samples + k + 1)
    return work.frozen(state, len(u))


class _Work:
    """Arrays of one block, changed in place; nothing of it outlives the call."""

    def __init__(self, state: Tracking) -> None:
        self.followed = followed = state.followed
        self.modes, self.groups = len(followed.poles), len(followed.whole)
        self.outputs = len(followed.noise_rms)
        self.x, self.cov = state.mean.copy(), state.covariance.copy()
        self.past = state.past.copy()
        self.sums, self.chance = state.corrections.copy(), state.chance.copy()
        self.lag = state.lag.copy()
        self.products, self.late = state.products.copy(), state.late.copy()
        self.weight, self.jumps = state.weight, state.jumps.copy()
        self.recovery = state.recovery
        self.brief, self.brief_weight = state.recovery.products.copy(), state.recovery.weight
        self.loudness = state.recovery.loudness.copy()
        self.blocks, self.seen = state.recovery.blocks.copy(), state.recovery.seen
        self.poles: np.ndarray | None = None  # poles at the present parameters, once computed
        self._places(followed)
        self.forget = np.exp(-followed.T / SUMMED_S)

    def _places(self, followed: Followed) -> None:
        n, size = self.modes * self.groups, len(self.x)
        self.states, self.logs = n, slice(2 * n, 2 * n + 2 * self.modes)
        self.gains = slice(2 * n + 2 * self.modes, size)
        self.F = np.eye(size)
        self.H = np.zeros((self.outputs, size))
        self.R = np.diag(followed.noise_rms**2)
        drift = followed.drift
        self.Q = np.zeros(size)
        self.Q[self.logs] = followed.T * np.repeat([drift.frequency**2, drift.damping**2], self.modes)
        self.Q[self.gains] = followed.T * drift.gain**2
        self.diagonal = np.arange(size)
        self.real, self.imaginary = np.arange(n), n + np.arange(n)
        mode = np.tile(np.arange(self.modes), self.groups)
        self.omega_of, self.zeta_of = 2 * n + mode, 2 * n + self.modes + mode
        output, m = np.indices((self.outputs, self.modes))
        self.row = output
        self.at = followed.group[output] * self.modes + m
        self.omega_at, self.zeta_at = 2 * n + m, 2 * n + self.modes + m
        self.gain_at = self.gains.start + output * self.modes + m
        self.times = (
            followed.T,
            (1.0 - followed.part)[:, None] * followed.T,
            followed.part[:, None] * followed.T,
        )
        self.bT = followed.participation.T
        self.held = np.imag(followed.poles)
        self.now = followed.whole + (followed.part > 0.0)

    def take_input(self, u: np.ndarray) -> None:
        self.past[1:] = self.past[:-1]
        self.past[0] = u
        self.loudness += (u * u - self.loudness) / loss_and_restart.MEMORY

    def correct(self, y: np.ndarray) -> None:
        followed, n = self.followed, self.states
        logs = self.x[self.logs].reshape(2, self.modes)
        poles = poles_at(logs[0], logs[1])[0] if self.poles is None else self.poles
        z = (self.x[:n] + 1j * self.x[n : 2 * n])[self.at]
        unit = followed.shapes
        if followed.real_constants:
            unit = unit * (self.held / np.imag(poles))
        gain = 1.0 + self.x[self.gains].reshape(self.outputs, self.modes)
        c = unit * gain
        part = 2.0 * np.real(unit * z)
        H = self.H
        H[self.row, self.at] = 2.0 * np.real(c)
        H[self.row, self.at + n] = -2.0 * np.imag(c)
        H[self.row, self.gain_at] = part
        if followed.real_constants:
            # c goes with 1 / omega_d, omega_d = omega sqrt(1 - zeta^2).
            zeta2 = np.exp(2.0 * logs[1])
            H[self.row, self.omega_at] = -gain * part
            H[self.row, self.zeta_at] = gain * part * zeta2 / (1.0 - np.minimum(zeta2, 0.5))
        foreseen = np.sum(gain * part, axis=1)
        if followed.direct.any():
            foreseen = foreseen + np.sum(followed.direct * self.past[self.now[followed.group]], axis=1)
        PH = self.cov @ H.T
        before = self.cov[self.diagonal[self.logs], self.diagonal[self.logs]]
        spread = H @ PH + self.R
        # One output needs a square root only: a call of LAPACK takes longer than the rest.
        whiten = 1.0 / np.sqrt(spread) if self.outputs == 1 else np.linalg.inv(np.linalg.cholesky(spread))
        news = whiten @ (y - foreseen)
        news = np.minimum(np.maximum(news, -CLIPPED), CLIPPED)
        W = PH @ whiten.T
        move = W @ news
        self.x += move
        self.cov -= W @ W.T
        removed = np.sum(W[self.logs] ** 2, axis=1)
        lag.add(self.lag, move[self.logs], removed, before, followed.T)
        self._watch(news, move[self.logs], removed)

    def _watch(self, news: np.ndarray, move: np.ndarray, removed: np.ndarray) -> None:
        self.sums = self.forget * self.sums + move
        self.chance = self.forget**2 * self.chance + removed
        product = np.concatenate([[news @ news], self.late @ news]) / self.outputs
        self.products += (product - self.products) / loss_and_restart.MEMORY
        self.weight += (1.0 - self.weight) / loss_and_restart.MEMORY
        self.brief += (product - self.brief) / loss_and_restart.BRIEF
        self.brief_weight += (1.0 - self.brief_weight) / loss_and_restart.BRIEF
        self.blocks[0] += product
        self.seen += 1
        if self.seen % loss_and_restart.BLOCK == 0:
            self._end_block()
        self.late[1:] = self.late[:-1]
        self.late[0] = news

    def _end_block(self) -> None:
        self.blocks[1:] = self.blocks[:-1]
        self.blocks[0] = 0.0
        new = loss_and_restart.healed(self.products, self.weight, self.blocks, self.seen, self.outputs)
        if new is not None:
            self.products, self.weight = new

    def predict(self) -> None:
        n, F = self.states, self.F
        logs = self.x[self.logs].reshape(2, self.modes)
        poles, by_log = poles_at(logs[0], logs[1])
        self.poles = poles
        z = (self.x[:n] + 1j * self.x[n : 2 * n]).reshape(self.groups, self.modes)
        whole = self.followed.whole
        new, old = self.past[whole] @ self.bT, self.past[whole + 1] @ self.bT
        decay, after, slope = step_modes(z, poles, new, old, self.times)
        by = (by_log[:, None, :] * slope).reshape(2, n)
        e = np.tile(decay, self.groups)
        re, im = self.real, self.imaginary
        F[re, re] = F[im, im] = np.real(e)
        F[im, re] = np.imag(e)
        F[re, im] = -np.imag(e)
        F[re, self.omega_of], F[im, self.omega_of] = np.real(by[0]), np.imag(by[0])
        F[re, self.zeta_of], F[im, self.zeta_of] = np.real(by[1]), np.imag(by[1])
        self.x[:n], self.x[n : 2 * n] = np.real(after).ravel(), np.imag(after).ravel()
        P = F @ self.cov @ F.T
        P[self.diagonal, self.diagonal] += self.Q
        P[self.diagonal[self.logs], self.diagonal[self.logs]] += self.followed.T * self.lag[lag.DRIFT]
        # Rounding alone makes it uneven; half the sum keeps it from growing.
        self.cov = 0.5 * (P + P.T)

    def look_for_jumps(self) -> None:
        """Widen the deviations of modes whose corrections go one way, and of their neighbours."""
        away = (np.abs(self.sums) > JUMPED * np.sqrt(self.chance)).reshape(2, self.modes).any(axis=0)
        if not away.any():
            return
        logs = log_places(self.followed)
        # One that is open already is still on its way.
        still = self._is_open(logs)
        log_omega = self.x[logs[0]]
        near = np.abs(log_omega[:, None] - log_omega) < NEAR
        for m in np.flatnonzero(near[:, away & ~still].any(axis=1) & ~still):
            self._open(int(m), logs[:, m])

    def look_for_lag(self) -> None:
        """Widen the deviation of a lagging parameter by its lag, with all correlations."""
        self.lag[lag.DRIFT] *= np.exp(-LOOK * self.followed.T / lag.FORGOTTEN_S)
        if self._is_astray():
            self.lag[:] = 0.0
            return
        size = self.brief[0] / max(self.brief_weight, np.finfo(float).tiny)
        open_ = self._is_open(log_places(self.followed))
        for m in (k for k in lag.behind(self.lag[:, : self.modes], size) if not open_[k]):
            at = self.logs.start + m
            by = min(abs(lag.mean_lag(self.lag)[m]), self.followed.drift.frequency_jump)
            along = self.cov[:, at] / self.cov[at, at] * by
            self.cov += np.outer(along, along)
            self._take_lag_as_drift(m)

    def _take_lag_as_drift(self, m: int) -> None:
        """Correct the frequency alone for its lag: corrections of damping contain the lag too."""
        most = 0.0 if self._is_astray() else self.followed.drift.frequency_jump
        lag.take_as_drift(self.lag, m, most)
        self.lag[:, self.modes + m] = 0.0

    def _is_astray(self) -> bool:
        """Whether the modes are lost or not yet recovered: the innovations then show no lag."""
        large = self.brief[0] > loss_and_restart.TOO_LARGE * self.brief_weight
        return bool(large or self.recovery.lost or self.recovery.tries)

    def _is_open(self, logs: np.ndarray) -> np.ndarray:
        drift = self.followed.drift
        wide = np.array([[drift.frequency_jump**2], [drift.damping_jump**2]])
        return np.any(self.cov[logs, logs] > 0.25 * wide, axis=0)

    def _open(self, m: int, places: np.ndarray) -> None:
        drift = self.followed.drift
        self.cov[places, places] += np.array([drift.frequency_jump**2, drift.damping_jump**2])
        self._open_motion(m)
        self.sums[[m, self.modes + m]] = 0.0
        self.chance[[m, self.modes + m]] = 0.0
        self._take_lag_as_drift(m)
        self.jumps[m] += 1

    def _open_motion(self, m: int) -> None:
        """Open the modal states: predictions with the old frequency have drifted in phase."""
        places = m + self.modes * np.arange(self.groups)
        size = self.x[places] ** 2 + self.x[places + self.states] ** 2
        for at in (places, places + self.states):
            self.cov[at, at] += LOST_PHASE**2 * size

    def look_for_loss(self, samples: int) -> None:
        """Keep a good state; restart from it when the modes have been lost for long."""
        kept, T = self.recovery, self.followed.T
        lost = loss_and_restart.is_lost(self.brief, self.brief_weight)
        count = max(0, kept.lost + (LOOK if lost else -LOOK))
        self.recovery = dataclasses.replace(kept, lost=count)
        if count * T > loss_and_restart.patience(kept.tries) and loss_and_restart.is_large(
            self.blocks, self.seen
        ):
            self._restart(samples)
        elif count == 0 and loss_and_restart.is_trusted(self.products, self.weight, self.outputs):
            self._keep(samples)

    def _keep(self, samples: int) -> None:
        kept = self.recovery
        self.recovery = dataclasses.replace(kept, tries=0)
        if (samples - kept.taken[1]) * self.followed.T < loss_and_restart.PATIENCE_S:
            return
        first = self.logs.start
        mean, variance = self.x[first:], self.cov[self.diagonal[first:], self.diagonal[first:]]
        self.recovery = dataclasses.replace(
            self.recovery,
            mean=np.stack([kept.mean[1], mean]),
            variance=np.stack([kept.variance[1], variance]),
            taken=np.array([kept.taken[1], samples]),
        )

    def _restart(self, samples: int) -> None:
        """Parameters of the older good state, as uncertain as they now are; motion by the inputs."""
        kept, n, T, first = self.recovery, self.states, self.followed.T, self.logs.start
        opened = loss_and_restart.opening(kept.tries) * self.followed.drift.frequency_jump
        variance = kept.variance[0] + (samples - kept.taken[0]) * self.Q[first:]
        variance[: self.modes] += opened**2
        moving = np.tile(motion_deviation(self.followed, self.loudness) ** 2, 2 * self.groups)
        self.x, self.poles = np.concatenate([np.zeros(2 * n), kept.mean[0]]), None
        self.cov = np.diag(np.concatenate([moving, variance]))
        self.sums[:], self.chance[:], self.brief[:], self.brief_weight = 0.0, 0.0, 0.0, 0.0
        self.lag[:] = 0.0
        self.blocks, self.seen = loss_and_restart.no_blocks()
        event = loss_and_restart.Restart(samples * T, float(kept.taken[0]) * T, opened)
        self.recovery = dataclasses.replace(
            kept, lost=0, tries=kept.tries + 1, restarts=(*kept.restarts, event)
        )

    def frozen(self, state: Tracking, samples: int) -> Tracking:
        return dataclasses.replace(
            state,
            samples=state.samples + samples,
            mean=self.x,
            covariance=self.cov,
            past=self.past,
            corrections=self.sums,
            chance=self.chance,
            lag=self.lag,
            products=self.products,
            late=self.late,
            weight=self.weight,
            jumps=self.jumps,
            recovery=dataclasses.replace(
                self.recovery,
                products=self.brief,
                weight=self.brief_weight,
                loudness=self.loudness,
                blocks=self.blocks,
                seen=self.seen,
            ),
        )
