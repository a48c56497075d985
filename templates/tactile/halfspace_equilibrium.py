"""The full equation of elastic equilibrium under a cover, relaxed on layers of depth."""

from collections.abc import Mapping

from cnnum.graph.nodes import RunSpec
from cnnum.integrators.spectrum import spectrum
from cnnum.programs import program
from cnnum.programs.fields import Field, total
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import Applied, apply, transient
from cnnum.templates.tactile.cover_model.elastic_lattice import ElasticLattice, Form, matched
from cnnum.templates.tactile.cover_model.fields import depth_in_cells
from cnnum.templating.template import Template

PATIENCE = 1e7
"""Time constants after which the relaxation gives up; that of ν = 0.499 on 16×16 cells is 1e6."""


@program
def halfspace_equilibrium(
    frame: FrameFields,
    *,
    thickness: float = 3.0e-3,
    pitch: float = 1.5e-3,
    cells: int = 1,
    youngs_modulus: float = 0.87e6,
    poisson: float = 0.49,
    layers: int = 2,
    slabs: int = 8,
    tolerance: float = 5e-3,
    method: str = "auto",
    match: bool = True,
) -> Mapping[str, Field]:
    """Compute displacement, stress and strain at the taxels of a compressible cover.

    This solves equation (4.8) of Vásárhelyi's dissertation (2007), as its author proposed, on a
    CNN: each slab has three layers of displacement, coupled by Hooke's law, which move until all
    forces vanish. Displacements are relative to the base.

    Parameters
    ----------
    frame, thickness, pitch, cells
        As in `halfspace_stress`, but the loads go on periodically beyond the rim.
    youngs_modulus : float, Pa
        Young's modulus of the cover.
    poisson : float
        Poisson's ratio, from 0 to below 1/2; the time to equilibrium goes as 1/(1 − 2ν).
    layers : int
        Slabs between surface and taxels.
    slabs : int
        Total number of slabs: the base lies at thickness · slabs / layers and does not move.
    tolerance : float
        Relative error of the displacements that is allowed if the equilibrium is reached in steps.
        For a nearly incompressible cover, single precision cannot distinguish rates from rounding
        errors in this case, and raises an error: use float64.
    method : str
        Integration method. "auto" computes the equilibrium of up to 1024 cells as one exact
        product, unless there are many slabs, and takes Runge–Kutta–Chebyshev steps on larger
        arrays.
    match : bool
        Whether to attenuate short waves of the loads, which the lattice damps too little on the way
        to the taxels. If false, the result is that of the lattice itself.

    Returns
    -------
    mapping
        `displacement_x`, `displacement_y`, `displacement_z`, m; `stress_xz`, `stress_yz`,
        `stress_zz`, Pa; `strain_xz`, `strain_yz` (tensor shear), `strain_zz`: maps.

    Raises
    ------
    ProgramError
        If a size or Poisson's ratio is out of range.
    """
    refuse_outside(
        youngs_modulus=(youngs_modulus, 1e-9, 1e15),
        tolerance=(tolerance, 1e-12, 1.0),
        slabs=(slabs, 0, 64),
        layers=(layers, 1, 64),
    )
    lattice = ElasticLattice(slabs, depth_in_cells(thickness, pitch, cells) / layers, poisson)
    refuse_outside(layers=(layers, 1, slabs - 1))
    template = lattice.template()
    # the change left to come is the rate where it rests, over that of the slowest wave
    rest = tolerance * float((-spectrum(template, frame.shape).values.real).min())
    spec = RunSpec(method=method, rtol=rest, atol=rest, settle_limit=PATIENCE)
    loads = [frame.channel(c) for c in ("shear_x", "shear_y", "normal")]
    if match:
        nearer = matched(lattice.slab * layers, lattice.slab)
        loads = [apply(nearer, input=load) for load in loads]
    relaxed = transient(template, input=loads, spec=spec)
    shear_modulus = youngs_modulus / (2.0 * (1.0 + poisson))
    return _read(relaxed, lattice, layers, pitch / cells, shear_modulus)


def _read(
    relaxed: Applied, lattice: ElasticLattice, plane: int, cell: float, shear_modulus: float
) -> dict[str, Field]:
    """Return strain or stress on the taxels' plane; states: displacements over cell / modulus."""
    numbers = {key: n for n, key in enumerate(lattice.forces())}

    def value(form: Form, factor: float = 1.0) -> Field:
        layers = dict.fromkeys((q, s) for q, s, _, _ in form.terms)
        return total([_weighed(relaxed.states[numbers[k]], form, k, factor) for k in layers])

    fields: dict[str, Field] = {}
    for axis in "xy":
        between = lattice.displacement(axis, plane - 1) + lattice.displacement(axis, plane)
        move, shear = 0.5 * between.centred(axis), lattice.shear_stress(axis, plane).centred(axis)
        fields[f"displacement_{axis}"] = value(move, cell / shear_modulus)
        fields[f"stress_{axis}z"] = value(shear)
        fields[f"strain_{axis}z"] = value(shear, 0.5 / shear_modulus)
    above, below = lattice.displacement("z", plane - 1), lattice.displacement("z", plane + 1)
    stretch = (0.5 / lattice.slab) * (below - above)
    fields["displacement_z"] = value(lattice.displacement("z", plane), cell / shear_modulus)
    fields["stress_zz"] = value(lattice.level_stress(plane))
    fields["strain_zz"] = value(stretch, 1.0 / shear_modulus)
    return fields


def _weighed(state: Field, form: Form, key: tuple[str, int], factor: float) -> Field:
    """Return the share of one layer in a form."""
    own = {(r, c): factor * w for (q, s, r, c), w in form.terms.items() if (q, s) == key}
    if list(own) == [(0, 0)]:
        return own[0, 0] * state
    kernel = [[own.get((r, c), 0.0) for c in (-1, 0, 1)] for r in (-1, 0, 1)]
    still = Template("neighbours", [[0.0]], kernel, boundary="periodic", output="linear")
    return apply(still, input=state)
