"""Pack the CubeSpec mirror data: python data/cubespec-fsm/make.py SOURCE_FOLDER

SOURCE_FOLDER holds {u,y}_300mV_{train,test}.npy of the original set, each (sample, channel, realisation,
period). Writes mirror-300mV-{train,test}.npz beside this file in the layout of this package's records:
u (experiment, period or 1, sample, input), y (experiment, period, sample, output), single precision.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
SAMPLE_HZ = 6400.0


def pack(source: Path, part: str) -> Path:
    """Write one part ("train" or "test"); the two periods of u are kept only if they differ."""
    u, y = (
        np.load(source / f"{signal}_300mV_{part}.npy", allow_pickle=False).transpose(2, 3, 0, 1)
        for signal in "uy"
    )
    if np.array_equal(u[:, :1], u[:, 1:]):
        u = u[:, :1]
    target = HERE / f"mirror-300mV-{part}.npz"
    np.savez_compressed(
        target,
        schema=np.int64(1),
        sample_hz=np.float64(SAMPLE_HZ),
        periodic=np.bool_(True),
        u=u.astype(np.float32),
        y=y.astype(np.float32),
        input_names=np.array(["piezo_1", "piezo_2", "piezo_3"]),
        input_units=np.array(["V"] * 3),
        output_names=np.array(["position_1", "position_2", "position_3"]),
        output_units=np.array(["m"] * 3),
    )
    return target


if __name__ == "__main__":
    for name in ("train", "test"):
        written = pack(Path(sys.argv[1]), name)
        print(f"{written.name}: {written.stat().st_size / 1e6:.2f} MB")
