"""Figures 10 to 12 in numbers.json, with the claims."""

import numpy as np

from middeck.files.json.results import fitted_numbers, response_numbers
from middeck.identification.model.measurement_model import path_delay
from middeck.identification.plants.zeros import name_zeros
from middeck.identification.uncertainty.parameter_deviations import stated
from middeck.study.chapters.two_sensor_control.computation import ABOVE_HZ, FLEXIBLE_HZ, TwoSensorControl
from middeck.study.chapters.two_sensor_control.half_planes import EITHER, half_plane
from middeck.study.chapters.two_sensor_control.measured_sensors import MeasuredSensors, SensorZeros
from middeck.study.chapters.two_sensor_control.reach import LoopReach
from middeck.study.measured_loop.numbers_and_claims import fit_numbers, loop_numbers, prediction_claims
from middeck.study.words import Claim, Numbers, above, at_most, below, largest, row


def figure_10a(control: TwoSensorControl) -> Numbers:
    """The encoder's path of the common fit: its response, its zeros and its delay, and the poles of all."""
    return _path(control.sensors, 1)


def figure_10b(control: TwoSensorControl) -> Numbers:
    """The bus's path, and the claims on the three paths."""
    return {**_path(control.sensors, 2), "claims": figure_10_claims(control.sensors)}


def _path(sensors: MeasuredSensors, output: int) -> Numbers:
    return {
        **fitted_numbers(sensors.measured, sensors.fitted, output=output),
        "zeros": _zeros(sensors.sensors[output]),
        "mirrored_error": sensors.sensors[output].mirrored_error,
        **fit_numbers(sensors.fit, sensors.plant, sensors.fit_band_hz, output),
        "warnings": sensors.fit.warnings,
    }


def _zeros(sensor: SensorZeros) -> list[Numbers]:
    """Each zero of a path, a pair once."""
    zeros = sensor.zeros
    columns = {
        "name": name_zeros(zeros),
        "frequency_hz": zeros.frequency_hz,
        "frequency_deviation_hz": stated(sensor.frequency_deviation_hz),
        "damping": zeros.damping,
        "damping_deviation": stated(sensor.damping_deviation),
        "pair": zeros.is_pair,
        "nonminimum_phase": zeros.is_nonminimum_phase,
        "residual": zeros.residual,
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def figure_11(control: TwoSensorControl) -> Numbers:
    """The payload held by encoder and bus: the limit of each design, and the loop with the lead."""
    designs = (*control.smaller, control.without_lead, control.with_lead)
    return {
        "open_loop": response_numbers(control.sensors.measured),
        "reach": designs,
        "payload": loop_numbers(control.payload),
        "claims": figure_11_claims(control),
    }


def figure_12(control: TwoSensorControl) -> Numbers:
    """Payload and bus held together: both closed-loop responses, and cost and gain of the penalty."""
    sensors = control.sensors
    measured = control.both.measured
    bus = {
        "open_loop": response_numbers(sensors.measured, output=2),
        "predicted": response_numbers(control.both.predicted, output=2),
        "measured": None if measured is None else response_numbers(measured, output=2),
    }
    return {
        "open_loop": response_numbers(sensors.measured),
        "both": loop_numbers(control.both),
        "bus": bus,
        "bus_db_7_to_9_hz": dict(zip(("payload", "both"), control.bus_db, strict=True)),
        "payload_db_above_10_hz": dict(zip(("payload", "both"), control.above_db, strict=True)),
        "payload_db_above_10_hz_without_bus_penalty": control.above_without_bus_db,
        "payload_deeper_db_7_to_9_hz": control.deeper_db,
        "payload_deeper_db_at_mode": control.deeper_at_mode_db,
        "mode_hz": control.mode_hz,
        "claims": figure_12_claims(control),
    }


WORSE = 2.0  # 6 dB
ORDER_DB = -20.0
PAIR_HZ = (8.0, 10.0)
AT_PAIR = "{:g} to {:g}".format(*PAIR_HZ)
SUSPENSION_HZ = 1.0  # below, the modes of the suspension, which ten states do not hold
SPILLS_HZ = 15.0  # the modes from 17 Hz on, which twelve states do not hold


def figure_10_claims(sensors: MeasuredSensors) -> list[Claim]:
    """The bus needs zeros in the right half-plane where payload and encoder need none."""
    low, high = sensors.fit_band_hz
    words = [port.name for port in sensors.measured.outputs]
    sides = [
        [half_plane(z) for z in _zeros(sensor) if low <= z["frequency_hz"] <= high]
        for sensor in sensors.sensors
    ]
    wrong = [float(s.count("right")) for s in sides]
    bus = sensors.sensors[2]
    ratio = None if bus.mirrored_error is None else bus.mirrored_error / float(sensors.fit.error[2])
    off_ms = float(np.max(np.abs(path_delay(sensors.fit.model) - sensors.delay_s)) * 1e3)
    count = f"from {low:g} to {high:g} Hz; real zeros and pairs"
    refitted = "refitted with all zeros in the left half-plane, its error is"
    return [
        row(f"{words[2]}: non-minimum-phase zeros {count}", wrong[2] > 0.0, wrong[2], "\u2265 1"),
        *(
            row(
                f"{words[k]}: no non-minimum-phase zeros {count}{_open(sides[k])}",
                wrong[k] == 0.0,
                wrong[k],
                "= 0",
            )
            for k in (0, 1)
        ),
        above(f"{words[2]}: {refitted} over {WORSE:g} times as large; ratio", ratio, WORSE, ""),
        below(
            "the fitted delays agree with the rig's within 0.2 ms; largest difference [ms]", off_ms, 0.2, "ms"
        ),
    ]


def _open(sides: list[str]) -> str:
    return f"; {sides.count(EITHER)} more may lie in either half-plane" if EITHER in sides else ""


def figure_11_claims(control: TwoSensorControl) -> list[Claim]:
    """Claims: orders that fail and where, the limit with and without the lead, and the measured loop."""
    bare, lead, loop = control.without_lead, control.with_lead, control.payload
    moves = ", ".join(f"{r.percent:+g}" if r.percent else "0" for r in loop.on_rig)
    design = f"a design on {bare.states} states without lead filter"
    without = f"{design} becomes unstable near 9 Hz; unstable at [Hz]"
    short = f"{design} does not reduce the payload by 18 dB; change at its highest stable authority [dB]"
    moved = (
        f"reduces the payload by 20 dB with the pair shifted by {moves} %; change of the least reduced [dB]"
    )
    least = largest(rig.improvement_db for rig in loop.on_rig)
    reduced = (
        "the loop shown, with the lead filter, reduces the measured rms angle by over 20 dB; change [dB]"
    )
    return [
        *(_order(reach) for reach in control.smaller),
        row(without, _at_pair(bare), bare.stopped_hz, AT_PAIR, "Hz"),
        above(short, bare.predicted_db, -18.0),
        at_most(f"the same with lead filter, at its highest stable authority, {moved}", lead.least_db, -20.0),
        at_most(reduced, loop.measured_db, -20.0),
        at_most(f"the loop shown, unchanged, {moved}", least, -20.0),
        *prediction_claims((loop,), "payload penalty"),
    ]


def _order(reach: LoopReach) -> Claim:
    """The paper's observations with few states; from 16 states on the pair near 9 Hz is the limit."""
    hz = reach.stopped_hz
    if reach.states <= 10:
        text, asked = (
            "is unstable at every authority, in a suspension mode below 1 Hz",
            f"< {SUSPENSION_HZ:g}",
        )
        hz = hz if reach.log10_authority is None else None
        good = hz is not None and hz < SUSPENSION_HZ
    elif reach.states <= 12:
        text, good = "spills over into a mode outside its model", hz is not None and hz > SPILLS_HZ
        asked = f"> {SPILLS_HZ:g}"
    else:
        text, good, asked = "is limited by the pair near 9 Hz", _at_pair(reach), AT_PAIR
    return row(f"a design on {reach.states} states {text}; unstable at [Hz]", good, hz, asked, "Hz")


def _at_pair(reach: LoopReach) -> bool:
    return reach.stopped_hz is not None and PAIR_HZ[0] <= reach.stopped_hz <= PAIR_HZ[1]


def figure_12_claims(control: TwoSensorControl) -> list[Claim]:
    """The bus at 7-9 Hz, the payload above 10 Hz, and the paper's further order of magnitude."""
    both = control.both
    without, raised = control.above_without_bus_db, control.above_db[1]
    more = None if without is None or raised is None else raised - without
    band = "{:g}-{:g} Hz".format(*FLEXIBLE_HZ)
    alone = "below its level under the payload penalty alone; change [dB]"
    down = "penalties on payload and bus reduce the payload's measured rms angle by 20 dB; change [dB]"
    bus = f"the bus at {band} is lower than in open loop by at least 12 dB; change [dB]"
    same = (
        f"the bus penalty raises the payload above {ABOVE_HZ[0]:g} Hz, at equal"
        " authority without lead filter; change [dB]"
    )
    deeper = f"the payload at {band} falls by a further order of magnitude {alone}"
    at_mode = (
        f"at the {control.mode_hz:.1f} Hz mode, between its half-power points, the payload falls tenfold"
        f" {alone}"
    )
    return [
        at_most(down, both.measured_db, -20.0),
        at_most(bus, control.bus_db[1], -12.0),
        above(f"the payload above {ABOVE_HZ[0]:g} Hz is higher than in open loop; change [dB]", raised, 0.0),
        above(same, more, 0.0),
        at_most(deeper, control.deeper_db, ORDER_DB),
        at_most(at_mode, control.deeper_at_mode_db, ORDER_DB),
        *prediction_claims((both,), "payload and bus penalty"),
    ]
