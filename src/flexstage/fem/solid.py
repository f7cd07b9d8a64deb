"""A stage in three dimensions: layers of curved prisms through half of its thickness."""

from flexstage import progress
from flexstage.elasticity import Continuum
from flexstage.elasticity.resources import require_memory
from flexstage.fem.geometry import MOUNTING, stage_faces
from flexstage.fem.mesh import MIDDLE, MeshSettings, prism_mesh
from flexstage.fem.model import StageModel, assemble
from flexstage.fem.plane import common_validity
from flexstage.fem.ports import Supports
from flexstage.stage import Stage

#: Modes that are kept besides the static responses, in the plane and out of it.
MODES = (12, 8)


def solid_model(
    stage: Stage,
    settings: MeshSettings | None = None,
    *,
    modes: tuple[int, int] = MODES,
    supports: Supports = "rigid",
) -> StageModel:
    """Return the finite-element model of a stage in three dimensions.

    A plate that is driven in its middle plane moves in two ways that do not mix: symmetric about
    that plane, which is motion in the plane, and the opposite, which is motion out of it. Each is
    solved on half of the thickness.

    Parameters
    ----------
    stage : Stage
        The stage.
    settings : MeshSettings, optional
        How fine the mesh is; order 4 with elements of 0.8 necks and one layer of prisms through
        half of the thickness where not given.
    modes : tuple of int
        Numbers of modes in the plane and out of it that are kept besides the static responses.
    supports : str
        ``rigid`` where a drive that reacts on a fixed body stands on the ground, as lumped models
        and most published ones have it; ``elastic`` where the frame gives way under it.

    Returns
    -------
    StageModel
        The model, with modes and stiffness out of the plane.

    Raises
    ------
    StageError
        Bodies overlap, nothing holds a body, or a fixed one has nothing to be held by.
    ModelError
        The mesher failed, or the memory does not suffice.

    Notes
    -----
    Validity: small displacements; drives, probes and extra masses act in the middle plane; the
    mounting holes are held over their whole depth.
    """
    settings = settings or MeshSettings()
    progress.update("mesh")
    faces = stage_faces(stage)
    mesh = prism_mesh(stage, faces, settings)
    inside = Continuum(
        mesh,
        stage.material,
        order=settings.order,
        held=MOUNTING,
        held_components={"z": MIDDLE},
        copies=2,
    )
    outside = inside.held_otherwise(MOUNTING, dict.fromkeys("xy", MIDDLE))
    low, high = mesh.ngmesh.bounding_box
    require_memory(
        inside.size,
        3,
        settings.order,
        box=[high[c] - low[c] for c in range(3)],
        layered=settings.layers == 1,
    )
    return assemble(
        stage,
        faces,
        [(inside, modes[0], False), (outside, modes[1], True)],
        settings,
        validity=(
            "3D finite elements: drives, probes and extra masses act in the middle plane of the "
            "plate; mounting holes are fixed over their whole depth.",
            *common_validity(stage, faces.held),
        ),
        choices={
            "model": "solid",
            "order": str(settings.order),
            "neck size": f"{settings.neck_size:g}",
            "layers": f"{settings.layers} through half the thickness",
            "elements": str(mesh.ne),
            "unknowns": str(inside.size),
            "held": faces.held,
        },
        supports=supports,
    )
