"""SciPy's methods on the networks of `stated_error`: the same equation, the same measure."""

from cnnum.lab.bench.followed_steps import sample
from cnnum.lab.stability.stated_error import missed


def test_a_method_of_order_eight_keeps_the_tolerance_where_outputs_are_smooth():
    """The truth is another method's, by an engine: a wrong equation would be far off."""
    smooth = [one for one in sample(24, 2) if one.template.output.name == "tanh"]
    parts = [missed("DOP853", known, frame) for known in smooth for frame in range(2)]
    assert len(parts) >= 6
    assert 0.0 < max(parts) <= 1.0
