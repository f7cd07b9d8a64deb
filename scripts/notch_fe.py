"""Solve notches by plane-stress finite elements and write tests/literature/notch-fe.csv.

    pip install scikit-fem gmsh meshio
    python scripts/notch_fe.py

One half of the notch and an end block of the height of its root are meshed with curved quadratic
triangles and loaded at the end of the block with the tractions of a beam. The compliance about the
neck is twice the work of the loads, less the beam compliance of the blocks, so what is left is the
notch with its root. Nothing here uses the formulas that the table is compared with. The notches are
listed in tests/literature/notch_fe_table.py.
"""

import csv
import sys
import tempfile
from pathlib import Path

import gmsh
import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP2, ElementVector, FacetBasis, LinearForm, MeshTri2
from skfem.helpers import ddot, sym_grad, trace

from flexstage.hinges import Profile

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE / "tests" / "literature"))

from notch_fe_table import CASES, POISSON  # noqa: E402

BLOCK = 1.0  # length of the end block, in heights of the root


def mesh(profile: Profile, refine: float) -> MeshTri2:
    """Mesh the half x > 0 of a notch and its end block, finer where stress is."""
    t, height = profile.neck_thickness, profile.root_height
    end = 0.5 * profile.length + BLOCK * height
    geo = gmsh.model.geo
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("notch")
    coarse = height / 12.0
    pieces = []
    for piece in profile.pieces():
        probe = piece(np.array([0.0, 0.5, 1.0]))[2]
        # splines leave their ends along a chord, so points crowd there
        v = np.linspace(0.0, 1.0, 2 if np.ptp(probe) == 0.0 else 81)
        u = np.sin(0.5 * np.pi * v) ** 2
        x, depth, _, _ = piece(u)
        points = np.column_stack([x, depth])
        # some profiles crowd their parameter at the neck; closer points would only spoil the mesh
        apart = np.hypot(*np.diff(points, axis=0).T) > 1e-4 * profile.length
        pieces.append(points[np.append(True, apart)])
    last = pieces[-1][-1]
    if last[1] < profile.depth * (1.0 - 1e-9):
        pieces.append(np.array([last, [last[0], profile.depth]]))

    def side(sign: float) -> list[int]:
        """Curves from the neck to the end of the block along one surface."""
        curves = []
        start: int | None = None
        for points in [*pieces, np.array([pieces[-1][-1], [end, profile.depth]])]:
            xy = np.column_stack([points[:, 0], sign * (0.5 * t + points[:, 1])])
            tags = [geo.addPoint(x, y, 0.0, coarse) for x, y in xy[1:]]
            first = geo.addPoint(*xy[0], 0.0, coarse) if start is None else start
            corners.append(first)
            line = geo.addLine if len(tags) == 1 else None
            curves.append(line(first, tags[0]) if line else geo.addSpline([first, *tags]))
            start = tags[-1]
        corners.append(start)
        return curves

    corners: list[int] = []
    top = side(1.0)
    top_neck, top_end = corners[0], corners[-1]
    fine_curves = list(top[:-1])
    sharp = list(corners[1:-1])
    if profile.one_sided:
        low_neck = geo.addPoint(0.0, -0.5 * t, 0.0, coarse)
        low_end = geo.addPoint(end, -0.5 * t, 0.0, coarse)
        low = [geo.addLine(low_neck, low_end)]
    else:
        corners = []
        low = side(-1.0)
        low_neck, low_end = corners[0], corners[-1]
        fine_curves += low[:-1]
        sharp += corners[1:-1]
    neck = geo.addLine(low_neck, top_neck)
    edge = geo.addLine(low_end, top_end)
    loop = geo.addCurveLoop([*low, edge, *[-c for c in reversed(top)], -neck])
    geo.addPlaneSurface([loop])
    geo.synchronize()
    field = gmsh.model.mesh.field
    near = field.add("Distance")
    field.setNumbers(near, "CurvesList", [*fine_curves, neck])
    field.setNumber(near, "Sampling", 200)
    band = field.add("Threshold")
    for name, value in (
        ("InField", near), ("SizeMin", refine * t), ("SizeMax", coarse),
        ("DistMin", 0.5 * t), ("DistMax", 2.0 * height),
    ):  # fmt: skip
        field.setNumber(band, name, value)
    fields = [band]
    # a sharp corner is refined geometrically towards its singularity
    corner = field.add("Distance")
    field.setNumbers(corner, "PointsList", sharp)
    graded = field.add("MathEval")
    field.setString(graded, "F", f"{5e-4 * t} + {0.25} * F{corner}")
    fields.append(graded)
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "notch.msh"
        gmsh.write(str(path))
        gmsh.finalize()
        return MeshTri2.load(path)


def solve(profile: Profile, refine: float = 1.0 / 12.0) -> dict[str, float]:
    """Return compliances times E b of a notch with its root, and stress factors at the neck."""
    height, t = profile.root_height, profile.neck_thickness
    x0 = 0.5 * profile.length
    end = x0 + BLOCK * height
    middle = 0.5 * profile.depth if profile.one_sided else 0.0
    grid = mesh(profile, refine)
    basis = Basis(grid, ElementVector(ElementTriP2()), intorder=4)
    mu = 0.5 / (1.0 + POISSON)
    lam = POISSON / (1.0 - POISSON**2)

    @BilinearForm
    def stiffness(u, v, _):
        e, f = sym_grad(u), sym_grad(v)
        return 2.0 * mu * ddot(e, f) + lam * trace(e) * trace(f)

    K = stiffness.assemble(basis).tocsc()
    tol = 1e-9 * end
    loaded = FacetBasis(
        grid, basis.elem, facets=grid.facets_satisfying(lambda x: x[0] > end - tol), intorder=6
    )

    def load(axial: float, shear: float, moment: float) -> np.ndarray:
        @LinearForm
        def traction(v, w):
            y = w.x[1] - middle
            normal = axial / height - 12.0 * moment * y / height**3
            return normal * v[0] + shear * 1.5 / height * (1.0 - 4.0 * y**2 / height**2) * v[1]

        return traction.assemble(loaded)

    loads = {
        "N": load(1.0, 0.0, middle),
        "V": load(0.0, 1.0, -end),
        "M": load(0.0, 0.0, 1.0),
    }
    at = basis.doflocs
    plane = np.flatnonzero(np.abs(at[0]) < tol)
    # degrees of freedom of a vector element alternate: u, v
    is_u = np.zeros(basis.N, dtype=bool)
    is_u[basis.nodal_dofs[0]] = True
    is_u[basis.facet_dofs[0]] = True
    order = plane[np.argsort(at[1][plane])]
    low, high = order[0], order[-1]
    u_plane, v_plane = plane[is_u[plane]], plane[~is_u[plane]]
    lows = {i for i in order if at[1][i] == at[1][low]}
    v_low = next(i for i in lows if not is_u[i])
    u_ends = [i for i in plane if is_u[i] and at[1][i] in (at[1][low], at[1][high])]

    def displacement(fixed: np.ndarray, names: str) -> dict[str, np.ndarray]:
        free = np.setdiff1d(np.arange(basis.N), fixed)
        factor = splu(K[free][:, free])
        out = {}
        for name in names:
            u = np.zeros(basis.N)
            u[free] = factor.solve(loads[name][free])
            out[name] = u
        return out

    u = displacement(np.append(u_plane, v_low), "NM")
    u |= displacement(np.concatenate([v_plane, u_ends]), "V")
    i0, i2 = end - x0, (end**3 - x0**3) / 3.0
    block = {
        "NN": i0 / height + 12.0 * middle**2 * i0 / height**3,
        "MM": 12.0 * i0 / height**3,
        "NM": 12.0 * middle * i0 / height**3,
        "VV": 12.0 * i2 / height**3 + 2.4 * (1.0 + POISSON) * i0 / height,
    }
    result = {
        f"C_{pair}": 2.0 * (float(loads[pair[0]] @ u[pair[1]]) - block[pair])
        for pair in ("NN", "VV", "MM", "NM")
    }
    if not profile.one_sided:
        del result["C_NM"]  # zero but for rounding
    if profile.flat_length == 0.0:
        for name, nominal in (("N", 1.0 / t), ("M", 6.0 / t**2)):
            for where, y in (("left", 0.5 * t), ("right", -0.5 * t)):
                sigma = _surface_stress(basis, u[name], y, lam, mu)
                result[f"K{name}_{where}"] = abs(sigma) / nominal
    result["dofs"] = basis.N
    return result


def _surface_stress(basis: Basis, u: np.ndarray, y: float, lam: float, mu: float) -> float:
    """Axial stress at the surface of the neck, averaged over the elements there."""
    grid = basis.mesh
    vertex = int(np.argmin(np.hypot(grid.p[0], grid.p[1] - y)))
    values = []
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for local in range(3):
        cells = np.flatnonzero(grid.t[local] == vertex)
        if cells.size == 0:
            continue
        at = Basis(
            grid, basis.elem, elements=cells, quadrature=(corners[local][:, None], np.ones(1))
        )
        g = at.interpolate(u).grad
        sxx = 2.0 * mu * g[0, 0] + lam * (g[0, 0] + g[1, 1])
        values.extend(sxx.ravel())
    return float(np.mean(values))


COLUMNS = (
    "C_NN", "C_VV", "C_MM", "C_NM", "KN_left", "KN_right", "KM_left", "KM_right",
)  # fmt: skip


def main(target: Path) -> None:
    """Solve every case and write the table."""
    with target.open("w", newline="") as file:
        file.write(
            "# Notches by plane-stress finite elements (scripts/notch_fe.py), nu = 0.33, E = b = 1,"
            " lengths as in the script.\n"
            "# Compliance about the neck with the roots, end blocks of the height of the root"
            " removed as beams;\n"
            "# K: axial surface stress at the neck over N/(b t) or 6 M/(b t^2).\n"
        )
        writer = csv.writer(file)
        writer.writerow(("case", *COLUMNS))
        for name, profile in CASES.items():
            found = solve(profile)
            row = [f"{found[c]:.6g}" if c in found else "" for c in COLUMNS]
            writer.writerow((name, *row))
            print(name, *row, found["dofs"])


if __name__ == "__main__":
    default = HERE / "tests" / "literature" / "notch-fe.csv"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
