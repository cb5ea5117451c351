"""python-control with slycot on the frequency response of in.npz: median CPU seconds and the answer.

python control_response.py IN.npz OUT.npz     needs control, slycot
"""

from __future__ import annotations

import sys
import time

import numpy as np
import slycot

import control


def main() -> None:
    with np.load(sys.argv[1]) as given:
        system = control.ss(given["A"], given["B"], given["C"], given["D"])
        omega, repeats = given["omega"], int(given["repeats"])
    control.frequency_response(system, omega[:2])  # imports and first calls apart
    times = []
    for _ in range(repeats):
        start = time.process_time()
        found = control.frequency_response(system, omega)
        times.append(time.process_time() - start)
    H = np.moveaxis(np.asarray(found.complex if hasattr(found, "complex") else found.fresp), 2, 0)
    version = f"{control.__version__} (slycot {slycot.__version__})"
    np.savez(sys.argv[2], seconds=np.median(times), H=H, version=version)


if __name__ == "__main__":
    main()
