"""The cost of a program on an array, before any hardware is chosen."""

import cnnum


@cnnum.program
def outline(frame):
    """Whether something touches, and its outline."""
    touched = frame.normal > 0.1
    edges = cnnum.apply(cnnum.get_template("EDGE"), input=touched.picture())
    return {"contact": touched.any(), "outline": edges.black()}


engine = cnnum.Engine("numba")
for wanted in (["contact"], ["contact", "outline"]):
    plan = engine.compile(outline, shape=(8, 8), needs=wanted)
    cost = plan.explain()
    print(plan, cost.flops, "flops,", cost.bytes_out, "bytes out,", len(cost.left_out), "left out")
assert engine.compile(outline, (8, 8), ["contact"]).explain().flops < cost.flops
