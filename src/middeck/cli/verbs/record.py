"""``middeck record``: contents and faults of a record file, and its conversion to another kind."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, number, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.files.records import Columns
    from middeck.signals.excitation.recognition import Recognised
    from middeck.signals.fault import RecordFault

EXAMPLES = """\
  middeck record data/cubespec-fsm/mirror-300mV-test.npz -o mirror.h5
  middeck record mirror.h5 --inputs "piezo_1 [V]" \\
    --outputs "position_1 [m]" -o mirror.uff
"""


@click.command("record", cls=options.Verb, examples=EXAMPLES)
@click.argument("files", nargs=-1, required=True, metavar="RECORD...")
@options.columns
@options.periods
@click.option(
    "--reference",
    metavar="MODEL.json|RESPONSE.uff",
    help="Expected response: checks signs, gains, swapped channels and delays.",
)
@options.output("target", options.RECORDS, "Write the record too.", "RECORD")
@click.option("--ascii", is_flag=True, help="Write universal files as text (58), not binary (58b).")
@click.option("--stream", is_flag=True, help="Only write, block by block: for records longer than memory.")
@click.option("--require", is_flag=True, help="End with exit code 1 if the faults are more than notes.")
@options.common
def verb(
    files: tuple[str, ...],
    columns: options.ColumnsTyped,
    periods: int | None,
    reference: str | None,
    target: str | None,
    ascii: bool,
    stream: bool,
    require: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Show and convert records, and report their faults.

    RECORDs are .npz, .h5, .mat, .csv, .npy, universal files (.uff, .unv) or runs of the engine (.mdr, shown
    with their events); several are experiments of one test. A TOML file beside one (run.mat.toml) adds what
    the file lacks. -o converts to the kind that the ending names. --set takes sample_hz, variable and
    periods.
    """
    from middeck.cli.given.checked_options import RecordSettings, settle

    if stream:
        options.refuse_unused("beside --stream", "periods", "reference", "require", "ascii")
    given = {"sample_hz": columns.sample_hz, "variable": columns.variable or None, "periods": periods}
    chosen = settle(RecordSettings, given, overrides)
    named = columns._replace(sample_hz=chosen.sample_hz, variable=chosen.variable).named()
    if stream:
        if target is not None:
            options.require_writable(target, options.STREAMS, "--stream -o")
        _pass_through(files, named, target)
        show(as_json, {"schema": "middeck.record/1", "records": files, "written": target}, f"wrote {target}")
        return
    taken, excitation, faults = _read(files, named, chosen.periods, reference)
    document = describe(taken, excitation, faults) | {"records": files, "written": target}
    document |= _runs(files)
    if target is not None:
        from middeck.files.records import write_record

        write_record(target, taken, ascii=ascii)
    show(as_json, document, *_blocks(document))
    if require and any(f.severity != "note" for f in faults):
        click.get_current_context().exit(1)


def _pass_through(files: tuple[str, ...], named: Columns | None, target: str | None) -> None:
    from middeck.files.records import open_record, write_stream

    if target is None or len(files) != 1:
        raise ConfigError(
            "--stream writes one record to another", hint="middeck record A.csv -o B.h5 --stream"
        )
    write_stream(target, open_record(files[0], named))


def _read(
    files: tuple[str, ...], named: Columns | None, periods: int | None, reference: str | None
) -> tuple[md.Record, Recognised | None, tuple[RecordFault, ...]]:
    from middeck.cli.work.fit_records import split_each
    from middeck.files.records import join_records, read_record

    readings = [read_record(path, named) for path in files]
    whole = [r.record for r in readings]
    taken = join_records(whole if periods is None else split_each(whole, periods, files), list(files))
    with reading(*files):
        expected = None if reference is None else _expected(reference, taken)
        found = md.detect_faults(taken, expected)
        excitation = _excitation(taken)
        found += () if excitation is None else _transients(taken, excitation)
    # What the reader mended is in the samples as a gap; what it cut is not.
    mended = [f for r in readings for f in r.faults if f.kind != "gap"]
    return taken, excitation, (*mended, *found)


def _excitation(taken: md.Record) -> Recognised | None:
    """The excitation in the inputs; None where the periods are known, or samples are missing."""
    import numpy as np

    from middeck.signals.excitation.recognition import recognise_excitation

    if taken.periodic or not (np.isfinite(taken.u).all() and np.isfinite(taken.y).all()):
        return None
    return recognise_excitation(taken)


def _transients(taken: md.Record, excitation: Recognised) -> tuple[RecordFault, ...]:
    """Transients of the periods that the inputs show, as --periods would judge them."""
    from middeck.signals.excitation.repetition import blocks_of

    if excitation.period is None:
        return ()
    period, offset = excitation.period, excitation.offset
    u, y = (blocks_of(x.reshape(len(x), -1, x.shape[3]), period, 1) for x in (taken.u, taken.y))
    cut = replace(taken, u=u, y=y, periodic=True)
    return tuple(
        replace(fault, samples=tuple((a + offset, b + offset) for a, b in fault.samples))
        for fault in md.detect_faults(cut)
        if fault.kind == "transient"
    )


def _expected(reference: str, taken: md.Record) -> md.FrequencyResponse:
    """The response of a model on the lines of the record, or one from a universal file."""
    import numpy as np

    from middeck.identification.model.measurement_model import evaluate_model

    if Path(reference).suffix.lower() != ".json":
        return md.files.load_response(reference)
    model = md.files.load_model(reference)
    lines = np.fft.rfftfreq(taken.u.shape[2], 1.0 / taken.sample_hz)[1:-1]
    return evaluate_model(model, lines)


def describe(
    taken: md.Record, excitation: Recognised | None, faults: tuple[RecordFault, ...]
) -> dict[str, Any]:
    """The JSON document."""
    experiments, periods, samples, _ = taken.u.shape
    sides = (("input", taken.inputs, taken.u), ("output", taken.outputs, taken.y))
    return {
        "schema": "middeck.record/1",
        "sample_hz": taken.sample_hz,
        "experiments": experiments,
        "periods": periods,
        "samples": samples,
        "periodic": taken.periodic,
        "excitation": None if excitation is None else _recognised(excitation),
        "duration_s": periods * samples / taken.sample_hz,
        "channels": [
            _channel(side, port, x[..., k]) for side, ports, x in sides for k, port in enumerate(ports)
        ],
        "sound": all(f.severity == "note" for f in faults),
        "faults": faults,
    }


def _recognised(excitation: Recognised) -> dict[str, Any]:
    return fields(excitation, "kind", "what", "period", "periods", "offset", "steady_from", "band_hz")


def _channel(side: str, port: md.Port, x: Any) -> dict[str, Any]:
    """Port, transducer and statistics of the samples that are numbers; None where there are none."""
    import numpy as np

    from middeck.signals.ports import Channel

    channel = port.channel or Channel()
    good = x[np.isfinite(x)]
    level = float(good.mean()) if good.size else None
    swing = float(good.std()) if good.size else None
    peak = float(np.abs(good - level).max()) if good.size else None
    return {
        "side": side,
        "name": port.name,
        "unit": port.unit,
        **dataclasses.asdict(channel),
        "mean": level,
        "rms": swing,
        "peak": peak,
        "crest_factor": peak / swing if peak is not None and swing else None,
    }


def _runs(files: tuple[str, ...]) -> dict[str, Any]:
    """Start, packages and events of the files that are runs of the engine; nothing where none is."""
    from middeck.files.records.formats import RUN

    runs = [path for path in files if Path(path).suffix.lower() == RUN]
    if not runs:
        return {}

    keys = ("start", "real_time", "settings_sha256", "packages", "events")
    return {"runs": [{"record": path, **fields(md.realtime.read_run(path), *keys)} for path in runs]}


def _events(document: dict[str, Any]) -> list[str | ScreenTable]:
    shown: list[str | ScreenTable] = []
    for run in document.get("runs", ()):
        rows = [
            [str(e.sample), "TRIP" if e.trips else "", e.kind, e.channel]
            + [number(x, ".4g", "") for x in (e.value, e.limit)]
            for e in run["events"]
        ]
        clock = "real time" if run["real_time"] else "lockstep"
        shown += [
            f"{run['record']}: {clock}, started {run['start'] or 'at an unknown time'}",
            ScreenTable("events", ["sample", "", "what", "channel", "value", "limit"], rows),
        ]
    return shown


def _blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    kind = "steady periods" if document["periodic"] else "run" if document["periods"] == 1 else "periods"
    size = f"{document['experiments']} x {document['periods']} {kind} of {document['samples']} samples"
    rows = [
        [
            *(c[key] for key in ("side", "name", "unit", "node", "direction", "role")),
            *(number(c[key], ".4g", "") for key in ("mean", "rms", "peak", "crest_factor")),
            _calibration(c),
        ]
        for c in document["channels"]
    ]
    heads = ["", "channel", "unit", "node", "axis", "role", "mean", "rms", "peak", "crest", "calibration"]
    faults = [
        [f.severity, f.kind, f"{f.side} {f.channel}", number(f.experiment, "", ""), f.what]
        for f in document["faults"]
    ]
    faults_found = ScreenTable("faults", ["", "kind", "channel", "experiment", "what"], faults)
    hints = [f"  {h}" for h in dict.fromkeys(f"{f.kind}: {f.hint}" for f in document["faults"])]
    lines = [f"{size} at {document['sample_hz']:g} Hz, {document['duration_s']:.4g} s an experiment"]
    excitation = document["excitation"]
    if excitation is not None:
        lines.append(f"excited by: {excitation['what']}{_cut_by(excitation)}")
    blocks: list[str | ScreenTable] = [
        *lines,
        ScreenTable("channels (rms and peak about the mean)", heads, rows),
    ]
    blocks += _events(document)
    return [*blocks, faults_found, "\n".join(["try:", *hints])] if faults else [*blocks, "no faults found"]


def _cut_by(excitation: dict[str, Any]) -> str:
    """The option that states the periods, if the record holds nothing else."""
    steady = excitation["period"] is not None and excitation["periods"] > 1 and not excitation["offset"]
    return f"; --periods {excitation['periods']} takes them as steady" if steady else ""


def _calibration(channel: dict[str, Any]) -> str:
    if channel["gain"] is None:
        return channel["calibrated"]
    per = f"{channel['gain']:g} {channel['unit']}/{channel['raw_unit'] or '1'}"
    return f"{per} {channel['calibrated']}".rstrip()
