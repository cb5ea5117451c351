"""A sampled closed loop under white noise in time, by python-control's forced_response."""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

import control

given = np.load(sys.argv[1])
loop = control.ss(given["A"], given["B"], given["C"], given["D"], float(given["period_s"]))
samples, kept, seed = (int(given[name]) for name in ("samples", "kept", "seed"))
u = np.random.default_rng(seed).standard_normal((samples, loop.ninputs)).T
t = np.arange(samples) * float(given["period_s"])
times = []
for _ in range(int(given["repeats"])):
    start = time.process_time()
    answer = control.forced_response(loop, t, u)
    times.append(time.process_time() - start)
np.savez(
    sys.argv[2],
    y=answer.outputs.T[-kept:],
    seconds=np.median(times),
    peak_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    version=control.__version__,
)
