"""Write the files of this folder with pyuff (2.5.8), which the package does not need: python make_uff.py

Two experiments of a force and an acceleration at 1024 Hz, and responses of two points, in ASCII and binary.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyuff

HERE = Path(__file__).parent
HZ, SAMPLES, LINES = 1024.0, 40, 12


def signals():
    """force[experiment, sample], acceleration likewise, H[line, output]; drawn from one seed."""
    rng = np.random.default_rng(58)
    force, acceleration = rng.standard_normal((2, 2, SAMPLES))
    return force, acceleration, rng.standard_normal((LINES, 2)) + 1j * rng.standard_normal((LINES, 2))


def write(name, sets):
    path = HERE / name
    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    for data in sets:
        file._write_set(data, "add")


def common(binary, even):
    return {
        "binary": binary,
        "abscissa_spacing": even,
        "rsp_ent_name": "NONE",
        "ref_ent_name": "NONE",
        "rsp_dir": -3,
        "ref_dir": 3,
        "ref_node": 1,
    }


def main():
    force, acceleration, H = signals()
    time, hz = np.arange(SAMPLES) / HZ, 2.0 + 0.5 * np.arange(LINES)
    for binary, kind in ((0, "ascii"), (1, "binary")):
        channels = ((force, 1, 13, "N", "force"), (acceleration, 2, 12, "m/s^2", "tip"))
        write(
            f"time-{kind}.uff",
            [
                pyuff.prepare_58(
                    **common(binary, 1), func_type=1, rsp_node=node, data=x[e], x=time, id1=name,
                    abscissa_spec_data_type=17, ordinate_spec_data_type=quantity, orddenom_spec_data_type=0,
                    ordinate_axis_units_lab=unit,
                )
                for e in range(2)
                for x, node, quantity, unit, name in channels
            ],
        )  # fmt: skip
        for even in (0, 1):
            write(
                f"response-{kind}-{'even' if even else 'uneven'}.uff",
                [
                    pyuff.prepare_58(
                        **common(binary, even), func_type=4, rsp_node=node, data=H[:, k], x=hz, id1="H",
                        abscissa_spec_data_type=18, ordinate_spec_data_type=12, orddenom_spec_data_type=13,
                        ordinate_axis_units_lab="m/s^2", orddenom_axis_units_lab="N",
                    )
                    for k, node in enumerate((1, 2))
                ],
            )  # fmt: skip


if __name__ == "__main__":
    main()
