"""Hold, excitation, strips, fades and slots of the engine against a loop written here."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.signal

from engine_cases import (
    OUTPUTS,
    SENSORS,
    plain_settings,
    random_article,
    random_package,
    static_package,
    still_article,
)
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain, ProvedGain, encode_proof
from middeck.realtime.engine.interface.settings import LEAST_RAMP, Drive, hash_hold
from middeck.realtime.package.filter_sections import LoopPath, Section
from middeck.realtime.package.package_bytes import hash_package
from middeck.realtime.package.reference import ReferenceLaw
from packaged_laws import PERIOD_S, ports
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
LAG = Section(np.array([-0.3, 0.1, 0.0]), np.array([-0.6, 0.05]))
HOLD = (
    LoopPath(0, 0, LAG),
    LoopPath(2, 0, Section(np.array([-0.2, 0.0, 0.0]), np.zeros(2))),
    LoopPath(1, 1, LAG),
)


def started(*, settings=None, article=None, package=None, **given):
    engine = Supervisor(settings or plain_settings(), article or random_article(), **given)
    if package is not None:
        assert engine.load(package).done
    assert engine.reset().done
    return engine


def held_by(y):
    """The hold's output for sensors ``y`` from rest."""
    u = np.zeros((len(y), OUTPUTS))
    for path in HOLD:
        sos = np.concatenate([path.section.b, [1.0], path.section.a])[None]
        u[:, path.output] += scipy.signal.sosfilt(sos, y[:, path.input])
    return u


def learnt(package, records, engaged_at=0):
    """What the law of slot 0, alone, asks for in each sample where it is told what was applied of it."""
    law, asked = ReferenceLaw(dataclasses.replace(package, ramp=max(package.ramp, LEAST_RAMP))), []
    for k, row in enumerate(records):
        law.engaged = k >= engaged_at
        added = law.compute(row["y"])
        asked.append((added, law.wanted))
        total = row["hold"] + added + row["excitation"]
        law.commit(np.where(row["u"] == total, added, row["u"] - row["hold"] - row["excitation"]))
    return np.array(asked)


def test_the_hold_filters_its_sensors():
    with started(settings=plain_settings(hold=HOLD)) as engine:
        records = engine.run(600)
    expected = held_by(records["y"])
    assert np.abs(records["hold"] - expected)[250:].max() < 1e-13  # it has faded in after the reset
    assert np.all(np.abs(records["hold"]) <= np.abs(expected) + 1e-13)
    assert np.abs(records["u"] - np.clip(records["hold"], -0.5, 0.5)).max() == 0.0


def test_an_excitation_is_played_as_often_as_it_is_asked_for():
    wave = np.random.default_rng(0).uniform(-0.4, 0.4, (30, OUTPUTS))
    with started(waveform=wave) as engine:
        engine.run(5)
        assert engine.command("excite", values=[2.0]).done
        records = engine.run(100)
        assert engine.state == "ready"
        assert [event.kind for event in engine.events()] == ["reset done", "excited", "quiet"]
    assert np.array_equal(records["u"][:60], np.vstack([wave, wave]))
    assert not records["u"][60:].any()
    with started() as engine:
        assert engine.command("excite", values=[1.0]).word == "no waveform"


def test_the_law_learns_what_was_applied_of_its_command():
    """With hold and excitation beside it, and limits in the way."""
    wave = np.random.default_rng(1).uniform(-0.4, 0.4, (700, OUTPUTS))
    package = random_package()
    settings = plain_settings(hold=HOLD, verify_s=0.0)
    with started(settings=settings, package=package, waveform=wave) as engine:
        engine.command("excite", values=[0.0])
        assert engine.command("engage", values=[1.0]).word == "not ready"  # the hold has not risen
        engine.run(engine.settings.samples(engine.settings.rise_s))
        assert engine.command("engage", values=[1.0]).done
        records = engine.run(1500)
    asked = learnt(package, records)
    assert np.array_equal(records["added_0"], asked[:, 0])
    assert np.array_equal(records["wanted_0"], asked[:, 1])
    total = records["hold"] + records["added_0"] + records["excitation"]
    assert np.abs(records["u"] - np.clip(total, -0.5, 0.5)).max() < 1e-15
    assert np.any(np.abs(total) > 0.5)


def test_a_strip_scales_shifts_limits_and_holds():
    package = random_package()
    with started(package=package) as engine:
        engine.command("engage", values=[1.0])
        engine.run(400)
        assert engine.set_strip("u0", "gain", 0.5).done
        assert engine.set_strip("u1", "limit", 0.25).done
        engine.run(LEAST_RAMP + 200)
        records = engine.run(300)
        assert np.abs(records["u"][:, 0]).max() <= 0.25  # half of a law that is limited to 0.5
        assert np.abs(records["u"][:, 1]).max() == 0.125
        assert engine.set_strip("u1", "hold", 1.0).done
        engine.run(LEAST_RAMP + 200)
        assert np.ptp(engine.run(50)["u"][:, 1]) == 0.0
        assert engine.set_strip("u1", "gain", 11.0).word == "out of range"
        assert engine.set_strip("u0", "offset", 0.6).word == "out of range"
    with started() as engine:
        engine.set_strip("u0", "offset", 0.1)
        shifted = engine.run(400)["u"]
    assert np.all(np.diff(shifted[:, 0]) <= 0.5 / 250 + 1e-15)
    assert shifted[-1].tolist() == [0.1, 0.0]


@pytest.mark.parametrize(("name", "value", "end"), [("gain", -0.5, -0.15), ("limit", 0.2, 0.1)])
def test_no_strip_makes_a_jump(name, value, end):
    """There and back, on a command of 0.3 that stands still: a change by one takes a ramp."""
    package = static_package(np.full((OUTPUTS, SENSORS), 0.3))
    with started(article=still_article([1.0, 0.0, 0.0]), package=package) as engine:
        engine.command("engage", values=[1.0])
        engine.run(300)
        rows = []
        for asked, reached in ((value, end), (1.0, 0.3)):
            assert engine.set_strip("u0", name, asked).done
            rows.append(engine.run(400))
            assert rows[-1]["u"][-1, 0] == pytest.approx(reached)
    assert np.abs(np.diff(np.concatenate(rows)["u"][:, 0])).max() <= 1.001 * 0.5 / 250


def test_each_command_has_one_answer_under_its_number():
    words = {"silence": "done", "engage": "not loaded", "standby": "not loaded"}
    with started() as engine:
        asked = [(name, engine.send(name, values=[1.0])) for name in 40 * list(words)]
        engine.run(5)
        assert np.all(np.diff([number for _, number in asked]) == 1)
        assert [engine.answer(number).word for _, number in asked] == [words[name] for name, _ in asked]


def test_slots_cross_fade_with_warm_states():
    """The second law has followed the article in standby; no command jumps where the first one hands over."""
    first, second = random_package(seed=1), random_package(seed=7)
    calm = random_article(sensor_noise=np.full(SENSORS, 1e-4), G=1e-5 * np.eye(6))
    with started(article=calm, package=first) as engine:
        assert engine.load(second, slot=1).done
        engine.command("engage", slot=0, values=[1.0])
        engine.run(600)
        assert engine.command("standby", slot=1).done
        warm = engine.run(600)
        assert engine.load(second, slot=1).word == "busy"
        engine.command("engage", slot=1, values=[1.0])
        fading = engine.run(600)
        assert engine.state == "control"
    assert not warm["added_1"].any()
    assert warm["wanted_1"][-1].any()
    assert np.array_equal(fading["u"], np.clip(fading["added_0"] + fading["added_1"], -0.5, 0.5))
    assert not fading["added_0"][-1].any()
    asked = learnt_in_standby(second, np.concatenate([warm, fading]), len(warm))
    assert np.array_equal(fading["added_1"], asked)


def learnt_in_standby(package, records, engaged_at):
    law, asked = ReferenceLaw(dataclasses.replace(package, ramp=max(package.ramp, LEAST_RAMP))), []
    for k, row in enumerate(records):
        law.engaged = k >= engaged_at
        asked.append(law.compute(row["y"]))
        law.commit(row["u"] - row["hold"] - row["excitation"])
    return np.array(asked[engaged_at:])


def test_a_share_of_full_authority_stays_a_share():
    package = random_package()
    with started(package=package) as engine:
        engine.command("engage", values=[0.25])
        records = engine.run(600)
        assert engine.state == "control"
        engine.command("disengage")
        engine.run(400)
        assert engine.state == "ready"
        assert not engine.run(10)["u"].any()
    ratio = records["added_0"][400:] / records["wanted_0"][400:]
    level = np.ceil(0.25 * 250) / 250
    free = np.abs(records["added_0"][400:]) < 0.5
    assert np.allclose(ratio[free], level**2 * (3.0 - 2.0 * level), rtol=1e-12)


def test_the_adaptive_gain_moves_as_it_is_written():
    """Down while the band is loud, up while it is quiet, from its least value; the law learns of it."""
    package = random_package()
    noise = 0.3 * np.random.default_rng(3).standard_normal((1000, OUTPUTS))
    wave = np.concatenate([np.zeros((2000, OUTPUTS)), noise])
    gain = AdaptiveGain(
        maximum=0.02, minimum=0.004, rate=0.01, sensor="y0", band_hz=(1.0, 100.0), quiet_rms=9e-3,
        loud_rms=1.1e-2, seconds=0.1,
    )  # fmt: skip
    settings = plain_settings(adaptive=gain)
    with started(settings=settings, waveform=wave) as engine:
        assert engine.load(package, proof=proof_of(package, settings)).done
        assert engine.command("adapt", values=[1.0]).done
        engine.command("excite", values=[1.0])
        engine.command("engage", values=[1.0])
        assert engine.command("adapt", values=[0.0]).word == "not ready"
        records = engine.run(3000)
    stands = package.ramp + 1  # until the fade has risen
    assert np.allclose(records["gain"], moved(gain, records["y"][:, 0], stands), rtol=1e-9)
    assert records["gain"].max() > 1.2 * records["gain"].min()
    free = (np.abs(records["added_0"]) < 0.5) & (np.arange(3000) > 300)[:, None]
    both = np.column_stack([records["gain"]] * OUTPUTS)
    assert np.allclose((records["added_0"] / records["wanted_0"])[free], both[free], rtol=1e-9)


def test_fade_times_gain_moves_no_faster_than_is_proved():
    """What acts is their product: only one of them moves at a time, and the gain begins at its least."""
    rate, y = 0.5, [0.01] * SENSORS
    gain = AdaptiveGain(maximum=2.0, rate=rate, sensor="y0", band_hz=(1.0, 9.0), quiet_rms=1.0, loud_rms=2.0)
    settings, package = plain_settings(adaptive=gain), static_package(np.full((OUTPUTS, SENSORS), 1.0))
    with started(article=still_article(y), settings=settings) as engine:
        assert engine.load(package, proof=proof_of(package, settings)).done
        assert engine.command("adapt", values=[1.0]).done
        engine.run(400)
        assert engine.command("engage", values=[1.0]).done
        rises = engine.run(900)
        told = [("engage", [0.5]), ("engage", [1.0]), ("disengage", []), ("engage", [1.0]), ("disengage", [])]
        later = []
        for word, values in told:
            assert engine.command(word, values=values).done
            later.append(engine.run(100))
    all_of_it = np.concatenate([rises, *later])
    product = all_of_it["added_0"][:, 0] / all_of_it["wanted_0"][:, 0]
    step = rate * PERIOD_S * (1.0 + 1e-9)
    assert np.abs(np.diff(product[: len(rises)])).max() <= step  # no faster than the gain alone
    free = len(rises) - settings.fade_samples[0] - 1
    assert product[len(rises) - 1] == pytest.approx(free * rate * PERIOD_S)
    moves = np.diff(all_of_it["gain"]) != 0.0
    assert np.abs(np.diff(product))[moves].max() <= step
    assert np.abs(np.diff(product)).max() > 2.0 * step  # and fades are as fast as ever


def test_no_two_laws_have_an_adaptive_gain_at_once():
    """The proof is of one law: another engages when it has gone."""
    gain = AdaptiveGain(maximum=1.5, rate=0.1, sensor="y0", band_hz=(1.0, 9.0), quiet_rms=1.0, loud_rms=2.0)
    settings, packages = plain_settings(adaptive=gain), [random_package(seed=k) for k in (1, 7)]
    with started(settings=settings) as engine:
        for k, package in enumerate(packages):
            assert engine.load(package, slot=k, proof=proof_of(package, settings)).done
        assert engine.command("adapt", values=[1.0]).done
        assert engine.command("engage", slot=0, values=[0.5]).done
        engine.run(400)
        assert engine.command("standby", slot=1).done
        assert engine.command("engage", slot=1, values=[1.0]).word == "not proved"
        assert engine.command("engage", slot=0, values=[1.0]).done
        engine.command("disengage")
        engine.run(10)
        assert engine.command("engage", slot=1, values=[1.0]).word == "not proved"
        engine.run(300)
        assert engine.command("engage", slot=1, values=[1.0]).done


def proof_of(package, settings, **changes):
    """As if the gate had proved what the settings allow."""
    gain = settings.adaptive
    bounds = {"minimum": gain.minimum, "maximum": gain.maximum, "rate": gain.rate}
    given = {"package": hash_package(package), "hold": hash_hold(settings), **bounds}
    return ProvedGain(**{**given, **changes})


def test_no_gain_adapts_beyond_what_is_proved_of_the_package():
    """The proof is of these bytes, beside this hold, and of every gain and move that the settings allow."""
    gain = AdaptiveGain(
        maximum=2.0, minimum=0.5, rate=0.1, sensor="y0", band_hz=(1.0, 9.0), quiet_rms=1e-3, loud_rms=2e-3
    )
    first, second = random_package(seed=1), random_package(seed=7)
    settings = plain_settings(adaptive=gain, hold=HOLD, verify_s=0.0)
    other = dataclasses.replace(settings, hold=HOLD[:2])
    with started(settings=settings) as engine:
        for wrong in (
            proof_of(second, settings), proof_of(first, other), proof_of(first, plain_settings(adaptive=gain))
        ):  # fmt: skip
            assert engine.load(first, proof=wrong).word == "bad proof"
        for less in ({"maximum": 1.9}, {"minimum": 0.6}, {"rate": 0.09}, {"rate": np.nan}):
            assert engine.load(first, proof=proof_of(first, settings, **less)).done
            assert engine.command("adapt", values=[1.0]).word == "not proved"
        assert engine.load(first).done
        assert engine.command("adapt", values=[1.0]).word == "not proved"
        assert engine.load(first, proof=proof_of(first, settings)).done
        assert engine.load(second, slot=1).done
        assert engine.command("adapt", values=[1.0]).done
        assert engine.command("engage", slot=1, values=[1.0]).word == "not proved"
        assert engine.command("engage", slot=0, values=[0.9]).word == "not proved"  # 0.9 times 0.5
        for word, value in (("gain", 1.1), ("limit", 0.9), ("hold", 1.0)):
            assert engine.set_strip("u0", word, value).word == "not proved"
        assert engine.set_strip("u0", "offset", 0.01).done
        assert engine.command("engage", slot=0, values=[1.0]).word == "not ready"  # nor is the hold at zero
        engine.run(300)
        assert engine.command("engage", slot=0, values=[1.0]).done
        engine.command("disengage")
        engine.run(300)
        assert engine.command("adapt", values=[0.0]).done
        for word, value, neutral in (("gain", 1.1, 1.0), ("limit", 0.9, 1.0), ("hold", 1.0, 0.0)):
            assert engine.set_strip("u0", word, value).done
            assert engine.command("adapt", values=[1.0]).word == "not proved"
            assert engine.set_strip("u0", word, neutral).done
            engine.run(300)
        assert engine.load(first, proof=proof_of(first, settings, minimum=0.45)).done
        engine.run(300)
        assert engine.command("adapt", values=[1.0]).done
        assert engine.command("engage", slot=0, values=[0.9]).done
        assert engine.command("disengage").done
        engine.run(300)
        assert engine.command("adapt", values=[0.0]).done
        assert engine.command("engage", slot=1, values=[1.0]).done


def test_a_proof_that_was_changed_is_none():
    gain = AdaptiveGain(maximum=2.0, rate=0.1, sensor="y0", band_hz=(1.0, 9.0), quiet_rms=1e-3, loud_rms=2e-3)
    settings, package = plain_settings(adaptive=gain), random_package()
    sealed = encode_proof(proof_of(package, settings))
    rng = np.random.default_rng(1)
    with started(settings=settings) as engine:
        for _ in range(20):
            spoilt = bytearray(sealed)
            spoilt[int(rng.integers(len(spoilt)))] ^= 1 << int(rng.integers(8))
            size = engine.file.stage(package, bytes(spoilt))
            assert engine.command("load", values=[size, 1.0]).word == "bad proof"


def moved(gain, y, stands):
    """The gain of each sample by its own equations; it stands for so many samples first."""
    sos = scipy.signal.butter(2, gain.band_hz, "bandpass", fs=500.0, output="sos")
    power, g, found = 0.0, gain.minimum, []
    filtered, _ = scipy.signal.sosfilt(sos, y, zi=scipy.signal.sosfilt_zi(sos) * y[0])  # constant before
    for k, value in enumerate(filtered):
        power += -np.expm1(-0.002 / gain.seconds) * (value**2 - power)
        way = (k >= stands) * ((power < gain.quiet_rms**2) - float(power > gain.loud_rms**2))
        g = np.clip(g + 0.002 * gain.rate * way, gain.minimum, gain.maximum)
        found.append(g)
    return np.array(found)


def test_engine_limits_act_within_those_of_the_package():
    _, u = ports(0, SENSORS, OUTPUTS)
    tight = tuple(Drive(port=port, lower=-0.05, upper=0.1, slew_rate=5.0) for port in u)
    package = random_package()
    with started(settings=plain_settings(drives=tight), package=package) as engine:
        engine.command("engage", values=[1.0])
        records = engine.run(800)
    assert records["u"].min() == -0.05
    assert records["u"].max() == 0.1
    assert np.abs(np.diff(records["u"], axis=0)).max() <= 5.0 * 0.002 + 1e-15
    assert np.array_equal(records["added_0"], learnt(package, records)[:, 0])
