"""Finite elements behind the shipped influence of a bump: only who regenerates it needs this.

The way: `geometry` → `space` → `section` → `body` → `plate` → `plane`, `revolution` → `generate`.
`geometry` is a mapped mesh of quadrangles. `space` has scalar bases and their matrices. `section`
is plane stress, or a Fourier mode of a body of revolution. `body` is assembled and factorised.
`plate` is a rigid plate that sticks. `plane` and `revolution` are the two models, `generate` makes
the tables. The library is scikit-fem, in the extra "fem".
"""
