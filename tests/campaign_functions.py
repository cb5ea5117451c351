"""Functions that campaigns of the tests call, in processes of their own."""

import os
import signal
import sys
import time

import numpy as np

from middeck.campaign import Case, Normal, Parameter, Uniform, monte_carlo, run_campaign


def some_cases(count):
    return monte_carlo([Parameter("k", Uniform(1.0, 2.0)), Parameter("m", Normal(3.0, 0.1))], count, seed=5)


def quantity(case: Case, inputs):
    time.sleep(inputs["wait_s"])
    noise = np.random.default_rng(case.seed).standard_normal(3)
    return {"ratio": case["k"] / case["m"], "noise": noise, "pole": complex(noise[0], -0.0)}


def troubled(case: Case, inputs):
    if case.index == 2:
        raise ValueError("slack cable")
    if case.index == 5:
        os._exit(9)
    return object() if case.index == 3 else case.index


def leaving(case: Case, inputs):
    return sys.exit("no rest state") if case.index == 1 else case.index


def never_begin():
    """As a script that runs its campaign when its processes import it."""
    os._exit(9)


def main(ledger, count, wait_s, workers, limit=""):
    """Run to the end in a process that a test may kill; ``limit``: bytes that a file may have."""
    if limit:
        import resource

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
    print("begun", flush=True)
    run_campaign(
        "campaign_functions:quantity",
        some_cases(int(count)),
        ledger,
        inputs={"wait_s": float(wait_s)},
        workers=int(workers),
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
