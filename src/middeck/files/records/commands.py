"""Commands for a rig: the samples of a designed excitation, as CSV or NPZ."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from middeck.errors import ConfigError
from middeck.files.disk.atomic import replacing
from middeck.signals.excitation.signal import Excitation, repeat_periods
from middeck.signals.ports import Port

SCHEMA = "middeck.command/1"


def write_command(
    path: str | Path, excitation: Excitation, periods: int, inputs: Sequence[Port]
) -> tuple[Path, ...]:
    """Write so many periods of each experiment, each file whole or not at all; returns what was written.

    NPZ: one file with ``u`` (experiment, period, sample, input), ``sample_hz``, ``lines``, ``kind``, ``what``
    and names and units of the inputs. CSV: ``time [s],u:name [unit]`` and a row for each sample, one file
    for each experiment (``-1``, ``-2``, ... before the ending). Raises `ConfigError` for another ending or
    ports that are not as many as inputs.
    """
    target = Path(path)
    if len(inputs) != excitation.u.shape[2]:
        raise ConfigError(f"{len(inputs)} names for {excitation.u.shape[2]} inputs", hint="one for each")
    u = repeat_periods(excitation, periods)
    match target.suffix.lower():
        case ".npz":
            return (_write_npz(target, excitation, u, inputs),)
        case ".csv":
            return tuple(
                _write_csv(_numbered(target, e, len(u)), excitation.sample_hz, u[e], inputs)
                for e in range(len(u))
            )
        case _:
            raise ConfigError(f"no writer for {target.suffix!r} files", where=str(path), hint=".csv or .npz")


def _numbered(target: Path, experiment: int, experiments: int) -> Path:
    if experiments == 1:
        return target
    return target.with_name(f"{target.stem}-{experiment + 1}{target.suffix}")


def _write_npz(target: Path, excitation: Excitation, u: np.ndarray, inputs: Sequence[Port]) -> Path:
    with replacing(target) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            schema=np.str_(SCHEMA),
            u=u,
            sample_hz=np.float64(excitation.sample_hz),
            lines=excitation.lines,
            kind=np.str_(excitation.kind),
            what=np.str_(excitation.what),
            input_names=np.array([p.name for p in inputs]),
            input_units=np.array([p.unit for p in inputs]),
        )
    return target


def _write_csv(target: Path, sample_hz: float, u: np.ndarray, inputs: Sequence[Port]) -> Path:
    rows = u.reshape(-1, u.shape[2])
    table = np.column_stack([np.arange(len(rows)) / sample_hz, rows])
    header = ",".join(["time [s]", *(f"u:{p.name} [{p.unit}]" for p in inputs)])
    with replacing(target) as temporary:
        # 17 digits: what is read back is what was designed.
        np.savetxt(temporary, table, fmt="%.17g", delimiter=",", header=header, comments="")
    return target
