"""Finite elements behind the shipped influence of a bump: only who regenerates it needs this.

The way: `geometry` (a mapped mesh of quadrangles) → `space` (scalar bases and their matrices) →
`section` (plane stress, or a Fourier mode of a body of revolution) → `body` (assembled and
factorised) → `plate` (a rigid plate that sticks) → `plane`, `revolution` (the two models) →
`generate` (the tables). The library is scikit-fem, in the extra "fem".
"""
