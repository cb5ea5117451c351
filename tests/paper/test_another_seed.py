"""The order search on a record whose modes the first start of an order does not find."""

import numpy as np
import pytest

from middeck.files.studies.documents import load_study
from middeck.identification.model.fit_options import FitOptions, decided
from middeck.identification.order.recommended_order import recommend_states
from middeck.identification.problem.data import Data
from middeck.identification.spectra.excess_variance import spread_of
from middeck.laboratory.article_rig import build_rig_article
from middeck.laboratory.bench import build_bench, take_open_loop
from middeck.study.chapters.two_sensor_control.chapter import TWO_SENSOR_CONTROL
from middeck.systems.plants.response import in_band


@pytest.mark.kernels
def test_a_search_does_not_end_while_a_mode_is_lacking():
    """With seed 4 no size from 14 to 18 states paid, by its few starts, and 12 missed the bus's modes."""
    study = load_study("studies/mace-1993.toml")
    siso, sito = study.siso, study.sito
    article = build_rig_article(*study.case(siso.article, siso.environment), study.rig)
    rng = TWO_SENSOR_CONTROL.rng(4)
    phases = np.random.default_rng(int(rng.integers(2**63)))
    bench = build_bench(article, study.rig, study.loop_test, (siso.sensor, *sito.sensors), phases)
    measured = in_band(take_open_loop(bench, rng), sito.fit_band_hz)
    spread = spread_of(measured, relative=True)
    data = Data(
        s=2j * np.pi * measured.frequency_hz,
        H=np.moveaxis(measured.H, 0, 1),
        weight=1.0 / np.sqrt(spread.at(1e-3)),
    )
    options = decided(measured, FitOptions(delay="common", direct=False))
    choice = recommend_states(measured, data, spread, options)
    held_out = {t.states: t.held_out for t in choice.tried}
    # Eight modes in the band and friction, and a line in six of the bus's quieter than its noise.
    assert choice.states >= 16
    assert held_out[choice.states] < 0.1
