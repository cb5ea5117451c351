"""Campaigns: many cases from samplers, run once each on a pool of processes, kept in a ledger."""

from middeck.campaign.cases import Case
from middeck.campaign.distributions import LogNormal, Normal, TruncatedNormal, Uniform
from middeck.campaign.executors import CampaignResult, Progress, run_campaign
from middeck.campaign.ledger import Outcome
from middeck.campaign.samplers import Group, Parameter, full_factorial, latin_hypercube, monte_carlo, sobol

__all__ = [
    "CampaignResult",
    "Case",
    "Group",
    "LogNormal",
    "Normal",
    "Outcome",
    "Parameter",
    "Progress",
    "TruncatedNormal",
    "Uniform",
    "full_factorial",
    "latin_hypercube",
    "monte_carlo",
    "run_campaign",
    "sobol",
]
