"""The paper's claims, each a row: what is claimed, whether it holds here, and the number that says so.

The paper prints 36 dB in 0-g (40 dB was its target), over an order of magnitude in rms, and orderings; where
a word such as "much higher" needs a number to be judged by, the number stands in the claim. Every row is
always there: where a loop is unstable or nothing was found there is no number, and what would need it does
not hold.
"""

from middeck.study.claims.figure_6 import figure_6_claims
from middeck.study.claims.figure_7 import figure_7_claims
from middeck.study.claims.figure_9 import figure_9_claims
from middeck.study.claims.figure_10 import figure_10_claims
from middeck.study.claims.figure_11 import figure_11_claims
from middeck.study.claims.figure_12 import figure_12_claims
from middeck.study.claims.row import Claim

__all__ = [
    "Claim",
    "figure_6_claims",
    "figure_7_claims",
    "figure_9_claims",
    "figure_10_claims",
    "figure_11_claims",
    "figure_12_claims",
]
