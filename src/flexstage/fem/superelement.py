"""A stage of condensed bodies, as exact as its mesh in small matrices, with error estimates."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.fem.condensation import Condensed
from flexstage.fem.condensed_bodies import condense_all
from flexstage.fem.coupling import Joint, join, joined_stress, lowest, stacked
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.necks import ALONG
from flexstage.fem.stage_system import Supports, coordinate_names, stage_system
from flexstage.fem.substructure import Placed, Substructure, cut_free, in_space
from flexstage.fem.whole_stage import common_validity
from flexstage.files.cache.cache import Cache
from flexstage.hinges.hinge_spring import PLANE_RULE, PlaneState
from flexstage.quantities.characteristic import Characteristics
from flexstage.stage import Stage
from flexstage.system import Analysis, MechanicalSystem, analyse
from flexstage.system.characteristics import NO_LIMIT, scatter_at_points
from flexstage.system.stress_map import StressMap

#: Mesh settings of bodies: elements may grow fast, as stress is that of half notches alone.
BODIES = MeshSettings(neck_size=0.7, grading=0.75)
#: Mesh settings of bodies for differences of figures, whose meshes are moved: their errors cancel.
MOVED_BODIES = replace(BODIES, order=3)
#: Number of modes of each body with fixed interfaces, and of retained modes of the stage.
MODES, STAGE_MODES = 3, 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SuperelementModel:
    """A stage of condensed bodies."""

    stage: Stage
    """The stage."""
    system: MechanicalSystem
    """The stage in its lowest modes and its static responses to drives, probes and loads."""
    placed: tuple[Placed, ...]
    """Bodies as substructures."""
    condensed: tuple[Condensed, ...]
    """Condensed bodies."""
    joint: Joint
    """The joined bodies, in the motions of their interfaces."""
    basis: Array
    """Coordinates of `joint` for each coordinate of `system`, shape (n, r)."""
    mesh_settings: MeshSettings
    """Mesh settings of the bodies."""
    newly_condensed: tuple[str, ...]
    """Bodies that were meshed and condensed for this model; the others were in the cache."""

    __repr__ = short_repr

    @property
    def unknowns(self) -> int:
        """Number of unknowns of all meshes together."""
        return sum(c.unknowns for c in self.condensed)

    @property
    def elements(self) -> int:
        """Number of elements of all meshes together."""
        return sum(c.elements for c in self.condensed)

    def of_other_bodies(self, condensed: Sequence[Condensed]) -> MechanicalSystem:
        """Return the system of the same stage with other condensed bodies."""
        notes = self.system.validity, self.system.settings
        joined = _joined(self.stage, self.placed, condensed)
        return _in_lowest_modes(self.stage, self.placed, condensed, joined, notes)


def superelement_model(
    stage: Stage,
    settings: MeshSettings | None = None,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
    space: bool = False,
    modes: int = MODES,
    supports: Supports = "rigid",
    cache: Cache | Path | str | bool | None = True,
    near: SuperelementModel | None = None,
    moved: bool = False,
) -> SuperelementModel:
    """Return the model of a stage whose bodies are condensed to their necks.

    Each body with its half notches is meshed and condensed by itself (see
    `flexstage.fem.condensation.condense`), and cached: after a change only the affected bodies are
    condensed again. Copies at other places, and other thicknesses or materials with the same mesh
    and Poisson's ratio, need no new condensation.

    Parameters
    ----------
    stage : Stage
        The stage.
    settings : MeshSettings, optional
        Mesh settings of the bodies; `BODIES` where not given.
    plane : str
        ``stress`` or ``strain`` in all notches, or ``auto`` to choose by width against neck; the
        bodies are in plane stress.
    space : bool
        Whether the bodies are those of a plate in space, which moves in its plane and out of it,
        and has no plane state to choose (see
        `flexstage.fem.through_thickness.ThroughThickness`).
    modes : int
        Number of modes of each body with fixed interfaces.
    supports : str
        ``rigid`` where a drive that reacts on a fixed body reacts on the ground; ``elastic`` where
        the frame is compliant.
    cache : Cache or path or bool
        Cache of condensed bodies: True for the user's cache (``$FLEXSTAGE_CACHE``), a directory, or
        False for none.
    near : SuperelementModel, optional
        A model of a stage that differs little. Its bodies that are the same are taken from it, and
        where others differ in the thickness of their necks alone, the change is computed in a block
        about each (see `flexstage.fem.condensed_bodies.with_other_necks`).
    moved : bool
        Whether the meshes of these bodies are moved to the others, so that differences between the
        two models are free of the scatter between meshes.

    Returns
    -------
    SuperelementModel
        The model; its `system` is exact in statics for drives, probes and loads, as far as the
        condensed bodies are.

    Raises
    ------
    StageError
        A body is in pieces, or a fixed one cannot be supported.
    ModelError
        The mesher failed, or a body is not attached.

    Notes
    -----
    Validity: as the plane model. The traction in a neck is that of a notch which is the same on
    both sides; with meshes fine enough, a chain of two bars is within 1e-5 of the plane model in
    displacement and in its first frequencies. At the usual mesh the study's stages are within
    0.02 % of it in ratio, 0.04 % in the first two frequencies and, of finer meshes, 0.4 % in
    stress; with three modes a body, their first twelve are up to 2.8 % high. Stress of a notch is
    that next to bodies of the plate's material, also where they are rigid or of another.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.system import modes
    >>> model = superelement_model(design("parallelogram"), cache=False)
    >>> round(float(modes(model.system).frequency_hz[0]))
    193
    """
    settings = settings or BODIES
    if space and plane != "auto":
        raise ModelError(
            f"superelements in space have no plane state, got '{plane}': leave the option out"
        )
    for body in stage.bodies:
        if not body.fixed and not any(body.name in h.bodies for h in stage.hinges):
            raise ModelError(
                f"body '{body.name}' has no hinge and is not fixed, so it cannot be "
                "condensed: join it by a hinge, or fix it"
            )
    cut = cut_free(stage, settings, plane=plane, modes=modes, supports=supports)
    ways = in_space(stage, cut) if space else (cut,)
    together = [p for bodies in zip(*ways, strict=True) for p in bodies]
    parts = [p.part for p in together]
    condensed, new = condense_all(parts, cache, _interleaved(near), moved=moved)
    of_ways = [condensed[k :: len(ways)] for k in range(len(ways))]
    placed = [p for bodies in ways for p in bodies]
    condensed = [c for bodies_of_motion in of_ways for c in bodies_of_motion]
    joined = _joined(stage, placed, condensed)
    joint = joined[0]
    supports_note = "; ".join(dict.fromkeys(c.supports for c in condensed if c.supports))
    planes = " and ".join(sorted({n.plane for p in cut for n in p.part.necks})) or "stress"
    choices = {
        "model": "superelement-3d" if space else "superelement",
        **({} if space else {"plane": planes}),
        "order": str(settings.order),
        "neck size": f"{settings.neck_size:g}",
        "modes of a body": str(modes),
        "interface coordinates": str(len(joint.coordinates)),
        "elements": str(sum(c.elements for c in condensed)),
        "unknowns": str(sum(c.unknowns for c in condensed)),
        "held": supports_note,
        "supports": supports,
    }
    validity = (
        (
            "Finite elements in space of each body, condensed to its necks, with the lowest "
            "functions through the thickness: drives, probes and extra masses act in the middle "
            "plane of the plate; mounting holes are fixed over their whole depth. Frequencies of "
            "modes that bend single bodies are up to 3 % too high."
        )
        if space
        else (
            f"Plane finite elements of each body, condensed to its necks: plane {planes} at the "
            f"notches ({PLANE_RULE}), plane stress in the bodies; out-of-plane motion is not "
            "modelled. Frequencies of modes that bend single bodies are up to 3 % too high."
        ),
        *common_validity(stage, supports_note),
    )
    return SuperelementModel(
        stage=stage,
        system=_in_lowest_modes(stage, placed, condensed, joined, (validity, choices)),
        placed=tuple(placed),
        condensed=tuple(condensed),
        joint=joint,
        basis=joined[1],
        mesh_settings=settings,
        newly_condensed=tuple(dict.fromkeys(together[i].body.name for i in new)),
    )


def _interleaved(model: SuperelementModel | None) -> list[tuple[Substructure, Condensed]]:
    """Return the bodies of a model, body by body in each motion, in and out of the plane."""
    if model is None:
        return []
    count = len(model.stage.bodies)
    pairs = [(p.part, c) for p, c in zip(model.placed, model.condensed, strict=True)]
    return [pair for i in range(count) for pair in pairs[i::count]]


def _joined(
    stage: Stage, placed: Sequence[Placed], condensed: Sequence[Condensed]
) -> tuple[Joint, Array, Array, tuple[str, ...]]:
    """Join bodies, combine decoupled motions, and reduce them to the lowest modes.

    Returns the joined bodies, their coordinates for each one of the system, the frequencies of
    these [rad/s], and their names.
    """
    each = len(stage.bodies)
    ways = (slice(k, k + each) for k in range(0, len(placed), each))
    joints = [join(stage, placed[way], condensed[way]) for way in ways]
    bases, omegas, names = [], [], []
    for k, joint in enumerate(joints):
        omega, basis, is_mode = lowest(joint, STAGE_MODES if k == 0 else STAGE_MODES // 2)
        names += coordinate_names(omega, is_mode, out_of_plane=k > 0)
        bases.append(basis)
        omegas.append(omega)
    return stacked(joints), np.asarray(block_diag(*bases)), np.concatenate(omegas), tuple(names)


def _in_lowest_modes(
    stage: Stage,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    joined: tuple[Joint, Array, Array, tuple[str, ...]],
    notes: tuple[tuple[str, ...], Mapping[str, str]],
) -> MechanicalSystem:
    """Return the system of the bodies of `_joined` in its lowest modes."""
    joint, basis, omega, names = joined
    stress = joined_stress(stage, joint, placed, condensed, basis)
    coordinates = np.eye(omega.size), np.diag(omega**2), names
    ports = joint.ports.changed(lambda rows: rows @ basis)
    return stage_system(stage, ports, coordinates, stress, notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Margins:
    """Factors and margins of `with_estimates`."""

    of_order: float = 1.5
    """Factor on the change by a lower order."""
    of_modes: float = 1.25
    """Factor on the change by more modes."""
    by_neck: int = 6
    """Modes of a body by neck, and twice as many as the model has at least."""
    least: float = 2e-5
    """Relative scatter by meshes of figures that the mechanism alone determines."""
    least_in_space: float = 2e-4
    """The same in three dimensions, with the error of the functions through the thickness."""
    least_of_stress: float = 2e-2
    """Relative scatter of a stress, which is read at points."""


_MARGINS = _Margins()
_OF_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
_OF_COEFFICIENTS = ("thermal_drift_in_place", "thermal_rotation_in_place")
_WORDS = (
    "Uncertainties are estimated from bodies of a lower order and from bodies with more modes, and "
    "exclude errors of geometry, material and supports."
)
_BETWEEN = 33  # places along an edge at which the stress between its points is looked at


def with_estimates(
    analysis: Analysis,
    model: SuperelementModel,
    cache: Cache | Path | str | bool | None = True,
) -> Analysis:
    r"""Return an analysis of condensed bodies with estimates of its errors as uncertainties.

    The bodies are condensed once more on their meshes, one order below and with more modes: six for
    each neck, and twice as many at least. With all these modes a figure is :math:`g`, with as many
    as the model has it is :math:`f'`, and the model's own is :math:`f`. The estimate

    .. math:: u = 1.5\,|f - f'| + 1.25\,|f' - g| + \varepsilon |f|

    includes the errors by the order and by the modes, with :math:`\varepsilon` 0.002 % for the
    scatter from mesh to mesh, or in space 0.02 % for the error of the functions through the
    thickness. A stress has in addition 2 % of its value, as it is read at points, the scatter of
    the elements about its point, and the rise of the stress between the points on an edge.

    Raises
    ------
    ModelError
        The model is of order 1, below which there is no order.

    Notes
    -----
    The space of the lower order is a part of the other one, so that energies, and with them
    frequencies, change one way. At corners without a radius their errors fall with the order p as
    :math:`p^{-4\lambda}`, :math:`\lambda` from 0.5 for a slit to 0.54 for a right angle (I.
    Babuska, M. Suri, SIAM Review 36 (1994) 578), so that the remaining error is 1.1 to 1.3 of the
    change from 3 to 4; elsewhere they fall by far more. The error by the modes of a body hardly
    depends on its mesh. Factors and margins are those with which the estimate held on about 50
    random stages; other random stages were then used to count how often it holds
    (``tests/estimates_held.py``).
    """
    coarse, rich = (
        analyse(model.stage, model.of_other_bodies(bodies)) for bodies in _coarser(model, cache)
    )
    in_space = any(p.part.through.in_space for p in model.placed)
    least = _MARGINS.least_in_space if in_space else _MARGINS.least
    stress = model.system.stress
    excess = 0.0
    if stress is not None:
        excess = max(
            (_excess_between_points(stress, a.static.q) for a in analysis.axes), default=0.0
        )
    tables = [{(r.quantity, r.axis): r.value for r in a.characteristics} for a in (coarse, rich)]
    rows = []
    for row in analysis.characteristics:
        key = (row.quantity, row.axis)
        if all(key in table for table in tables) and NO_LIMIT not in row.note:
            left = float(_error_estimate(row.value, *(table[key] for table in tables)))
            if row.quantity in _OF_STRESS:
                left += (excess + _MARGINS.least_of_stress) * abs(row.value)
                left += scatter_at_points(row)
            if row.quantity in _OF_COEFFICIENTS:
                left = math.hypot(left, row.uncertainty or 0.0)
            if left:
                left += least * abs(row.value)
            # what is a figure of the drawing alone has none
            rows.append(replace(row, uncertainty=left or None))
        else:
            rows.append(row)
    estimated_modes = {}
    for condition, modes_here in analysis.modes.items():
        f = [a.modes[condition].frequency_hz for a in (analysis, coarse, rich)]
        count = min(map(len, f))
        errors = _error_estimate(*(values[:count] for values in f)) + least * f[0][:count]
        estimated_modes[condition] = replace(modes_here.lowest(count), uncertainty_hz=errors)
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        modes=estimated_modes,
        validity=(*analysis.validity, _WORDS),
    )


def _error_estimate(fine: Array | float, coarse: Array | float, rich: Array | float) -> Array:
    return _MARGINS.of_order * np.abs(np.subtract(fine, coarse)) + _MARGINS.of_modes * np.abs(
        np.subtract(coarse, rich)
    )


def _coarser(
    model: SuperelementModel, cache: Cache | Path | str | bool | None
) -> tuple[list[Condensed], list[Condensed]]:
    """Condense the bodies of a model in a lower order: with as many modes, and with more."""
    fine = model.mesh_settings
    if fine.order == 1:
        raise ModelError(
            "elements of order 1 have no lower order for an estimate: take order 2 or more"
        )
    mesh = replace(fine, order=fine.order - 1)
    parts_of_model = [p.part for p in model.placed]
    parts = [
        replace(p, mesh=mesh, modes=max(_MARGINS.by_neck * len(p.necks), 2 * p.modes))
        for p in parts_of_model
    ]
    # body by body, as both motions of one in space share its mesh
    each = len(model.stage.bodies)
    order = [i for k in range(each) for i in range(k, len(parts), each)]
    condensed, _ = condense_all([parts[i] for i in order], cache)
    rich = [c for _, c in sorted(zip(order, condensed, strict=True), key=lambda pair: pair[0])]
    return [fewer_modes(c, p.part.modes) for c, p in zip(rich, model.placed, strict=True)], rich


def fewer_modes(body: Condensed, count: int) -> Condensed:
    """Return a body as if it had been condensed with a smaller number of modes."""
    size = body.stiffness.shape[0]
    omitted = np.arange(body.modes.start + count, body.modes.stop)
    if not omitted.size:
        return body
    basis = np.eye(size)
    # what they do under loads is a part of the responses to these again
    squares = np.diag(body.stiffness)[omitted]
    basis[omitted, body.inner] = (body.loads[:, omitted] / squares).T
    basis = np.delete(basis, omitted, axis=1)
    m = body.interfaces
    return replace(
        body,
        stiffness=basis.T @ body.stiffness @ basis,
        mass=basis.T @ body.mass @ basis,
        loads=body.loads @ basis,
        reactions=body.reactions @ basis[m:, m:],
    )


def _excess_between_points(stress: StressMap, q: Array) -> float:
    """Return the relative excess of the stress between points on an edge over that at points."""
    values = stress.equivalent(q).reshape(-1, len(ALONG))
    if not values.size or not (largest := values.max()):
        return 0.0
    powers = np.vander(np.array(ALONG))
    between = np.vander(np.linspace(0.0, 1.0, _BETWEEN), len(ALONG)) @ np.linalg.inv(powers)
    return max(float((values @ between.T).max() / largest) - 1.0, 0.0)
