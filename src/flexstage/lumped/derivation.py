"""The equations of a stage: derivation, reduction, transfer functions, and their sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.lumped.latex import Formula, Item, Paragraph, SheetSection, Tabular, sheet_data
from flexstage.lumped.reduction import (
    LARGEST_ORDER,
    ReducedModel,
    TransferFunction,
    condense,
    find_mirror,
    reduce_by_symmetry,
    transfer_function,
)
from flexstage.lumped.symbolic import SymbolicModel, symbolic_model
from flexstage.lumped.symbols import generic_body, generic_hinge, quadratic, upright
from flexstage.stage import Stage
from flexstage.system.requests import EquationsRequest

# a stage whose stiffness differs from its image by less is reduced as a symmetric one, which the
# output says: the frequencies change by the square of it
_ASYMMETRY = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Derivation:
    """The equations of a stage."""

    stage: Stage
    """The stage."""
    model: SymbolicModel
    """All of them."""
    reduced: ReducedModel | None
    """The same in fewer coordinates; None where not requested, or of no use."""
    transfer: tuple[TransferFunction, ...]
    """Transfer functions of the reduced model, where they are short enough to read."""

    @property
    def sheet(self) -> tuple[SheetSection, ...]:
        """All of it as a sheet of equations."""
        return equation_sheet(self.model, reduced=self.reduced, transfer=self.transfer)

    def to_dict(self) -> dict[str, Any]:
        """Return the equations as plain data, as `flexstage equations --json` prints them."""
        reduced = self.reduced
        return {
            "stage": self.stage.name,
            "order": self.model.order,
            "coordinates": [x.name for x in self.model.coordinates],
            "values": {x.name: v for x, v in self.model.values.items()},
            "reduced": None
            if reduced is None
            else {"how": reduced.how, "coordinates": [x.name for x in reduced.coordinates]},
            "transfer_functions": [
                {
                    "drive": tf.drive,
                    "probe": tf.probe,
                    "input_kind": tf.input_kind,
                    "numerator": top.tolist(),
                    "denominator": bottom.tolist(),
                    "poles_hz": sorted({round(abs(p) / 6.283185307179586, 9) for p in tf.poles()}),
                }
                for tf in self.transfer
                for top, bottom in [tf.coefficients()]
            ],
            "sections": sheet_data(self.sheet),
        }


def derive(stage: Stage, request: EquationsRequest) -> Derivation:
    """Derive the equations of a stage, and reduce them for the transfer functions of its axes.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> derive(design("parallelogram"), EquationsRequest()).reduced.order
    5
    """
    model = symbolic_model(stage, damping=request.damping)
    reduced = _reduced_model(model, stage, request)
    return Derivation(
        stage=stage,
        model=model,
        reduced=reduced,
        transfer=() if reduced is None else _transfer_functions(reduced, stage, request.axis),
    )


def _reduced_model(
    model: SymbolicModel, stage: Stage, request: EquationsRequest
) -> ReducedModel | None:
    how = request.reduce
    if how == "none":
        return None
    drive = stage.drive_of(request.axis).name if request.axis is not None else None
    mirror = None if how == "condense" else find_mirror(model.source, tolerance=_ASYMMETRY)
    if how == "symmetry":
        return reduce_by_symmetry(model, drive=drive, mirror=mirror)
    if mirror is not None and model.drives:
        try:
            by_symmetry = reduce_by_symmetry(model, drive=drive, mirror=mirror)
        except ModelError:
            by_symmetry = None
        if by_symmetry is not None and by_symmetry.order <= LARGEST_ORDER:
            return by_symmetry
    if not (model.drives or model.probes):
        return None
    return condense(model)


def _transfer_functions(
    reduced: ReducedModel, stage: Stage, axis: str | None
) -> tuple[TransferFunction, ...]:
    if reduced.order > LARGEST_ORDER:
        return ()
    drives = {p.name for p in reduced.drives}
    probes = {p.name for p in reduced.probes}
    return tuple(
        transfer_function(reduced, drive, a.probe)
        for a in stage.axes
        for drive in a.moved_by
        if axis in (None, a.name) and drive in drives and a.probe in probes
    )


# a determinant of more operations is shown with its numbers only
_LONGEST = 2500


def equation_sheet(
    model: SymbolicModel,
    *,
    reduced: ReducedModel | None = None,
    transfer: Sequence[TransferFunction] = (),
) -> tuple[SheetSection, ...]:
    """Write down the equations of a stage.

    The generic body and hinge are derived once; the stage follows as tables of the constants of its
    bodies and hinges, the blocks of M, C and K, and the equations of motion of every body.

    Parameters
    ----------
    model : SymbolicModel
        The equations.
    reduced : ReducedModel, optional
        The same in fewer coordinates.
    transfer : Sequence of TransferFunction
        Transfer functions of the reduced model.

    Returns
    -------
    tuple of SheetSection
        The sheet.
    """
    sections = [
        _bodies(model),
        _body_energy(),
        _hinge_energy(model),
        _hinges(model),
        _lagrange(model),
        _matrices(model),
        _motion(model),
        _operator(model),
    ]
    if reduced is not None:
        sections.append(_reduced(reduced))
    if transfer:
        sections.append(_transfer(transfer))
    sections.append(_values(model))
    return tuple(sections)


def _bodies(model: SymbolicModel) -> SheetSection:
    rows = tuple(
        (str(i + 1), name, m, J)
        for i, (name, (m, J)) in enumerate(zip(model.bodies, model.body_constants, strict=True))
    )
    return SheetSection(
        key="bodies",
        title="Bodies and generalised coordinates",
        items=(
            Paragraph(
                text=f"{len(rows)} free bodies, three coordinates each: the displacement x, y of "
                f"the centre of mass and the rotation theta; {model.order} in all. Fixed: "
                f"{', '.join(model.fixed) or 'nothing'}."
            ),
            Tabular(header=("no.", "body", "mass", "inertia"), rows=rows),
        ),
    )


def _body_energy() -> SheetSection:
    body = generic_body()
    accelerations = sp.symbols(r"\ddot{x} \ddot{y} \ddot{\theta}", real=True)
    swap = dict(zip(body.rates, accelerations, strict=True))
    items: list[Item] = [
        Paragraph(text="Kinetic energy of a body; the total is the sum over all bodies."),
        Formula(left="T", right=body.kinetic_energy),
    ]
    for q, rate, momentum in zip(body.coordinates, body.rates, body.momenta, strict=True):
        items.append(
            Formula(
                left=rf"\frac{{\partial T}}{{\partial {sp.latex(rate)}}}",
                right=momentum,
                plain=f"dT/d{q}'",
            )
        )
        items.append(
            Formula(
                left=rf"\frac{{d}}{{dt}}\frac{{\partial T}}{{\partial {sp.latex(rate)}}}"
                rf" - \frac{{\partial T}}{{\partial {sp.latex(q)}}}",
                right=momentum.xreplace(swap),
                plain=f"d/dt dT/d{q}' - dT/d{q}",
            )
        )
    return SheetSection(key="kinetic", title="Kinetic energy", items=tuple(items))


def _hinge_energy(model: SymbolicModel) -> SheetSection:
    hinge = generic_hinge()
    u, v, t = sp.symbols("u v vartheta", real=True)
    short = quadratic(hinge.stiffness, (u, v, t))
    items: list[Item] = [
        Paragraph(
            text="Hinge between bodies a and b: lever arms X, Y from the centres of mass to the "
            "neck, direction with cosine c and sine s; u along it, v to its left, rotation "
            "of b against a. A fixed body has no coordinates."
        ),
        *(
            Formula(left=name, right=e)
            for name, e in zip((u, v, t), hinge.deformation, strict=True)
        ),
        Paragraph(text="Its potential energy, and its terms in Lagrange's equations."),
        Formula(left="V", right=short),
    ]
    spring = {u: hinge.deformation[0], v: hinge.deformation[1], t: hinge.deformation[2]}
    for q in hinge.coordinates:
        # the chain rule keeps the forces short: N, V, M times the derivatives of u, v, theta
        force = sum((sp.diff(short, x) * sp.diff(e, q) for x, e in spring.items()), start=sp.S.Zero)
        items.append(
            Formula(
                left=rf"\frac{{\partial V}}{{\partial {sp.latex(q)}}}",
                right=sp.factor_terms(force),
                plain=f"dV/d{q}",
            )
        )
    items.append(Paragraph(text="Hessian of V: the stiffness block of every hinge (symmetric)."))
    items += [
        Formula(
            left=rf"K^h_{{{i + 1},{j + 1}}}",
            right=hinge.block[i, j],
            plain=f"Kh[{i + 1},{j + 1}]",
        )
        for i in range(6)
        for j in range(i, 6)
    ]
    if model.damping == "hinge":
        items.append(
            Paragraph(
                text="The damper of a hinge has the dissipation D, of the same form in the rates; "
                "its derivatives and its block are those above with c for k."
            )
        )
        rates = sp.symbols(r"\dot{u} \dot{v} \dot{\vartheta}", real=True)
        items.append(Formula(left="D", right=quadratic(hinge.damping, rates)))
    elif model.damping == "rayleigh":
        items += [
            Paragraph(text="Rayleigh's dissipation function of the stage."),
            Formula(
                left="D",
                right=r"\tfrac12\dot q^T(\alpha M + \beta K)\,\dot q",
            ),
        ]
    return SheetSection(
        key="hinge", title="Potential energy and dissipation of a hinge", items=tuple(items)
    )


def _hinges(model: SymbolicModel) -> SheetSection:
    generic = generic_hinge()
    used = [
        key
        for key, symbol in generic.stiffness.items()
        if any(h.constants[symbol] != 0 for h in model.hinges)
    ]
    symbols = [*generic.arms, generic.cosine, generic.sine, *(generic.stiffness[k] for k in used)]
    rows = tuple(
        (
            h.name,
            str(h.bodies[0]),
            str(h.bodies[1]),
            *(h.constants[symbol] for symbol in symbols),
        )
        for h in model.hinges
    )
    return SheetSection(
        key="hinges",
        title="Constants of each hinge",
        items=(
            Paragraph(text="Body 0 is fixed. Hinges of equal stiffness share their symbols."),
            Tabular(header=("hinge", "a", "b", *symbols), rows=rows),
        ),
    )


def _lagrange(model: SymbolicModel) -> SheetSection:
    form = r"M\ddot q + C\dot q + Kq" if model.damping != "none" else r"M\ddot q + Kq"
    return SheetSection(
        key="lagrange",
        title="Lagrange's equations",
        items=(
            Formula(
                left=r"\frac{d}{dt}\frac{\partial T}{\partial\dot q_i}"
                r" - \frac{\partial T}{\partial q_i} + \frac{\partial D}{\partial\dot q_i}"
                r" + \frac{\partial V}{\partial q_i}",
                right="Q_i",
                plain="d/dt dT/dq_i' - dT/dq_i + dD/dq_i' + dV/dq_i",
            ),
            Formula(
                left=form, right="Q", plain=form.replace(r"\ddot q", "q''").replace(r"\dot q", "q'")
            ),
        ),
    )


def _matrices(model: SymbolicModel) -> SheetSection:
    items: list[Item] = [
        Paragraph(
            text="M is diagonal: m, m, J of each body in turn. K in 3 x 3 blocks by the numbers of "
            "two bodies; blocks that are not shown are zero, and K_ji is the transpose of K_ij."
        )
    ]
    n = len(model.bodies)
    for i in range(n):
        for j in range(i, n):
            block = model.K[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            if block.todok():
                items.append(
                    Formula(
                        left=rf"K_{{{i + 1},{j + 1}}}",
                        right=sp.ImmutableMatrix(block),
                        plain=f"K[{i + 1},{j + 1}]",
                    )
                )
    if model.damping == "rayleigh":
        items.append(Formula(left="C", right=r"\alpha M + \beta K"))
    elif model.damping == "hinge":
        items.append(Paragraph(text="C is K with c in place of k."))
    else:
        items.append(Formula(left="C", right="0"))
    return SheetSection(key="matrices", title="Mass, damping and stiffness", items=tuple(items))


def _motion(model: SymbolicModel) -> SheetSection:
    items: list[Item] = []
    if model.damping != "none":
        items.append(
            Paragraph(
                text="Damping is omitted here; it adds the same terms in the rates, with C for K."
            )
        )
    for i, name in enumerate(model.bodies):
        items.append(Paragraph(text=f"Body {i + 1}, {name}:"))
        for row in range(3 * i, 3 * i + 3):
            left = model.M[row, row] * model.accelerations[row]
            left += sp.Add(
                *(
                    model.K[row, j] * model.coordinates[j]
                    for j in range(model.order)
                    if model.K[row, j] != 0
                )
            )
            items.append(Formula(left=left, right=model.forces[row]))
    return SheetSection(key="motion", title="Equations of motion", items=tuple(items))


def _operator(model: SymbolicModel) -> SheetSection:
    damped = model.damping != "none"
    items = [
        Formula(
            left=r"\left(M s^2 + C s + K\right) q(s)" if damped else r"\left(M s^2 + K\right) q(s)",
            right="Q(s)",
            plain="(M s^2 + C s + K) q(s)" if damped else "(M s^2 + K) q(s)",
        ),
        Paragraph(
            text="A drive applies Q = w f, and its elongation is w^T q; a probe reads p^T q. "
            "Elongations and readings in terms of the coordinates:"
        ),
        *(
            Formula(
                left=rf"{letter}_{{{upright(port.name)}}}^T q",
                right=(sp.Matrix(port.vector).T * sp.Matrix(model.coordinates))[0],
                plain=f"{letter}_{port.name}^T q",
            )
            for letter, ports in (("w", model.drives), ("p", model.probes))
            for port in ports
        ),
    ]
    return SheetSection(key="operator", title="Operator form", items=tuple(items))


def _reduced(reduced: ReducedModel) -> SheetSection:
    z = sp.Matrix(reduced.coordinates)
    rounded = {"M": reduced.M, "C": reduced.C, "K": reduced.K}
    items: list[Item] = [
        Paragraph(
            text=f"Reduced by {reduced.how}; {reduced.order} "
            f"{'coordinate' if reduced.order == 1 else 'coordinates'}."
        ),
        Formula(left="z^T", right=sp.ImmutableMatrix(z.T), plain="z^T"),
    ]
    for name, matrix in rounded.items():
        if name == "C" and reduced.damping == "rayleigh":
            items.append(Formula(left="C_z", right=r"\alpha M_z + \beta K_z"))
        elif name != "C" or reduced.damping != "none":
            items.append(Formula(left=f"{name}_z", right=sp.ImmutableMatrix(matrix)))
    return SheetSection(key="reduced", title="Reduced model", items=tuple(items))


def _transfer(transfer: Sequence[TransferFunction]) -> SheetSection:
    items: list[Item] = []
    for tf in transfer:
        items.append(
            Paragraph(
                text=f"From the force of drive {tf.drive} to the reading of probe {tf.probe} [m/N]:"
            )
        )
        symbolic = (tf.numerator.free_symbols | tf.denominator.free_symbols) - {tf.s}
        symbols = {x.name for x in symbolic} - {"alpha", "beta"}
        operations = sp.count_ops(tf.numerator) + sp.count_ops(tf.denominator)
        if symbols and operations <= _LONGEST:
            items += [
                Formula(left="H(s)", right=r"N(s)/D(s)"),
                Formula(left="N(s)", right=tf.numerator),
                Formula(left="D(s)", right=tf.denominator),
            ]
        elif symbols:
            items.append(
                Paragraph(
                    text=(
                        f"Too long to print ({operations} operations); with numerical coefficients:"
                    )
                )
            )
        top, bottom = tf.coefficients()
        items.append(
            Formula(left="N(s)" if not symbols else "N_0(s)", right=_polynomial(top, tf.s))
        )
        items.append(
            Formula(left="D(s)" if not symbols else "D_0(s)", right=_polynomial(bottom, tf.s))
        )
        poles = tf.poles()
        lowest = sorted({float(f"{abs(p) / 6.283185307179586:.6g}") for p in poles})
        items.append(Paragraph(text=f"Poles at {', '.join(f'{f:.6g}' for f in lowest)} Hz."))
    return SheetSection(key="transfer", title="Transfer functions", items=tuple(items))


def _values(model: SymbolicModel) -> SheetSection:
    rows = tuple(
        (symbol, f"{value:.10g}", _unit(symbol.name)) for symbol, value in model.values.items()
    )
    return SheetSection(
        key="values",
        title="Values of the constants",
        items=(Tabular(header=("symbol", "value", "unit"), rows=rows),),
    )


def _polynomial(coefficients: Array, s: sp.Symbol) -> sp.Expr:
    degree = len(coefficients) - 1
    return sp.Add(
        *(sp.Float(float(c), 8) * s ** (degree - i) for i, c in enumerate(coefficients) if c),
        evaluate=True,
    )


def _unit(name: str) -> str:
    if name.startswith(("k_", "c_")):
        second = "" if name[0] == "k" else " s"
        kind = name[3:].rstrip("}0123456789")
        return {r"\theta": "N m" + second, r"u\theta": "N" + second, r"v\theta": "N" + second}.get(
            kind, "N/m" if name[0] == "k" else "N s/m"
        )
    return {"m": "kg", "J": "kg m^2", "ell": "m", "phi": "rad", "alpha": "1/s", "beta": "s"}.get(
        name.split("_", maxsplit=1)[0], ""
    )
