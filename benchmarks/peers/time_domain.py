"""Linear models of one record by packages that work on samples; needs them and nothing of this package.

    python benchmarks/peers/time_domain.py IN.npz OUT.npz

IN: tool (nfoursid, sippy-n4sid, sippy-moesp, sippy-cva or jax-sysid), u (sample, input), y (sample, output),
states, block_rows (of the subspace methods). OUT: A, B, C, D of x[k+1] = A x + B u, y = C x + D u, seconds,
version.
"""

from __future__ import annotations

import importlib.metadata
import sys
import time

import numpy as np


def by_nfoursid(u: np.ndarray, y: np.ndarray, states: int, rows: int) -> tuple[np.ndarray, ...]:
    import pandas
    from nfoursid.nfoursid import NFourSID

    names_u, names_y = ([f"{c}{k}" for k in range(x.shape[1])] for c, x in (("u", u), ("y", y)))
    frame = pandas.DataFrame(np.hstack([u, y]), columns=[*names_u, *names_y])
    found = NFourSID(frame, output_columns=names_y, input_columns=names_u, num_block_rows=rows)
    found.subspace_identification()
    system, _ = found.system_identification(rank=states)
    return system.a, system.b, system.c, system.d


def by_sippy(u: np.ndarray, y: np.ndarray, states: int, rows: int, method: str) -> tuple[np.ndarray, ...]:
    from sippy_unipi import system_identification

    found = system_identification(
        y.T, u.T, method, SS_fixed_order=states, SS_f=rows, SS_p=rows, SS_D_required=True
    )
    return found.A, found.B, found.C, found.D


def by_jax_sysid(u: np.ndarray, y: np.ndarray, states: int) -> tuple[np.ndarray, ...]:
    import jax
    from jax_sysid.models import LinearModel

    jax.config.update("jax_enable_x64", True)
    scale_u, scale_y = u.std(axis=0), y.std(axis=0)
    model = LinearModel(states, y.shape[1], u.shape[1], feedthrough=True, seed=0)
    model.loss(rho_x0=1e-6, rho_th=1e-6)
    model.optimization(adam_epochs=1000, lbfgs_epochs=2000)
    model.fit(y / scale_y, u / scale_u)
    A, B, C, D = (np.asarray(x, dtype=float) for x in model.ssdata())
    return A, B / scale_u, scale_y[:, None] * C, scale_y[:, None] * D / scale_u


PACKAGES = {"nfoursid": "nfoursid", "sippy": "sippy_unipi", "jax": "jax-sysid"}


def main(source: str, target: str) -> None:
    with np.load(source, allow_pickle=False) as given:
        u, y, states = given["u"], given["y"], int(given["states"])
        tool, rows = str(given["tool"]), int(given["block_rows"])
    package, _, method = tool.partition("-")
    begun = time.process_time()
    if package == "nfoursid":
        A, B, C, D = by_nfoursid(u, y, states, rows)
    elif package == "sippy":
        A, B, C, D = by_sippy(u, y, states, rows, {"n4sid": "N4SID", "moesp": "MOESP", "cva": "CVA"}[method])
    else:
        A, B, C, D = by_jax_sysid(u, y, states)
    seconds = time.process_time() - begun
    version = importlib.metadata.version(PACKAGES[package])
    np.savez(target, A=A, B=B, C=C, D=D, seconds=seconds, version=np.array(version))


if __name__ == "__main__":
    main(*sys.argv[1:])
