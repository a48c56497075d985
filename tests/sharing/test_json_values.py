"""Values as JSON has them."""

import json

import numpy as np

from cnnum.sharing import json_value


def test_what_json_has_no_form_for_is_changed_and_the_rest_stays():
    given = {
        2: (1, 2.5, True, None, "a"),
        "bad": [float("nan"), float("inf"), -np.inf, np.float32("nan")],
        "numbers": (np.float64(0.1), np.int32(3), np.bool_(True)),
    }
    wanted = {"2": [1, 2.5, True, None, "a"], "bad": [None] * 4, "numbers": [0.1, 3, True]}
    assert json_value(given) == wanted
    assert json.loads(json.dumps(json_value(given), allow_nan=False)) == wanted
