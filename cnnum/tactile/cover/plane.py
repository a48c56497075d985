"""The plane model of the dissertation's bump, as shipped: the data of Fig. 6.9–6.14."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cnnum.tactile.checks import Array
from cnnum.tactile.cover.tables import load_arrays

RADIUS = 0.2e-3
"""Of the bump, m."""

MODULUS = 0.87e6
"""Young's modulus of the dissertation's rubber, Pa."""


@dataclass(frozen=True, slots=True)
class PlaneFigures:
    """Plane stress, Ø 0.4 mm on 4 × 2 mm, ν = 0.499, under a rigid plate that does not slip.

    First axis of pairs: pressed down by 50 µm; dragged sideways by 50 µm with the contact of then.
    Second axis of pairs: the component along x, then along z.

    Attributes
    ----------
    x, z : (81,), (51,) float, m
        Places across, and depths below the surface.
    field : (2, 2, 51, 81) float, m
        Displacement in the block (Fig. 6.9).
    axis : (2, 2, 51) float, m
        Displacement below the middle, over z (Fig. 6.10).
    line : (2, 2, 81) float, m
        Displacement at 200 µm, over x.
    stress : (2, 2, 81) float, Pa
        σ_xz and σ_zz at 200 µm, over x (Fig. 6.12).
    strain : (2, 2, 81) float
        ε_xz (tensor) and ε_zz at 200 µm, over x.
    force : (2,) float, N/m
        Force of the plate, for each metre along the third axis.
    indentation : (10,) float, m
        Steps of the pressed plate up to 100 µm (Fig. 6.11, 6.14).
    growth : (10, 4) float, m
        Under the pressed plate at 200 µm: u_x and u_z below the middle, u_z 260 µm to its left
        and right.
    """

    x: Array
    z: Array
    field: Array
    axis: Array
    line: Array
    stress: Array
    strain: Array
    force: Array
    indentation: Array
    growth: Array

    @property
    def normal_to_shear(self) -> float:
        """FzUz over FxUx below the middle at 200 µm, equal indentations; "about two" (6.11)."""
        middle = self.x.size // 2
        return float(self.line[0, 1, middle] / self.line[1, 0, middle])

    @property
    def cross_talk(self) -> float:
        """The larger of FzUx/FzUz and FxUz/FxUx below the middle at 200 µm; "zero" (6.11)."""
        middle = self.line[:, :, self.x.size // 2]
        return float(max(abs(middle[0, 0] / middle[0, 1]), abs(middle[1, 1] / middle[1, 0])))

    @property
    def stress_extrema(self) -> tuple[float, float]:
        """Where the dragged plate's σ_zz at 200 µm is lowest and highest, m (6.12)."""
        values = self.stress[1, 1]
        return float(self.x[values.argmin()]), float(self.x[values.argmax()])

    @property
    def pad_ratio(self) -> float:
        """T_z over T_x of (6.1) at 50 µm, taxels at the extrema of the dragged u_z; "about 4".

        Fig. 6.14 names deformations, so u_z stands for the taxels' signals; of stress the ratio
        is `pad_stress_ratio`.
        """
        place = int(self.line[1, 1].argmax())
        return float(self.line[0, 1, place] / self.line[1, 1, place])

    @property
    def pad_stress_ratio(self) -> float:
        """The same of σ_zz, at the extrema of the dragged σ_zz."""
        place = int(self.stress[1, 1].argmin())
        return float(self.stress[0, 1, place] / self.stress[1, 1, place])

    @property
    def nonlinearity(self) -> float:
        """Largest deviation of FzUz(indentation) from the best straight line, over its range."""
        line = np.polyval(np.polyfit(self.indentation, self.growth[:, 1], 1), self.indentation)
        return float(np.abs(line - self.growth[:, 1]).max() / np.ptp(self.growth[:, 1]))

    @classmethod
    def of_tables(cls, tables: Mapping[str, Array]) -> "PlaneFigures":
        """Return the figures in SI units.

        Parameters
        ----------
        tables : mapping of str to array
            As `cnnum.tactile.cover.fem.generate.plane_tables` gives them: lengths in bump radii,
            stress in Young's moduli.
        """
        return cls(
            x=RADIUS * tables["plane_x"],
            z=RADIUS * tables["plane_z"],
            field=RADIUS * tables["plane_field"],
            axis=RADIUS * tables["plane_axis"],
            line=RADIUS * tables["plane_line"],
            stress=MODULUS * tables["plane_stress"],
            strain=tables["plane_strain"],
            force=MODULUS * RADIUS * tables["plane_force"],
            indentation=RADIUS * tables["plane_indentation"],
            growth=RADIUS * tables["plane_growth"],
        )


def plane_figures() -> PlaneFigures:
    """Return the plane model in SI units, from the data that ships with the package.

    It comes from `cnnum.tactile.cover.fem.generate.regenerate`.
    """
    return PlaneFigures.of_tables(load_arrays())
