"""The reduced model of a stage with interface frames, for multibody and finite-element programs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh, solve

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, StageError
from flexstage.base.short_repr import short_repr
from flexstage.base.version import __version__
from flexstage.export.request import StageExport
from flexstage.export.simulink.matlab_text import cell, mat_file
from flexstage.fem.condensation import Condensed
from flexstage.fem.coupling import Joint, join, own_centre, reference_scales
from flexstage.fem.necks import InterfaceDofs, interface_dofs
from flexstage.fem.substructure import Placed
from flexstage.fem.superelement import SuperelementModel, superelement_model
from flexstage.files.names import file_name
from flexstage.records.datasets import reading
from flexstage.stage import Circle, Drive, Stage
from flexstage.stage.contour import body_contour
from flexstage.stage.outline import Point

#: Degrees of freedom of a frame, in order.
DEGREES_OF_FREEDOM = ("Tx [m]", "Ty [m]", "Tz [m]", "Rx [rad]", "Ry [rad]", "Rz [rad]")
_EACH = len(DEGREES_OF_FREEDOM)
# of these, the motions in the plane and out of it, as `InterfaceDofs` orders them
_OF_WAYS = ([0, 1, 5], [2, 3, 4])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Superelement:
    r"""A free stage or part in the motions of its interface frames and in internal modes.

    .. math:: M\ddot u + C\dot u + K u = f, \quad
        u = (u_1, \ldots, u_n, \eta), \quad
        u_i = (T_x, T_y, T_z, R_x, R_y, R_z)_i

    The internal modes :math:`\eta` have unit modal mass [kg^0.5 m] and all frames held.
    """

    name: str
    """Its name."""
    frames: tuple[str, ...]
    """Names of the frames; the first of a stage is the ground."""
    P: Array
    """Positions of the frames [m], shape (n, 3); their axes are parallel to the common ones."""
    K: Array
    """Stiffness [N/m, N, N m], shape (6 n + k, 6 n + k)."""
    M: Array
    """Mass [kg, kg m, kg m^2], same shape."""
    C: Array
    """Viscous damping [N s/m, N s, N m s], same shape."""
    notes: tuple[str, ...]
    """Meaning of the frames, and limits of validity."""

    __repr__ = short_repr

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Name and unit of each coordinate."""
        of_frames = [f"{frame} {motion}" for frame in self.frames for motion in DEGREES_OF_FREEDOM]
        count = len(self.K) - len(of_frames)
        return (*of_frames, *(f"mode {i + 1} [kg^0.5 m]" for i in range(count)))


class _Way(NamedTuple):
    """Bodies that move in the plane, or out of it."""

    dofs: InterfaceDofs
    rows: list[int]
    """Degrees of freedom of a frame."""
    columns: slice
    """Coordinates of the stage."""
    placed: Sequence[Placed]
    condensed: Sequence[Condensed]
    joint: Joint


def reduced_model(model: SuperelementModel) -> Superelement:
    r"""Return the reduced model of a stage with interface frames.

    Frames are the ground, to which all mounting holes belong, each body that an axis moves, at its
    centre of mass, and each end of a drive on another body, at its patch.

    With the coordinates q relative to the ground, whose motion is r, the rows B of the frames, and
    the rigid motions T of the frames with the ground, the statics of R. R. Craig and M. C. C.
    Bampton, AIAA J. 6 (1968) 1313, are

    .. math:: q = S (u - T r) + N\eta, \quad
        S = K^{-1} B^T (B K^{-1} B^T)^{-1}, \quad B N = 0

    N are combinations of the coordinates of `SuperelementModel.system`, so that S and N contain its
    modes: with the ground held its frequencies are those of the reduced model.

    Parameters
    ----------
    model : SuperelementModel
        The stage by superelements in space.

    Returns
    -------
    Superelement
        The free stage, drives removed.

    Raises
    ------
    ModelError
        The superelements are plane ones.
    StageError
        The stage has no fixed body.

    Notes
    -----
    Validity: linear, about the undeformed stage. Mounting holes move as one rigid body. A frame
    moves with the mean motion of its body, along a drive with the mean of the patch, and its forces
    are distributed accordingly; motions of a body other than these are internal modes. The damping
    is that of the modes with the ground held; the motion of the ground is undamped.
    """
    stage = model.stage
    ways = _ways(model)
    if len(ways) != len(_OF_WAYS):
        raise ModelError(
            "the reduced model needs superelements in space, got plane ones: use space=True"
        )
    ground = _ground(stage)
    names, places, rows, notes = _frames(stage, ways)
    K, M, B = model.joint.K, model.joint.M, np.concatenate(rows)
    response = solve(K, B.T, assume_a="pos")
    stiffness = _symmetric(np.linalg.inv(B @ response))
    static = response @ stiffness
    # of unit mass before the motion of the frames is taken from them; what is left of some is 0
    inner = model.basis - static @ (B @ model.basis)
    masses, turn = eigh(inner.T @ M @ inner)
    left = masses > len(M) * np.finfo(np.float64).eps
    inner = inner @ (turn[:, left] / np.sqrt(masses[left]))
    inner = inner - static @ (B @ inner)
    squares, turn = eigh(inner.T @ K @ inner, inner.T @ M @ inner)
    shapes = np.hstack((static, inner @ turn))
    # relative to the ground
    K_held, M_held = block_diag(stiffness, np.diag(squares)), _symmetric(shapes.T @ M @ shapes)
    values, modes = eigh(K_held, M_held)
    omega = np.sqrt(values)
    zeta = model.system.damping.ratios(omega, np.ones_like(omega))
    weighted = M_held @ modes
    C_held = (weighted * (2.0 * zeta * omega)) @ weighted.T
    # frames less their motion with the ground
    relative = np.eye(len(K_held), _EACH + len(K_held), _EACH)
    relative[: len(B), :_EACH] = -np.concatenate([_carried(ways, ground, at) for at in places])
    coupling, rigid = _inertia_of_ground(stage, ways, ground)
    mixed = relative.T @ (shapes.T @ coupling)
    mass = relative.T @ M_held @ relative
    mass[:, :_EACH] += mixed
    mass[:_EACH] += mixed.T
    mass[:_EACH, :_EACH] += rigid
    return Superelement(
        name=stage.name,
        frames=("ground", *names),
        P=np.array([(x, y, 0.0) for x, y in (ground, *places)]),
        K=_symmetric(relative.T @ K_held @ relative),
        M=_symmetric(mass),
        C=_symmetric(relative.T @ C_held @ relative),
        notes=(
            "SI units; displacements along x, y, z and rotations about them, counter-clockwise, "
            "of frame 1, 2, ..., then internal modes",
            "Drives are removed: a force of a drive acts on the frames at its ends.",
            *notes,
            *model.system.validity,
        ),
    )


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)


def _ways(model: SuperelementModel) -> list[_Way]:
    stage, ways, at = model.stage, [], 0
    each = len(stage.bodies)
    for rows, first in zip(_OF_WAYS, range(0, len(model.placed), each), strict=False):
        placed = model.placed[first : first + each]
        condensed = model.condensed[first : first + each]
        joint = join(stage, placed, condensed)
        columns = slice(at, at + len(joint.coordinates))
        dofs = interface_dofs(placed[0].part.through)
        ways.append(_Way(dofs, rows, columns, placed, condensed, joint))
        at = columns.stop
    return ways


def _ground(stage: Stage) -> Point:
    """Return the middle of the mounting holes, or of the fixed bodies without any."""
    fixed = [body for body in stage.bodies if body.fixed]
    if not fixed:
        raise StageError(f"stage '{stage.name}' has no fixed body and so no ground: fix one")
    holes = [hole.centre for body in fixed for hole in body.mounting_holes]
    x, y = np.mean(holes or [p for b in fixed for p in b.outline.points], axis=0).tolist()
    return x, y


def _frames(
    stage: Stage, ways: Sequence[_Way]
) -> tuple[list[str], list[Point], list[Array], list[str]]:
    """Return name, position and motion of each frame but the ground, and remarks."""
    fixed = {body.name for body in stage.bodies if body.fixed}
    moved = [next(p.body for p in stage.probes if p.name == a.probe) for a in stage.axes]
    frames: dict[str, str] = {}
    places, rows, notes = [], [], []
    for body in dict.fromkeys(moved):
        if body not in fixed:
            frames[body] = body
            places.append(ways[0].joint.ports.bodies[body][0])
            rows.append(_motion(ways, body, places[-1]))
    for drive in stage.drives:
        for which, (verb, body) in enumerate(
            (("pushes", drive.pushes), ("stands on", drive.reacts))
        ):
            if body in fixed:
                notes.append(f"Drive '{drive.name}' {verb} the ground.")
            elif body in frames:
                notes.append(
                    f"Drive '{drive.name}' {verb} frame '{frames[body]}', rigidly at a distance."
                )
            else:
                frames[body] = f"{drive.name} {verb} {body}"
                places.append(drive.at[which])
                rows.append(_motion_of_patch(ways, drive, which, body))
    if not frames:
        raise StageError(
            f"stage '{stage.name}' has no moving frame: give it an axis or a drive on a moving body"
        )
    return list(frames.values()), places, rows, notes


def _motion(ways: Sequence[_Way], body: str, at: Point) -> Array:
    """Return the mean motion of a body at a point, shape (6, n)."""
    rows = np.zeros((_EACH, ways[-1].columns.stop))
    for way in ways:
        centre, motion = way.joint.ports.bodies[body]
        rows[way.rows, way.columns] = way.dofs.transferred(motion, centre, at)
    return rows


def _motion_of_patch(ways: Sequence[_Way], drive: Drive, which: int, body: str) -> Array:
    """Return the motion of a body at the end of a drive, along it that of the patch."""
    rows = _motion(ways, body, drive.at[which])
    plane = ways[0]
    along = np.array([np.cos(drive.direction), np.sin(drive.direction)])
    for p, (at, _) in zip(plane.placed, plane.joint.shares, strict=True):
        for k, uses in enumerate(p.patches):
            if (drive.name, which) in uses:
                more = -along @ rows[:2]
                more[at[len(plane.dofs.necks) * len(p.hinges) + k]] += 1.0
                rows[:2] += np.outer(along, more)
    return rows


def _carried(ways: Sequence[_Way], ground: Point, at: Point) -> Array:
    """Return the rigid motion of a point with the ground, shape (6, 6)."""
    motion = np.zeros((_EACH, _EACH))
    for way in ways:
        motion[np.ix_(way.rows, way.rows)] = way.dofs.transferred(np.eye(3), ground, at)
    return motion


def _inertia_of_ground(stage: Stage, ways: Sequence[_Way], ground: Point) -> tuple[Array, Array]:
    r"""Return M R, shape (n, 6), and :math:`R^T M R`, shape (6, 6), of rigid motions R.

    Of a moving body R is the null space of its stiffness; a fixed one, which has no such
    coordinates, has the inertia of its contour on its mean motion.
    """
    coupling, rigid = np.zeros((ways[-1].columns.stop, _EACH)), np.zeros((_EACH, _EACH))
    for way in ways:
        _, heavy, _ = reference_scales(stage, way.placed[0])
        for p, c, (at, local) in zip(way.placed, way.condensed, way.joint.shares, strict=True):
            centre, motion = own_centre(p, c), c.loads[:3]
            carried = way.dofs.transferred(np.eye(3), ground, centre)
            if p.body.fixed:
                inertia = _inertia_of_body(stage, way, p, heavy * np.array(c.inertia))
                force, square = motion.T @ inertia, inertia
            else:
                shape = _rigid_shape(c)
                force = heavy * c.mass @ shape
                square = shape.T @ force
            force, square = force @ carried, carried.T @ square @ carried
            for extra in p.body.extra_masses:
                with_ground = way.dofs.transferred(np.eye(3), ground, extra.at)
                momentum = way.dofs.inertia(extra)[:, None] * with_ground
                square = square + with_ground.T @ momentum
                if not p.body.fixed:
                    force = force + way.dofs.transferred(motion, centre, extra.at).T @ momentum
            coupling[np.ix_(at + way.columns.start, way.rows)] += local.T @ force
            rigid[np.ix_(way.rows, way.rows)] += square
    return coupling, rigid


def _rigid_shape(condensed: Condensed) -> Array:
    """Return the coordinates of a floating body for unit motions of its centre, shape (r, 3)."""
    interfaces = slice(condensed.interfaces)
    K = condensed.stiffness[interfaces, interfaces]
    # of unit mass: the stiffness of a coordinate that is a rigid motion is rounding
    size = 1.0 / np.sqrt(np.diag(condensed.mass)[interfaces])
    _, free = eigh(K * np.outer(size, size), subset_by_index=(0, 2))
    free = size[:, None] * free
    shape = np.zeros((len(condensed.stiffness), 3))
    shape[interfaces] = free @ np.linalg.inv(condensed.loads[:3, interfaces] @ free)
    return shape


def _inertia_of_body(stage: Stage, way: _Way, placed: Placed, inertia: Array) -> Array:
    """Return the inertia of a body of constant thickness about its centre, shape (3, 3)."""
    mass, _, _, polar = inertia
    if not way.dofs.out_of_plane:
        return np.diag([mass, mass, polar])
    outline, holes = body_contour(stage, placed.body)
    x0, y0 = placed.origin

    def integrals(shape: Any) -> Any:
        loop = shape.loop() if isinstance(shape, Circle) else shape
        return loop.mapped(lambda p: (p[0] - x0, p[1] - y0)).integrals()

    area = integrals(outline)
    for hole in (*holes, *placed.body.mounting_holes):
        area = area.plus(integrals(hole), -1.0)
    x, y = area.x / area.area, area.y / area.area
    across = stage.thickness**2 / 12.0
    about_x, about_y = area.yy / area.area - y * y + across, area.xx / area.area - x * x + across
    product = area.xy / area.area - x * y
    return mass * np.array([[1.0, 0.0, 0.0], [0.0, about_x, -product], [0.0, -product, about_y]])


def read_reduced(path: Path) -> Superelement:
    """Return the reduced model of a .mat file, of `reduced_files` or of others.

    It has K, M and the positions of the frames as P, or as ``int_xyz`` in the super-elements by
    Ansys of T. Dehaeze (github.com/tdehaeze/stewart-simscape); C is 0 where the file has none.

    Raises
    ------
    RecordError
        The file is not readable.
    ModelError
        It has not these matrices, or their shapes do not fit.
    """
    from scipy.io import loadmat

    with reading(path, "a MATLAB", ": save it as level 5"), path.open("rb") as stream:
        read: dict[str, Any] = loadmat(stream)
    # finite-element programs also save sparse matrices
    data = {k: v.toarray() if hasattr(v, "toarray") else v for k, v in read.items()}
    P = data.get("P", data.get("int_xyz"))
    if P is None or "K" not in data or "M" not in data:
        raise ModelError(f"{path} must have P (or int_xyz), K and M, got {_names(data)}")
    K, M = data["K"], data["M"]
    C = data.get("C", np.zeros_like(K))
    fits = P.ndim == 2 and P.shape[1] == 3 and len(K) >= _EACH * len(P)
    if not fits or any(matrix.shape != (len(K), len(K)) for matrix in (K, M, C)):
        raise ModelError(
            f"{path} must have P of n rows of 3, and square K, M and C of 6 n rows or more, got "
            f"{P.shape}, {K.shape}, {M.shape}, {C.shape}"
        )
    names = [str(np.squeeze(name)) for name in data.get("frames", np.zeros((0, 1))).ravel()]
    if len(names) not in (0, len(P)):
        raise ModelError(f"{path} has {len(names)} names of frames for {len(P)} rows of P")
    return Superelement(
        name=path.stem,
        frames=tuple(names or [f"frame {i + 1}" for i in range(len(P))]),
        P=P,
        K=K,
        M=M,
        C=C,
        notes=(),
    )


def _names(data: Mapping[str, Any]) -> str:
    return ", ".join(name for name in data if not name.startswith("__")) or "nothing"


def joined(
    stage: Superelement, part: Superelement, frames: tuple[str, str], turn: Array | None = None
) -> Superelement:
    """Return a stage with another part, one frame of which is on a frame of the stage.

    The part is turned by `turn`, shape (3, 3), and moved until these frames, first of the stage,
    then of the part, have one origin; they move as one. Other frames of the part come after those
    of the stage, with its name before theirs.

    Raises
    ------
    ModelError
        There is no such frame, the name of another would be there twice, or `turn` is no rotation.
    """
    turn = np.eye(3) if turn is None else np.asarray(turn, dtype=np.float64)
    square = turn.shape == (3, 3)
    if not square or not np.allclose(turn @ turn.T, np.eye(3)) or np.linalg.det(turn) < 0.0:
        raise ModelError(
            f"turn must be the matrix of a rotation, of three rows of 3, got {turn.tolist()}"
        )
    a, b = _frame(stage, frames[0]), _frame(part, frames[1])
    others = [i for i in range(len(part.P)) if i != b]
    added = [f"{part.name} {part.frames[i]}" for i in others]
    if twice := next((name for name in added if name in stage.frames), None):
        raise ModelError(
            f"'{stage.name}' already has a frame '{twice}': give the part another name by "
            "dataclasses.replace(part, name=...)"
        )
    count = len(stage.P) + len(others)
    places = [a if i == b else len(stage.P) + others.index(i) for i in range(len(part.P))]
    of_stage, modes = _numbers(list(range(len(stage.P))), len(stage.K), _EACH * count)
    of_part, size = _numbers(places, len(part.K), modes)
    turned = np.eye(len(part.K))
    turned[: _EACH * len(places), : _EACH * len(places)] = np.kron(np.eye(2 * len(places)), turn.T)

    def assembled(first: Array, second: Array) -> Array:
        matrix = np.zeros((size, size))
        matrix[np.ix_(of_stage, of_stage)] += first
        matrix[np.ix_(of_part, of_part)] += turned.T @ second @ turned
        return matrix

    return Superelement(
        name=stage.name,
        frames=(*stage.frames, *added),
        P=np.concatenate((stage.P, (part.P[others] - part.P[b]) @ turn.T + stage.P[a])),
        K=assembled(stage.K, part.K),
        M=assembled(stage.M, part.M),
        C=assembled(stage.C, part.C),
        notes=(*stage.notes, *part.notes),
    )


def _numbers(places: list[int], size: int, first: int) -> tuple[NDArray[np.intp], int]:
    """Return where coordinates go whose frames have these numbers and whose modes begin at first.

    Also returns where the next modes begin.
    """
    of_frames = (_EACH * np.array(places)[:, None] + np.arange(_EACH)).ravel()
    after = first + size - of_frames.size
    return np.concatenate((of_frames, np.arange(first, after))), after


def _frame(model: Superelement, name: str) -> int:
    if name not in model.frames:
        raise ModelError(
            f"'{model.name}' has no frame '{name}': choose from {', '.join(model.frames)}"
        )
    return model.frames.index(name)


def reduced_files(model: Superelement) -> dict[str, bytes]:
    """Return a reduced model as a .mat file and as Nastran OUTPUT4 text.

    ``NAME-reduced.mat`` (level 5) has P, K, M as the block *Reduced Order Flexible Solid* of
    Simscape Multibody takes them (mathworks.com/help/sm/ref/reducedorderflexiblesolid.html), the
    damping C, and names. EXUDYN's ObjectGenericODE2 takes M, C and K.

    ``NAME-reduced.op4`` has KAAX, MAAX and BAAX (damping), named as by EXTSEOUT of Nastran, in the
    same order, and the positions P as PAAX.
    """
    stem = f"{file_name(model.name)}-reduced"
    variables = {
        "P": model.P,
        "K": model.K,
        "M": model.M,
        "C": model.C,
        "frames": cell(model.frames),
        "coordinates": cell(model.coordinates),
        "name": model.name,
        "notes": cell(model.notes),
        "version": f"flexstage {__version__}",
    }
    matrices = {"KAAX": model.K, "MAAX": model.M, "BAAX": model.C, "PAAX": model.P}
    return {f"{stem}.mat": mat_file(variables), f"{stem}.op4": op4_text(matrices).encode("ascii")}


def op4_text(matrices: Mapping[str, Array]) -> str:
    """Return real matrices as OUTPUT4 text of Nastran, dense, in double precision.

    Each has a line of columns, rows, form (6 symmetric, 2 rectangular), type (2 real double), name
    and number format; each column its number, first row and count, then the values; the end is one
    more column. The format is that of MSC Nastran's DMAP module OUTPUT4 with the option for ASCII.
    """
    lines = []
    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        form = 6 if rows == columns and np.array_equal(matrix, matrix.T) else 2
        lines.append(f"{columns:8d}{rows:8d}{form:8d}{2:8d}{name:8s}1P,3E24.16")
        for k, column in enumerate(matrix.T, start=1):
            lines += _op4_column(k, column.nonzero()[0], column)
        lines += [f"{columns + 1:8d}{1:8d}{1:8d}", f"{1.0:24.16E}"]
    return "\n".join((*lines, ""))


def _op4_column(number: int, used: NDArray[np.intp], column: Array) -> list[str]:
    if not used.size:
        return []
    words = [f"{value:24.16E}" for value in column[used[0] : used[-1] + 1].tolist()]
    values = ["".join(words[i : i + 3]) for i in range(0, len(words), 3)]
    return [f"{number:8d}{used[0] + 1:8d}{len(words):8d}", *values]


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format, always by superelements in space."""
    model = reduced_model(superelement_model(stage_export.stage, space=True))
    stage_export.remarks += model.notes
    return reduced_files(model)
