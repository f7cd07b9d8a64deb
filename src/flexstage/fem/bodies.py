"""Parts of more than one material."""

from collections.abc import Mapping
from dataclasses import replace

import ngsolve as ng

from flexstage.elasticity import Continuum
from flexstage.errors import ModelError
from flexstage.material import Material


class Bodies(Continuum):
    """A part in three dimensions whose regions are of different materials.

    `materials` gives each region's by its name. `held` is the regular expression of the boundaries
    that are held, `held_components` those held in one direction, by ``x``, ``y``, ``z``; the mesh
    is curved to `order`, and `shift` is as of `Continuum` [rad^2/s^2].

    Notes
    -----
    Loads by volume (gravity, temperature) are those of one material and are not given here.
    """

    def __init__(
        self,
        mesh: ng.Mesh,
        materials: Mapping[str, Material],
        *,
        order: int,
        held: str = "",
        held_components: Mapping[str, str] | None = None,
        shift: float = 0.0,
    ) -> None:
        regions = list(mesh.GetMaterials())
        lacking = [name for name in regions if name not in materials]
        if lacking:
            raise ModelError(
                f"region '{lacking[0]}' has no material: materials are given for "
                f"{', '.join(materials) or 'none'}"
            )
        of = [materials[name] for name in regions]
        super().__init__(
            mesh, of[0], order=order, held=held, held_components=held_components, shift=shift
        )
        shear = [m.youngs_modulus / (2.0 * (1.0 + m.poissons_ratio)) for m in of]
        first = [
            2.0 * g * m.poissons_ratio / (1.0 - 2.0 * m.poissons_ratio)
            for g, m in zip(shear, of, strict=True)
        ]
        # Both only ever multiply fields on the mesh, so that they may differ from region to region.
        self.lame = ng.CoefficientFunction(first)
        self.shear_modulus = ng.CoefficientFunction(shear)  # type: ignore[assignment]
        self.material = replace(of[0], name=" + ".join(dict.fromkeys(m.name for m in of)))
        self._density = self._volume * ng.CoefficientFunction([m.density for m in of])
