"""Signals recognised from their samples: kind, period, lines, and the record cut by them."""

import gimbal_record
import numpy as np
import pytest
from signal_bank import run_of, signals

from cli_runner import ROOT
from middeck.errors import DataError
from middeck.files.records import load_record
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.excitation.recognition import cut_periods, recognise_excitation
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.modal_system import ModalSystem

BANK = signals()


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
@pytest.mark.parametrize("leave_out", [0, 37])
@pytest.mark.parametrize("name", list(BANK))
def test_every_design_is_recognised(name, leave_out, noise):
    made = BANK[name]
    found = recognise_excitation(run_of(made, noise=noise, leave_out=leave_out))
    # Phase noise of 10 % hides steps of a hertz; what is left is still one sine at a time.
    blurred = made.kind == "stepped sine" and noise == 0.1
    assert found.kind == ("swept sine" if blurred else made.kind)
    if not made.periodic:
        assert (found.period, found.periods, found.scatter) == (None, 0, None)
        return
    samples = made.u.shape[1]
    assert (found.period, found.periods) == (samples, 2 if leave_out else 3)
    assert found.offset == (samples - 37 if leave_out else 0)
    assert found.odd == name.startswith(("odd", "random-odd"))
    # Scatter over mean power; the mean's own noise and the few periods leave a fifth.
    assert found.scatter == pytest.approx(noise**2, rel=0.2, abs=1e-6)
    np.testing.assert_allclose(found.crest_factor, made.crest_factor, rtol=3.0 * noise + 1e-9)
    if made.kind == "multisine" and (noise < 0.1 or name != "pink"):
        np.testing.assert_array_equal(found.lines, made.lines)
    assert orthogonal(found) == (name == "three inputs")


def test_inputs_that_are_not_orthogonal_are_reported():
    rng = np.random.default_rng(0)
    each = [design_multisine((1.0, 60.0), 2.0, 256.0, Limits(rms=1.0), rng) for _ in range(4)]
    u = np.stack([np.concatenate([each[i].u[0], each[i + 1].u[0]], axis=1) for i in (0, 2)])
    run = Record(
        sample_hz=256.0,
        u=np.stack([u, u], axis=1),
        y=u[:, None].repeat(2, axis=1),
        **_ports(2, 2),
        periodic=True,
    )
    found = recognise_excitation(run)
    assert found.orthogonality > 0.05


def orthogonal(found):
    return found.orthogonality is not None and found.orthogonality < 0.05


def _ports(inputs, outputs):
    named = {"inputs": ("u", inputs), "outputs": ("y", outputs)}
    return {group: tuple(Port(f"{s}{i}", "V") for i in range(n)) for group, (s, n) in named.items()}


def test_the_mirror_and_the_gimbal_are_recognised():
    mirror = load_record(ROOT / "data/cubespec-fsm/mirror-300mV-train.npz")
    found = recognise_excitation(mirror)
    # The data set's own description: 8192 samples, two periods, orthogonal multisines below 3000 Hz.
    assert (found.kind, found.period, found.periods, orthogonal(found)) == ("multisine", 8192, 2, True)
    assert found.lines.tolist() == list(range(1, 3840))
    for inputs in (1, 2):
        measured = gimbal_record.multisine(0, inputs=inputs, outputs=inputs)
        found = recognise_excitation(measured)
        assert (found.kind, found.period, found.periods) == ("multisine", 16384, 3)
        assert orthogonal(found) == (inputs == 2)
        joined = _as_one_run(measured)
        assert cut_periods(joined) == measured


def _as_one_run(measured):
    u, y = (x.reshape(len(x), 1, -1, x.shape[3]) for x in (measured.u, measured.y))
    return Record(
        sample_hz=measured.sample_hz,
        u=u,
        y=y,
        inputs=measured.inputs,
        outputs=measured.outputs,
        periodic=False,
    )


def test_one_period_of_odd_lines_is_seen_in_its_two_halves():
    """As in a well-known record of a robot arm: 1024 samples, the second half minus the first."""
    made = BANK["odd"]
    found = recognise_excitation(run_of(made, periods=1, noise=0.05))
    assert (found.period, found.periods, found.odd) == (2048, 1, True)
    np.testing.assert_array_equal(found.lines % 2, 1)


def a_run_from_rest(noise, periods=6):
    """A mode of 3 Hz and 1 % under the compact multisine: its transient dies by exp(-1.5) a period."""
    made = BANK["compact"]
    modal = ModalSystem(
        omega=[2.0 * np.pi * 3.0], zeta=[0.01], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]], names=("mode",)
    )
    u = np.tile(made.u[0], (periods, 1))
    y, _ = simulate(sample_dynamics(modal, 1.0 / 256.0), u)
    y += noise * y.std() * np.random.default_rng(0).standard_normal(y.shape)
    return Record(sample_hz=256.0, u=u[None, None], y=y[None, None], **_ports(1, 1), periodic=False)


@pytest.mark.kernels
# At a noise of 0.1 the first period's transient has the power of the noise to a hundredth, which is just what
# is asked of it: rounding would decide.
@pytest.mark.parametrize(("noise", "first"), [(0.5, (0,)), (0.05, (1,)), (0.01, (2,))])
def test_unsteady_periods_are_left_out(noise, first):
    run = a_run_from_rest(noise)
    found = recognise_excitation(run)
    assert found.steady_from in first
    cut = cut_periods(run)
    assert cut.u.shape[1] == 6 - found.steady_from
    # What is left of the transient is below the noise: the first period kept is as near the last as noise is.
    away = np.sqrt(np.mean((cut.y[0, 0] - cut.y[0, -1]) ** 2))
    assert away < 2.0 * np.sqrt(2.0) * noise * run.y.std()


def test_a_start_before_the_signal_is_left_out():
    made = BANK["random"]
    u = np.concatenate([np.zeros((300, 1)), *[made.u[0]] * 4])
    run = Record(sample_hz=256.0, u=u[None, None], y=u[None, None], **_ports(1, 1), periodic=False)
    cut = cut_periods(run)
    assert cut.u.shape[1:3] == (4, 2048)
    np.testing.assert_array_equal(cut.u[0, 0], made.u[0])


def test_what_does_not_repeat_is_not_cut():
    with pytest.raises(DataError, match="does not repeat"):
        cut_periods(run_of(BANK["noise"]))
    run = run_of(BANK["noise"])
    silent = Record(
        sample_hz=256.0, u=0.0 * run.u, y=run.y, inputs=run.inputs, outputs=run.outputs, periodic=False
    )
    assert recognise_excitation(silent).kind == "silence"
    broken = np.array(run.u)
    broken[0, 0, 5] = np.nan
    with pytest.raises(DataError, match="not finite"):
        recognise_excitation(
            Record(sample_hz=256.0, u=broken, y=run.y, inputs=run.inputs, outputs=run.outputs, periodic=False)
        )


@pytest.mark.long
def test_noise_is_never_called_periodic(campaign):
    """Bands from a hundredth of the rate to half of it, short records and long."""
    for seed in campaign(400):
        rng = np.random.default_rng(seed)
        samples, low, width = (
            int(rng.integers(64, 4096)),
            rng.uniform(0.0, 0.3),
            10.0 ** rng.uniform(-2.0, -0.7),
        )
        f = np.fft.rfftfreq(4 * samples)
        on = (f > low) & (f < low + width)
        X = on * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
        u = np.fft.irfft(X, 4 * samples)[:samples, None]
        # A record of a few correlation times cannot tell.
        if width * samples < 20.0:
            continue
        run = Record(sample_hz=1.0, u=u[None, None], y=u[None, None], **_ports(1, 1), periodic=False)
        assert recognise_excitation(run).period is None, seed
