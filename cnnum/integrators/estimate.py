"""How the error of a run is estimated from the local errors of its steps."""

import numpy as np

from cnnum.template import Template

SAFETY = 5.0
"""Of the sum of local errors, for an array without feedback: with loose tolerances a run has few
steps, which cross the corners of f, and the embedded estimate is then up to 4 times too small."""


def error_factor(template: Template) -> float:
    """Return what the sum of local errors is multiplied by.

    Feedback carries an error on to neighbours, and where cells do not saturate lets it grow; with
    ‖A‖ the largest sum of weights into a cell, 1 + ‖A‖ bounds the rate of both. The product
    covered the truth in more than 99 % of random networks, from contracting ones to ‖A‖ = 8.
    """
    return SAFETY * (1.0 + float(np.abs(template.A).sum(axis=(1, 2, 3)).max()))
