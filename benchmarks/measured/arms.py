"""The two real arms: fitted to the first half of their samples, the second half simulated."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from measured.rows import cell, peer, row
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.simulate_record import record_nrmse
from middeck.signals.ports import Port
from middeck.signals.record import Record

# benchmark-cases: the initial state is fitted on a quarter of the validation half. Rates are not stated.
STATE_SHARE, SAMPLE_HZ = 0.25, 1.0
# Block rows of the peers that need them: the better of two.
BLOCK_ROWS = (15, 30)
PEERS = {
    "nfoursid": "nfoursid",
    "SIPPY N4SID": "sippy-n4sid",
    "SIPPY MOESP": "sippy-moesp",
    "SIPPY CVA": "sippy-cva",
    "jax-sysid": "jax-sysid",
}
ROBOT_ORDERS = (6, 8, 10)
CD_LEVELS, CD_STATES = (25.0, 18.0), 12
# The best peer that was seen [%] before: a run with worse ones asks for no less.
PEER_SEEN = 2.41


def rows(data: Path, python: str | None) -> list[dict[str, Any]]:
    """Errors of the simulation of the second half; ``data`` is the folder of the data sets."""
    return [*_robot(data, python), *_cd_player(data, python)]


def load(data: Path, arm: str, inputs: int) -> tuple[Record, Record]:
    """Both halves, less the means of the first; the file has a column for each input, then each output."""
    table = scipy.io.loadmat(data / f"daisy_{arm.lower()}" / f"{arm}_dat.mat")[f"{arm}_dat"]
    half = len(table) // 2
    u, y = np.hsplit(table - table[:half].mean(axis=0), [inputs])
    ports = [
        tuple(Port(f"{name}{k + 1}", "1") for k in range(x.shape[1])) for name, x in (("u", u), ("y", y))
    ]
    first, second = (
        Record(
            sample_hz=SAMPLE_HZ,
            u=u[None, None, part],
            y=y[None, None, part],
            inputs=ports[0],
            outputs=ports[1],
            periodic=False,
        )
        for part in (slice(0, half), slice(half, None))
    )
    return first, second


def _robot(data: Path, python: str | None) -> list[dict[str, Any]]:
    case, halves = "arms robot", load(data, "robot_arm", 1)
    peers = _peers(python, halves, ROBOT_ORDERS)
    level = 1.1 * min([PEER_SEEN, *(one["value"] for one in peers[0].values())])
    note = (
        f"held out; level: 1.1 times the best peer, {PEER_SEEN} % or less;"
        f" each peer at its best of {ROBOT_ORDERS} states there"
    )
    return [
        *_ours(case, halves, None, (level,), peers, f"order by the program; {note}"),
        *_ours(f"{case}, order by hand", halves, ROBOT_ORDERS[-1], (level,), peers, note),
    ]


def _cd_player(data: Path, python: str | None) -> list[dict[str, Any]]:
    case, halves = "arms CD player", load(data, "CD_player_arm", 2)
    peers = _peers(python, halves, (CD_STATES,))
    note = f"held out; peers at {CD_STATES} states"
    return [
        *_ours(case, halves, None, CD_LEVELS, peers, f"order by the program; {note}"),
        *_ours(f"{case}, order by hand", halves, CD_STATES, CD_LEVELS, peers, note),
    ]


def _ours(
    case: str,
    halves: tuple[Record, Record],
    states: int | None,
    levels: tuple[float, ...],
    peers: list[dict[str, Any]],
    note: str,
) -> list[dict[str, Any]]:
    begun = time.process_time()
    model = fit_record(halves[0], states=states, sampled=True).model
    seconds = time.process_time() - begun
    errors = 100.0 * record_nrmse(model, halves[1], state_share=STATE_SHARE)
    of = [f" of output {o + 1}" if len(errors) > 1 else "" for o in range(len(errors))]
    return [
        *(
            row(
                case,
                f"NRMSE{of[o]}",
                "%",
                errors[o],
                levels[o],
                states=model.states,
                peers=peers[o],
                note=note,
            )
            for o in range(len(errors))
        ),
        row(case, "time of the fit", "CPU s", seconds, states=model.states),
    ]


def _peers(
    python: str | None, halves: tuple[Record, Record], orders: tuple[int, ...]
) -> list[dict[str, dict[str, Any]]]:
    """The peers' columns for each output, each peer with the settings that are best on the second half."""
    columns: list[dict[str, dict[str, Any]]] = [{} for _ in halves[1].outputs]
    for name, tool in PEERS.items() if python else ():
        rows_tried = BLOCK_ROWS if tool != "jax-sysid" else BLOCK_ROWS[:1]
        tried = [_by_peer(python, tool, halves, n, rows) for n in orders for rows in rows_tried]
        found, errors = min(tried, key=lambda one: float(np.mean(one[1])))
        for column, error in zip(columns, errors, strict=True):
            column |= cell(name, found, error)
    return columns


def _by_peer(
    python: str | None, tool: str, halves: tuple[Record, Record], states: int, rows: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """What a peer answers, and the error [%] of each output of the second half."""
    first, second = halves
    found = peer(python, "time_domain.py", tool=tool, u=first.u[0, 0], y=first.y[0, 0], states=states,
                 block_rows=rows)  # fmt: skip
    assert found is not None
    A, B, C, D = (found[k] for k in "ABCD")
    return found, 100.0 * _simulation_error(A, B, C, D, second.u[0, 0], second.y[0, 0])


def _simulation_error(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, u: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """NRMSE with the state fitted on the first quarter; a model that is barely unstable has one too."""
    x, view = np.zeros(len(A)), C
    forced, free = np.empty(y.shape), np.empty((*y.shape, len(A)))
    for k in range(len(u)):
        forced[k], free[k] = C @ x + D @ u[k], view
        x, view = A @ x + B @ u[k], view @ A
    used = int(np.ceil(STATE_SHARE * len(y)))
    level = np.sqrt(np.mean(y**2, axis=0))
    left = ((y - forced)[:used] / level).ravel()
    state = np.linalg.lstsq((free[:used] / level[:, None]).reshape(-1, len(A)), left, rcond=None)[0]
    return np.sqrt(np.mean((y - forced - free @ state) ** 2, axis=0)) / level
