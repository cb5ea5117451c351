"""Impact tests: blows of a hammer found and judged, windowed, averaged and fitted.

test = average_blows(record)
fitted = fit_impact(test)
"""

from middeck.identification.impact.averaged_blows import ImpactTest, average_blows
from middeck.identification.impact.blows import Blow, locate_blows
from middeck.identification.impact.fit_of_blows import fit_impact, without_window

__all__ = ["Blow", "ImpactTest", "average_blows", "fit_impact", "locate_blows", "without_window"]
