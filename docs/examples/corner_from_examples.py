"""A corner detector from examples, its margin, and chips of 10 % mismatch with a trim."""

import numpy as np

from cnnum import Engine, get_template
from cnnum.design.designing import Spec, designed
from cnnum.templating.batch import TemplateBatch

CHIPS, MISMATCH, TRIMS = 200, 0.10, np.linspace(-2.4, 2.4, 13)

rng = np.random.default_rng(0)
engine = Engine("numba")
corner = get_template("CORNER")  # answers for the examples, and for pictures that no design sees
pictures, unseen = np.where(rng.random((2, 16, 8, 8)) > 0.45, 1.0, -1.0)
answers, wanted = (np.sign(engine.run(corner, input=u).output) for u in (pictures, unseen))

examples = tuple((u, None, y) for u, y in zip(pictures, answers, strict=True))
(made,) = designed(Spec("MY_CORNER", examples=examples, mismatch=(0.02, 0.10)), engine)
template, proof = made.entry.template, made.entry.proof
print(f"{proof.examples} neighbourhoods; relative margin {100 * proof.relative_margin:.1f} %,")
print(f"and no template has more than {100 * proof.bound:.1f} %")
print(f"worst case: all weights off at once by less than {100 * proof.worst_case:.1f} %")

# chips: every weight is off by a normal share of itself; each is run at every trim of its bias
off = {
    part: getattr(template, part)
    * (1.0 + MISMATCH * rng.normal(size=(CHIPS, *getattr(template, part).shape)))
    for part in ("A", "B", "z")
}
z = off["z"][:, np.newaxis] + TRIMS[:, np.newaxis]
chips = TemplateBatch(template, off["A"][:, None, None], off["B"][:, None, None], z[:, :, None])


def wrong_cells(inputs, outputs):
    """Return the cells that each chip gets wrong at each trim, (chips, trims)."""
    return ((engine.run(chips, input=inputs).output > 0) != (outputs > 0)).sum(axis=(2, 3, 4))


# a chip is trimmed on the pictures of the design, and judged on those that neither has seen
best = wrong_cells(pictures, answers).argmin(axis=1)
judged = wrong_cells(unseen, wanted) > 0
before, after = judged[:, np.abs(TRIMS).argmin()].mean(), judged[np.arange(CHIPS), best].mean()
print(f"chips with a wrong cell: {100 * before:.1f} %, with a trimmed bias {100 * after:.1f} %")
assert after < before / 2
