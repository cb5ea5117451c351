"""Monte Carlo of a compensator in a ledger: interrupted and resumed, the same verdicts."""

import functools

import numpy as np
import pytest

import middeck as md
from campaign_loops import DRIFT, WEIGHTS, WITHIN, closed, hung_plant
from middeck.campaign import run_campaign, sobol

SETUP = ("articles/mace-dm.toml", "environments/lab.toml")


def test_interrupted_and_resumed_it_is_the_verification_of_all_plants(tmp_path):
    law, plant = tmp_path / "law.json", hung_plant(*SETUP)
    md.write(law, md.design_lqg(md.approximate_delays(plant, 3), WEIGHTS, 1e6))
    inputs = {"article": SETUP[0], "environment": SETUP[1], "law": str(law)}
    cases = sobol(WITHIN, 8, seed=4)
    campaign = functools.partial(run_campaign, closed, cases, inputs=inputs)

    def stop(progress):
        if progress.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign(tmp_path / "loops.ledger", progress=stop)
    resumed = campaign(tmp_path / "loops.ledger")
    assert resumed.digest == campaign(tmp_path / "whole.ledger").digest

    (whole,) = md.control.verify_robustness(
        plant,
        md.load_compensator(law),
        WEIGHTS,
        uncertainty=DRIFT,
        positions=np.stack([c.values for c in cases]),
    ).outcomes
    kept = [one.result for one in resumed.outcomes]
    assert [k["stable"] for k in kept] == whole.stable.tolist()
    assert 0 < np.sum(whole.stable) < len(cases)
    np.testing.assert_allclose([k["db"] for k in kept], whole.db, atol=1e-6)
