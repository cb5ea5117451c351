"""Impact tests: blows of a hammer found and judged, windowed, averaged and fitted.

test = average_blows(record)
fitted = fit_impact(test)
"""
