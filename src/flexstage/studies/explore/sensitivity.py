"""Sensitivity analysis: influence of parameters, and of single hinges, on figures of a stage."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.provenance import Provenance, provenance
from flexstage.base.short_repr import short_repr
from flexstage.files.expression import is_expression
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.stage import Hinge, Stage
from flexstage.stage.designs import StageTemplate
from flexstage.stage.designs.parameters import StageParameter
from flexstage.studies.explore.family import Family, evaluate, jacobian
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.requests import LENGTH, SensitivityRequest
from flexstage.studies.explore.variables import (
    DEFAULT_SHARE,
    Variable,
    every_variable,
    matching_names,
)

#: Half range of a length that is zero; difference quotients use a small share of it [m].
ABOUT_ZERO = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeFamily(Family):
    """A stage with single varied hinges; its bodies are constant."""

    places: tuple[tuple[str, str], ...]
    """Hinge and varied property of each variable: neck, along or across."""

    def stage(self, point: Array) -> Stage:
        described = self.template.stage()
        hinges = {hinge.name: hinge for hinge in described.hinges}
        for (name, part), value in zip(self.places, map(float, point), strict=True):
            hinges[name] = _changed(hinges[name], part, value)
        return replace(described, hinges=tuple(hinges.values()))

    def text(self, point: Array, name: str | None = None, title: str | None = None) -> str:
        raise ModelError("a stage file has no parameter for the neck of a single hinge")


def _changed(hinge: Hinge, part: str, value: float) -> Hinge:
    if part == "neck":
        if value == hinge.profile.neck_thickness:
            return hinge
        return replace(hinge, profile=replace(hinge.profile, neck_thickness=value))
    return replace(hinge, at=hinge.to_plane(*((value, 0.0) if part == "along" else (0.0, value))))


_PARTS = {
    "neck": "neck thickness",
    "along": "position of the notch along the line from body to body",
    "across": "position of the notch across that line, to the left",
}


def hinge_family(template: StageTemplate) -> HingeFamily:
    """Return a stage with neck and position of every hinge as variables: ``NAME.neck``."""
    variables, places = [], []
    for hinge in template.stage().hinges:
        for part, description in _PARTS.items():
            usual = hinge.profile.neck_thickness if part == "neck" else 0.0
            around = DEFAULT_SHARE * usual or ABOUT_ZERO
            places.append((hinge.name, part))
            variables.append(
                Variable(
                    name=f"{hinge.name}.{part}",
                    low=usual - around,
                    high=usual + around,
                    usual=usual,
                    dimension="length",
                    description=description,
                )
            )
    return HingeFamily(template=template, variables=tuple(variables), places=tuple(places))


def hinge_variables(template: StageTemplate, patterns: Sequence[str] = ()) -> HingeFamily:
    """Return neck and position of hinges as variables, by default of all hinges.

    A pattern matches the name of a hinge, ``x*``, or of a variable, ``*.neck``.

    Raises
    ------
    ModelError
        A pattern matches no hinge.
    """
    family = hinge_family(template)
    if not patterns:
        return family
    names = dict.fromkeys(family.names)
    hinges = dict.fromkeys(name for name, _ in family.places)
    selected: set[str] = set()
    for pattern in patterns:
        if any(fnmatchcase(hinge, pattern) for hinge in hinges):
            selected |= {f"{h}.{p}" for h, p in family.places if fnmatchcase(h, pattern)}
        else:
            selected |= set(matching_names(names, [pattern], template.source, "hinge"))
    indices = [k for k, name in enumerate(family.names) if name in selected]
    return replace(
        family,
        variables=tuple(family.variables[k] for k in indices),
        places=tuple(family.places[k] for k in indices),
    )


#: Default relative change of a parameter.
SHARE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensitivities(Result):
    """Sensitivities of the figures of a stage to its parameters."""

    table_key: ClassVar[str] = "parameters"

    request: SensitivityRequest | None = None
    """The request."""
    stage: str
    """Name of the stage."""
    model: str
    """Model of the figures."""
    variables: tuple[Variable, ...]
    """The parameters; one represents hinges with equal effects except for signs."""
    equivalent: tuple[tuple[str, ...], ...]
    """Names of the parameters that each represents, its own first."""
    figures: tuple[Figure, ...]
    """The figures."""
    values: Array
    """Values of the figures, in the units of their quantities, shape (f,)."""
    slopes: Array
    """Derivative of each figure by each parameter in SI units, shape (f, d)."""
    skipped: dict[str, str]
    """Skipped parameters and reasons."""
    provenance: Provenance
    """Origin of the result."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        slopes, parts, changes = self.slopes.T, self.elasticities.T, self.changes().T
        return {
            **picked(self, "stage", "model"),
            "figures": [
                {**picked(f, "name", "quantity", "axis"), "value": plain(v), "unit": f.display.unit}
                for f, v in zip(self.figures, self.values, strict=True)
            ],
            "parameters": [
                {
                    "name": variable.name,
                    "equivalent": list(self.equivalent[k]),
                    **picked(variable, "value=usual", "unit=si_unit"),
                    "slopes": plain(slopes[k]),
                    "elasticities": plain(parts[k]),
                    "step": plain(self.steps()[k]),
                    "changes": plain(changes[k]),
                }
                for k, variable in enumerate(self.variables)
            ],
            **picked(self, "skipped", "provenance"),
        }

    @property
    def length(self) -> float | None:
        """Requested change of lengths [m]; None for 1 % of each."""
        return None if self.request is None else self.request.length

    @property
    def point(self) -> Array:
        """Values of the parameters, shape (d,)."""
        return np.array([v.usual for v in self.variables])

    @property
    def vanishing(self) -> np.ndarray:
        """True for figures that are rounding errors, without relative changes."""
        zeros = np.array([figure.display.zero for figure in self.figures])
        return ~(np.abs(self.values) > zeros)

    @property
    def elasticities(self) -> Array:
        r"""Relative sensitivity: per cent of each figure per per cent of each parameter.

        :math:`\partial\ln y/\partial\ln p`, shape (f, d); NaN if figure or parameter is zero.
        """
        value = np.where(self.vanishing, np.nan, self.values)
        point = np.where(self.point == 0.0, np.nan, self.point)
        return self.slopes * point / value[:, None]

    def steps(self, length: float | None = None) -> Array:
        """Return the change of each parameter: 1 % of it, or a given change of lengths [m].

        The default change of lengths is that of the request, and 10 um if the length is zero; shape
        (d,).
        """
        length = self.length if length is None else length
        steps = SHARE * self.point
        for k, variable in enumerate(self.variables):
            if variable.dimension == "length" and (length is not None or steps[k] == 0.0):
                steps[k] = LENGTH if length is None else length
        return steps

    def changes(self, length: float | None = None) -> Array:
        """Return the changes of the figures by `steps`, in the units of the quantities.

        Rounding errors are set to zero; shape (f, d).
        """
        zeros = np.array([figure.display.zero for figure in self.figures])
        changes = self.slopes * self.steps(length)
        return np.where(np.abs(changes) < zeros[:, None], 0.0, changes)


def sensitivities(
    family: Family,
    figures: Sequence[Figure],
    model: str = "lumped",
    skipped: dict[str, str] | None = None,
) -> Sensitivities:
    r"""Return the sensitivities of the figures of the described stage to the variables of a family.

    Derivatives are those of `flexstage.studies.explore.jacobian` at the described values, for any
    bounds. Those of hinges are central difference quotients, and equivalent hinges are grouped.

    Parameters
    ----------
    family : Family
        The stage and its variables.
    figures : sequence of Figure
        The figures.
    model : str
        ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` or ``solid``.
    skipped : dict, optional
        Parameters that are already skipped, and reasons.

    Returns
    -------
    Sensitivities
        Derivatives; parameters that cannot be varied are skipped with the reason.

    Raises
    ------
    ModelError
        There are no variables or no figures.

    Notes
    -----
    If several hinges have the same largest stress, such as mirror images, its derivative by one of
    them is one-sided; the mean of both sides is equal for all of them. Two axes with the same
    frequency have no separate derivatives.

    Validity: small changes. The derivative of a figure that is a maximum is discontinuous where
    another value becomes the largest.

    Examples
    --------
    A thicker plate changes stiffness and mass of a guide in proportion, and not its frequency.

    >>> from flexstage.studies.explore.figures import Figure
    >>> template = StageTemplate.of("parallelogram")
    >>> family = Family(
    ...     template=template, variables=variables_by(template, ["thickness", "leg.notch.neck*"])[0]
    ... )
    >>> frequency = Figure(quantity="natural_frequency_hz", axis="x")
    >>> [round(float(v), 2) + 0.0 for v in sensitivities(family, [frequency]).elasticities[0]]
    [0.0, 1.2]
    """
    if not family.variables or not figures:
        raise ModelError("sensitivities need at least one parameter and one figure")
    point = family.usual
    slopes_of = _central_quotients if isinstance(family, HingeFamily) else jacobian
    values, slopes = slopes_of(family, point, figures, model)
    reasons = dict(skipped or {})
    finite = np.isfinite(values)
    fixed = np.ones(len(point), dtype=bool)
    if finite.any():
        fixed = np.isnan(slopes[finite]).all(axis=0)
    for k in np.flatnonzero(fixed):
        reasons[family.names[k]] = _fault(family, figures, model, int(k))
    columns = np.flatnonzero(~fixed)
    result = Sensitivities(
        stage=family.stage(point).name,
        model=model,
        variables=tuple(family.variables[k] for k in columns),
        equivalent=tuple((family.names[k],) for k in columns),
        figures=tuple(figures),
        values=values,
        slopes=slopes[:, columns],
        skipped=reasons,
        provenance=provenance(family.stage(point), {"slopes": _method(family, model)}),
    )
    return _grouped(result, family) if isinstance(family, HingeFamily) else result


def variables_by(
    template: StageTemplate, patterns: Sequence[str] = ()
) -> tuple[tuple[Variable, ...], dict[str, str]]:
    """Return parameters by name, by default all, and the skipped ones with reasons.

    A pattern is a name, or one with ``*`` and ``?``. Lengths that are zero are included.

    Raises
    ------
    ModelError
        A pattern matches no parameter.
    """
    known = {p.name: p for p in template.parameters}
    names = dict.fromkeys(
        known if not patterns else matching_names(known, patterns, template.source)
    )
    continuous = {v.name: v for v in every_variable(template)}
    variables, skipped = [], {}
    for name in names:
        parameter = known[name]
        if name in continuous:
            variables.append(continuous[name])
        elif (
            parameter.value == 0.0
            and parameter.dimension == "length"
            and not is_expression(parameter.text)
        ):
            variables.append(
                Variable(
                    name=name,
                    low=-ABOUT_ZERO,
                    high=ABOUT_ZERO,
                    usual=0.0,
                    dimension="length",
                    description=parameter.description,
                )
            )
        else:
            skipped[name] = _reason(parameter)
    return tuple(variables), skipped


def _reason(parameter: StageParameter) -> str:
    """Return why a parameter is not continuous."""
    match parameter.value:
        case None:
            return "it has no value"
        case bool() | str():
            return "it is a choice"
        case int():
            return "it is a whole number"
        case float() if is_expression(parameter.text):
            return "it follows from others"
        case float():
            return "it is zero"
    return "it is a list"


def _method(family: Family, model: str) -> str:
    """Return the method of differentiation."""
    if isinstance(family, HingeFamily):
        return "difference quotients for single hinges"
    if model == "lumped":
        return "analytic derivatives, difference quotients where there are none"
    return "difference quotients"


def _central_quotients(
    family: Family, point: Array, figures: Sequence[Figure], model: str
) -> tuple[Array, Array]:
    """Return figures, shape (f,), and central difference quotients, shape (f, d)."""
    # shares of the ranges
    steps = 1e-5 * np.diag(np.ptp(family.bounds, axis=1))
    points = np.concatenate((point[None], point + steps, point - steps))
    values = evaluate(family, points, figures, model).values
    above, below = np.split(values[1:], 2)
    return values[0], ((above - below) / (2.0 * np.diag(steps)[:, None])).T


def _fault(family: Family, figures: Sequence[Figure], model: str, k: int) -> str:
    """Return why a variable has no derivative: the fault of a stage after a small step."""
    step = 1e-3 * float(np.ptp(family.bounds[k]))
    around = family.usual + step * np.outer([1.0, -1.0], np.eye(len(family.names))[k])
    faults = evaluate(family, around, figures, model).faults
    return next((fault for fault in faults if fault), "no figure depends on it")


def _grouped(result: Sensitivities, family: HingeFamily) -> Sensitivities:
    """Return sensitivities with one variable for equivalent hinges of equal notches, their mean."""
    profiles = {hinge.name: hinge.profile for hinge in family.template.stage().hinges}
    places = dict(zip(family.names, family.places, strict=True))
    # effects of mirror images have opposite signs
    rows = np.abs(np.nan_to_num(result.slopes)).T
    # equivalent hinges differ by less than this share of the largest effect, or of the figure
    tolerance = 1e-3 * rows.max(axis=0, initial=0.0)
    values = np.abs(np.nan_to_num(result.values))
    negligible = np.where(result.vanishing, 0.0, 5e-5 * values / LENGTH)
    tolerance = np.maximum(tolerance, negligible)
    groups: list[list[int]] = []
    for k, variable in enumerate(result.variables):
        hinge, part = places[variable.name]
        for group in groups:
            first, first_part = places[result.variables[group[0]].name]
            same = part == first_part and profiles[hinge] == profiles[first]
            if same and bool(np.all(np.abs(rows[k] - rows[group[0]]) <= tolerance)):
                group.append(k)
                break
        else:
            groups.append([k])
    firsts = [group[0] for group in groups]
    means = [np.abs(result.slopes[:, group]).mean(axis=1) for group in groups]
    return replace(
        result,
        variables=tuple(result.variables[k] for k in firsts),
        equivalent=tuple(tuple(result.variables[k].name for k in group) for group in groups),
        slopes=np.copysign(np.array(means).T, result.slopes[:, firsts]),
    )
