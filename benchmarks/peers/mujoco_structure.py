"""Rest state and lowest modes of the suspended bus in MuJoCo; needs mujoco, scipy, nothing of this package.

    python benchmarks/peers/mujoco_structure.py IN.npz OUT.json

IN: ``elements_per_half`` and ``modes``, their number. OUT: wall and CPU seconds of building, rest state and
modes, peak memory, frequencies, version.

The model is that of the cross-check, rigid slices of tube with six spring joints between neighbours. MuJoCo
solves neither statics nor modes: Newton's method, differences of its generalised force and a dense
eigensolution are ours, so that these times say little of MuJoCo. A lattice is outside of what it is made for:
its coordinates are those of a tree, and every closed loop would be a soft constraint that its solver
regularises, about 4 of 5 struts of the boom.
"""

from __future__ import annotations

import importlib.metadata
import json
import resource
import sys
import time
from pathlib import Path

import numpy as np
import scipy.linalg as sla

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "cross"))
from suspended_bus import case, mujoco_bus


def main(source: str, target: str) -> None:
    with np.load(source, allow_pickle=False) as archive:
        elements, count = int(archive["elements_per_half"]), int(archive["modes"])
    clock, cpu = [time.perf_counter()], [time.process_time()]

    def lap() -> None:
        clock.append(time.perf_counter())
        cpu.append(time.process_time())

    bus = mujoco_bus.Bus(mujoco_bus.build(case.VARIANTS["bare_1g"], elements))
    lap()
    n = bus.model.nv
    q = bus.rest(bus.data.qpos.copy(), np.arange(n))
    lap()
    K = bus.tangent(q)
    mu = sla.eigh(bus.mass(q), 0.5 * (K + K.T), eigvals_only=True, subset_by_index=(n - count, n - 1))
    lap()
    stages = ("build", "equilibrium", "modes")
    result = {
        "version": importlib.metadata.version("mujoco"),
        "seconds": dict(zip(stages, np.diff(clock).tolist(), strict=True)),
        "cpu_seconds": dict(zip(stages, np.diff(cpu).tolist(), strict=True)),
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "dof": n,
        "frequency_hz": (np.sqrt(1.0 / mu[::-1]) / (2.0 * np.pi)).tolist(),
    }
    Path(target).write_text(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:])
