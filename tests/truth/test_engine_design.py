"""Sentences of the design that other tests leave out: test points, causes in order, owner of settings."""

from __future__ import annotations

import dataclasses
import hashlib
import subprocess
import sys
import time

import numpy as np
import pytest

from engine_cases import (
    OUTPUTS,
    kinds,
    plain_settings,
    random_article,
    random_package,
    still_article,
)
from faked_clock import SupervisorByFakedClock, faked_clock
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.realtime.engine.interface.monitors import Monitor
from middeck.realtime.engine.interface.settings import Drive, SensorTest, Spread, encode_settings
from middeck.realtime.engine.recording.run_file import read_run
from middeck.realtime.engine.rigs.linear_article import Fault
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.package_law import package_law
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import PERIOD_S, ports
from repeats import repeats
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")


def test_a_record_has_every_signal_of_its_sample():
    """Output = hold + what each slot adds + excitation, within the limits: all of it stands in one record."""
    hold = (LoopPath(0, 0, static_gain(-0.05)), LoopPath(1, 1, static_gain(0.03)))
    wave = 0.02 * np.random.default_rng(5).standard_normal((100, OUTPUTS))
    with Supervisor(plain_settings(hold=hold, verify_s=0.0), random_article(), waveform=wave) as engine:
        for slot in range(2):
            assert engine.load(random_package(slot + 1), slot=slot).done
        engine.reset()
        engine.run(400)
        assert engine.command("excite", values=[0.0]).done
        assert engine.command("engage", slot=0, values=[1.0]).done
        rows = [engine.run(300)]
        assert engine.command("engage", slot=1, values=[0.5]).done
        rows.append(engine.run(300))
    r = np.concatenate(rows)
    wanted = r["hold"] + (r["added_0"] + r["added_1"]) + r["excitation"]
    assert np.array_equal(r["u"], np.clip(wanted, -0.5, 0.5))
    assert np.array_equal(r["sequence"], r["sequence"][0] + np.arange(len(r)))
    at_limit = np.array([[row >> k & 1 for k in range(OUTPUTS)] for row in r["saturated"]], dtype=bool)
    assert np.array_equal(at_limit & (np.abs(r["u"]) == 0.5), np.abs(wanted) >= 0.5)
    assert {
        "y",
        "state",
        "excitation",
        "wanted_0",
        "wanted_1",
        "gain",
        "late_ns",
        "step_ns",
        "unhealthy",
    } <= set(r.dtype.names)
    assert len(set(r["slots"].tolist())) >= 2
    assert np.ptp(r["excitation"]) > 0.0


AT = 401
"""The sample in which everything happens."""
SILENT, APART = 40, 5
"""Samples of a supervisor, and of two sensors, until they trip."""
OUTSIDE = ("heartbeat", "lateness")
READ = ("not finite", "range", "stuck", "spread", "envelope")
SEEN = ("band power", "growth")
WRITTEN = ("band power u0", "growth u0", "effort", "momentum")
OVERFLOWS = ("command not finite",)
RANKS = (
    ("stop", *OUTSIDE, *READ, *SEEN, *WRITTEN),
    ("stop", "no answer", *OUTSIDE, *SEEN, *WRITTEN),
    ("stop", "rig dead", *OUTSIDE, *SEEN, *WRITTEN),
    ("stop", *OUTSIDE, *READ, *SEEN, *OVERFLOWS),
    ("stop", "no answer", *OUTSIDE, *SEEN, *OVERFLOWS),
    ("stop", "rig dead", *OUTSIDE, *SEEN, *OVERFLOWS),
)
"""In order of authority: what can be in one sample. Without readings no test of a sensor finds anything, and
after numbers that overflow no output is looked at."""
CAUSES = [ranks[first:] for ranks in RANKS for first in range(len(ranks))]
"""Each beside all of lesser authority, which are the first of others."""


def watching(asked):
    """Settings that trip by these causes and no others."""
    y, u = ports(0, 7, 2)
    reach = {5: 1.0} if "envelope" in asked else {}
    stuck = {2: AT * PERIOD_S} if "stuck" in asked else {}
    monitors = [
        Monitor(
            channel=channel, side=side, band_hz=(0.0, 25.0), seconds=PERIOD_S, window_s=PERIOD_S, floor=1e-4,
            limit=limit if f"band power{where}" in asked else np.inf,
            factor=2.0 if f"growth{where}" in asked else 0.0, times=times,
        )
        for channel, side, where, limit, times in (
            ("y6", "sensor", "", 0.07, 2), ("u0", "output", " u0", 1e-3, 1),
        )
    ]  # fmt: skip
    return plain_settings(
        sensors=tuple(
            SensorTest(port=port, range=10.0, envelope=reach.get(k, np.inf), stuck_s=stuck.get(k, 0.0))
            for k, port in enumerate(y)
        ),
        drives=tuple(
            Drive(
                port=port, lower=-0.5, upper=0.5, momentum=1e-6 if "momentum" in asked else np.inf, stored=0.0
            )
            for k, port in enumerate(u)
        ),
        spreads=[Spread(first="y3", second="y4", limit=0.5, seconds=APART * PERIOD_S)]
        if "spread" in asked
        else (),
        monitors=monitors,
        effort_s=PERIOD_S if "effort" in asked else 0.0,
        heartbeat_s=SILENT * PERIOD_S if "heartbeat" in asked else 0.0,
        late_most=0,
    )


def upset(asked):
    """Readings that stand still until it happens; y6, whose filtered step grows on, moves one before."""
    moves = {
        "not finite": Fault(kind="sensor nan", channel=0, start=AT),
        "range": Fault(kind="sensor add", channel=1, start=AT, value=100.0),
        "spread": Fault(kind="sensor add", channel=4, start=AT - APART + 1, value=2.0),
        "envelope": Fault(kind="sensor add", channel=5, start=AT, value=2.0),
        "no answer": Fault(kind="rig silent", start=AT),
        "rig dead": Fault(kind="rig dies", start=AT),
    }
    faults = [fault for cause, fault in moves.items() if cause in asked]
    faults.append(Fault(kind="sensor add", channel=6, start=AT - 1, value=2.0))
    return still_article([0.1, 0.1, 0.1, 0.2, 0.2, 0.0, 0.0], faults=tuple(faults))


def reacting(asked):
    """u = g y6 of the sample before: u0 within its limit, u1 beyond; or numbers that overflow."""
    y, u = ports(0, 7, 2)
    gains = [[1e308], [1e308]] if "command not finite" in asked else [[0.1], [1.0]]
    system = SampledStateSpace([[0.0]], np.eye(7)[6:], gains, np.zeros((2, 7)), period_s=PERIOD_S)
    return package_law(Compensator(system, y, u), "law", limit=0.5, form="dense")


@pytest.mark.parametrize("asked", repeats(dict.fromkeys(CAUSES), len(RANKS[0]) + 2), ids=", ".join)
def test_of_several_causes_in_one_sample_the_first_in_authority_is_the_trip(asked):
    with faked_clock() as clock, SupervisorByFakedClock(watching(asked), upset(asked), clock=clock) as engine:
        assert engine.load(reacting(asked)).done
        assert engine.reset().done
        engine.run(SILENT // 2, keep=False)
        assert engine.command("engage", values=[1.0]).done
        while engine.sample < AT - SILENT - 1:
            engine.run(min(SILENT // 2, AT - SILENT - 1 - engine.sample), keep=False)
        engine.beat()
        engine.run(SILENT + 1, beats=False)
        assert engine.state == "control", kinds(engine)
        if "stop" in asked:
            engine.stop()
        if "lateness" in asked:
            clock["late"] = 10_000_000
        engine.run(1, beats=False)
        (trip,) = [event for event in engine.events() if event.trips]
    assert (trip.kind, trip.sample) == (asked[0].removesuffix(" u0"), AT)


def test_settings_have_one_owner():
    """They are fixed when an engine starts: who writes into its file later changes none; a run says which."""
    settings, noisy = plain_settings(), {"seed": 3}
    with Supervisor(settings, random_article(**noisy)) as engine:
        engine.reset()
        asked = engine.run(200)
    with Supervisor(settings, random_article(**noisy)) as engine:
        for name in ("range", "envelope", "lower", "upper", "slew"):
            engine.file.settings[name][:] = 0.0
        engine.file.settings["paths"] = 1
        engine.reset()
        assert engine.run(200)[["y", "u"]].tobytes() == asked[["y", "u"]].tobytes()
        assert engine.state == "ready"


def test_a_run_names_its_settings(tmp_path):
    settings = plain_settings()
    with Supervisor(settings, random_article()) as engine:
        engine.record(tmp_path / "run.mdr")
        engine.run(5)
    said = read_run(tmp_path / "run.mdr").settings_sha256
    assert said == hashlib.sha256(encode_settings(settings).tobytes()).hexdigest()


def _record_and_fail(engine, path):
    engine.record(path)
    engine.reset()
    engine.run(300)
    engine.run(20, keep=False)
    raise ZeroDivisionError


def test_the_record_outlives_an_error_of_its_supervisor(tmp_path):
    """Whatever the program raises, the loop ends in SAFE and its record has every sample and an end."""
    with pytest.raises(ZeroDivisionError), Supervisor(plain_settings(), random_article()) as engine:
        _record_and_fail(engine, tmp_path / "run.mdr")
    run = read_run(tmp_path / "run.mdr")
    assert not run.faults
    assert run.events[-1].kind == "ended"
    assert np.array_equal(run.records["sequence"], 1 + np.arange(len(run.records)))
    assert len(run.records) >= 320


def test_half_a_minute_before_a_trip_is_kept():
    settings = plain_settings()
    samples = settings.samples(30.0)
    with Supervisor(settings, random_article()) as engine:
        engine.reset()
        engine.run(samples + 500, keep=False)
        engine.stop()
        engine.run(50, keep=False)
        before = engine.pretrip()
    assert len(before) >= samples
    assert np.array_equal(np.diff(before["sequence"]), np.ones(len(before) - 1))
    assert before["sequence"][-1] == samples + 501


STOPPING = """
import sys
import time
from pathlib import Path
from middeck.realtime.engine.interface.shared_file import SharedFile
SharedFile(Path(sys.argv[1])).asks["stop"] += 1
"""


def test_anybody_may_stop_an_engine_whose_supervisor_does_nothing():
    """By a word in its file, of another process; the supervisor gives no command and reads no record."""
    settings = plain_settings(period_s=0.01, late_s=1e3)
    with Supervisor(settings, random_article(), real_time=True) as engine:
        assert engine.reset().done
        subprocess.run([sys.executable, "-c", STOPPING, str(engine.file.path)], check=True)
        seen = engine.sample
        while engine.sample < seen + 3:
            time.sleep(0.01)
        assert engine.state == "safe"
        assert kinds(engine)[-1] == "stop"


def test_no_output_is_without_a_limit_and_no_sensor_without_a_range():
    """Saturation is no option."""
    plain = plain_settings()
    for limit in (np.inf, np.nan):
        with pytest.raises(ConfigError, match="limits of"):
            dataclasses.replace(plain.drives[0], upper=limit)
        with pytest.raises(ConfigError, match="range"):
            dataclasses.replace(plain.sensors[0], range=limit)
