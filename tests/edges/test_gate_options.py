"""The options of an adaptive gain belong together; what makes no sense is told before anything is read."""

from __future__ import annotations

import pytest

from cli_runner import middeck

Capture = pytest.CaptureFixture[str]
WHOLE = ("--adaptive", "y", "2", "0.1", "--adaptive-band", "1,9", "--adaptive-rms", "0.1,0.2")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (WHOLE[:4], "--adaptive needs --adaptive-band and --adaptive-rms"),
        (WHOLE[:6], "--adaptive needs --adaptive-rms"),
        (WHOLE[4:6], "--adaptive-band belongs to --adaptive"),
        (("--adaptive-least", "0.1"), "--adaptive-least belongs to --adaptive"),
        ((*WHOLE, "--adaptive-least", "3"), "gains from 3.0 to 2.0"),
        ((*WHOLE[:6], "--adaptive-rms", "0.2,0.1"), "an rms that is quiet below 0.2"),
        ((*WHOLE[:4], "--adaptive-band", "9,1", *WHOLE[6:]), "does not rise"),
        (("--adaptive", "y", "0", "0.1"), "x>0"),
    ],
)
def test_options_of_a_gain_that_do_not_fit(capfd: Capture, options: tuple[str, ...], said: str) -> None:
    ended = middeck(capfd, "gate", "no.mdk", "no.json", *options)
    assert ended.code == 2
    assert said in ended.err
