"""Vector fitting by scikit-rf on a response handed over as npz; needs scikit-rf and nothing of this package.

    python benchmarks/peers/scikit_rf.py IN.npz OUT.npz

IN: frequency_hz, H (line, output, input), poles (their number), at_hz. OUT: H at ``at_hz``, seconds (of the
CPU), version.
"""

from __future__ import annotations

import sys
import time
import warnings

import numpy as np
import skrf
from skrf.vectorFitting import VectorFitting


def main(source: str, target: str) -> None:
    given = np.load(source, allow_pickle=False)
    H, poles = given["H"], int(given["poles"])
    side = max(H.shape[1:])
    # The tool takes square networks; entries are fitted as they come, scaled to one.
    scale = np.sqrt(np.mean(np.abs(H) ** 2, axis=(0, 2)))
    square = np.zeros((len(H), side, side), dtype=complex)
    square[:, : H.shape[1], : H.shape[2]] = H / scale[:, None]
    network = skrf.Network(f=given["frequency_hz"], s=square, f_unit="Hz")
    fit = VectorFitting(network)
    begun = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit.vector_fit(n_poles_real=0, n_poles_cmplx=poles // 2, init_pole_spacing="lin")
    seconds = time.process_time() - begun
    found = np.zeros((len(given["at_hz"]), *H.shape[1:]), dtype=complex)
    for o in range(H.shape[1]):
        for i in range(H.shape[2]):
            found[:, o, i] = scale[o] * fit.get_model_response(o, i, given["at_hz"])
    np.savez(target, H=found, seconds=seconds, version=np.array(skrf.__version__))


if __name__ == "__main__":
    main(*sys.argv[1:])
