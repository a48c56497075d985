"""Random programs give the same on every engine: arithmetic, logic, read-outs, memories, templates.

All numbers are multiples of 1/8 and every operation keeps them so, small enough to be exact in
float32: engines must agree to the bit, thresholds and flags included.
"""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import cnnum

SHAPE = (3, 4)
NEIGHBOURS = [[0, 1, 0], [1, 2, -1], [0, 0, 1]]


def shifted_sum(boundary):
    """A = 0 at equilibrium: B∗u + z, without a step and without rounding."""
    return cnnum.Template(
        "sum", [[0]], NEIGHBOURS, 0.5, boundary=boundary, duration="settle", output="linear"
    )


# each step takes two earlier fields (maps or numbers) and makes one; names show which failed
STEPS = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "smaller": cnnum.minimum,
    "larger": cnnum.maximum,
    "size": lambda a, b: abs(a),
    "half": lambda a, b: cnnum.where(abs(a) > 64.0, a - a, a),
    "where": lambda a, b: cnnum.where(a > b, a, b),
    "picture": lambda a, b: (a >= b).picture(),
    "logic": lambda a, b: cnnum.where((a > 0.0) ^ (b > 0.0), 1.0, 0.0),
}
ON_MAPS = {
    "sum": lambda a: a.sum(),
    "max": lambda a: a.max(),
    "min": lambda a: a.min(),
    "count": lambda a: (a > 0.0).count(),
    "any": lambda a: cnnum.where((a > 2.0).any(), 1.0, -1.0),
    "neighbours": lambda a: cnnum.apply(shifted_sum("periodic"), input=a),
    "rim": lambda a: cnnum.apply(shifted_sum(-1.0), input=a),
    "moved": lambda a: cnnum.shift(a, 1, -1, boundary="zero-flux"),
}


@st.composite
def programs(draw):
    count = draw(st.integers(3, 14))
    plan = []
    for _ in range(count):
        kind = draw(st.sampled_from(["two", "map", "before", "loop"]))
        name = draw(st.sampled_from(sorted(STEPS if kind in ("two", "loop") else ON_MAPS)))
        plan.append((kind, name, draw(st.integers(0, 99)), draw(st.integers(0, 99))))

    def built(frame):
        fields = [frame.a, frame.b]
        for kind, name, i, j in plan:
            a, b = fields[i % len(fields)], fields[j % len(fields)]
            maps = [f for f in fields if not f.scalar]
            if kind == "before":
                made = frame.previous(a)
            elif kind == "map":
                made = ON_MAPS[name](maps[i % len(maps)])
            elif kind == "loop":
                step = STEPS[name]
                run = cnnum.loop(lambda x, b=b, step=step: bounded(step(x, b)), maps[0], limit=3)
                made = cnnum.where(run.finished, run.value, run.value + 1.0)
            else:
                made = STEPS[name](a, b)
            fields.append(bounded(made))
        return {f"f{n}": field for n, field in enumerate(fields[2:])}

    return cnnum.program(built)


def bounded(field):
    """Values beyond 64 start again at their sign, so that nothing outgrows 24 bits."""
    return cnnum.where(abs(field) > 64.0, cnnum.where(field > 0.0, 1.0, -1.0), field)


@settings(max_examples=12, deadline=None)
@given(
    program=programs(),
    precision=st.sampled_from(["float32", "float64"]),
    seed=st.integers(0, 2**16),
    batch=st.sampled_from([(), (3,), (17,)]),
)
def test_random_programs_agree_to_the_bit(engines, reference, program, precision, seed, batch):
    rng = np.random.default_rng(seed)
    chosen = {label: engine for label, engine in engines.items() if precision in label}
    frames = rng.integers(-16, 17, (3, *batch, *SHAPE, 2)) / 8.0
    streams = {
        label: engine.compile(program, SHAPE, channels=("a", "b")).stream(batch)
        for label, engine in {**chosen, "reference": reference}.items()
    }
    for frame in frames:
        answers = {label: stream.push(frame) for label, stream in streams.items()}
        expected = answers.pop("reference")
        for label, got in answers.items():
            for name, value in expected.items():
                np.testing.assert_array_equal(got[name], value, err_msg=f"{label}: {name}")
