"""Which parameter of a stage, or place of which hinge, moves which figure, and by how much."""

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
    USUAL_SHARE,
    Variable,
    every_variable,
    matching_names,
)

#: What about a zero is called its range, of which a difference quotient takes a small part [m].
ABOUT_ZERO = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeFamily(Family):
    """A stage of which each hinge is varied by itself; its bodies stay as they are."""

    places: tuple[tuple[str, str], ...]
    """Hinge and what of it each variable is: neck, along or across."""

    def stage(self, point: Array) -> Stage:
        described = self.template.stage()
        hinges = {hinge.name: hinge for hinge in described.hinges}
        for (name, part), value in zip(self.places, map(float, point), strict=True):
            hinges[name] = _changed(hinges[name], part, value)
        return replace(described, hinges=tuple(hinges.values()))

    def text(self, point: Array, name: str | None = None, title: str | None = None) -> str:
        raise ModelError("no parameter of a stage file is the neck of one hinge alone")


def _changed(hinge: Hinge, part: str, value: float) -> Hinge:
    if part == "neck":
        if value == hinge.profile.neck_thickness:
            return hinge
        return replace(hinge, profile=replace(hinge.profile, neck_thickness=value))
    return replace(hinge, at=hinge.to_plane(*((value, 0.0) if part == "along" else (0.0, value))))


_PARTS = {
    "neck": "thickness of its neck",
    "along": "place of its notch along the line from body to body",
    "across": "place of its notch across that line, to the left",
}


def hinge_family(template: StageTemplate) -> HingeFamily:
    """Return a stage with neck and place of every hinge as variables: ``NAME.neck``."""
    variables, places = [], []
    for hinge in template.stage().hinges:
        for part, told in _PARTS.items():
            usual = hinge.profile.neck_thickness if part == "neck" else 0.0
            around = USUAL_SHARE * usual or ABOUT_ZERO
            places.append((hinge.name, part))
            variables.append(
                Variable(
                    name=f"{hinge.name}.{part}",
                    low=usual - around,
                    high=usual + around,
                    usual=usual,
                    dimension="length",
                    description=told,
                )
            )
    return HingeFamily(template=template, variables=tuple(variables), places=tuple(places))


def hinge_variables(template: StageTemplate, patterns: Sequence[str] = ()) -> HingeFamily:
    """Return neck and place of the hinges of some names as variables, of all where none is given.

    A pattern is that of a hinge, ``x*``, or of what of it is varied, ``*.neck``.

    Raises
    ------
    ModelError
        No hinge has such a name.
    """
    family = hinge_family(template)
    if not patterns:
        return family
    names = dict.fromkeys(family.names)
    hinges = dict.fromkeys(name for name, _ in family.places)
    chosen: set[str] = set()
    for pattern in patterns:
        if any(fnmatchcase(hinge, pattern) for hinge in hinges):
            chosen |= {f"{h}.{p}" for h, p in family.places if fnmatchcase(h, pattern)}
        else:
            chosen |= set(matching_names(names, [pattern], template.source, "hinge"))
    kept = [k for k, name in enumerate(family.names) if name in chosen]
    return replace(
        family,
        variables=tuple(family.variables[k] for k in kept),
        places=tuple(family.places[k] for k in kept),
    )


#: What a parameter that has a value changes by where nothing else is said.
SHARE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensitivities(Result):
    """What each parameter of a stage does to each of its figures."""

    table_key: ClassVar[str] = "parameters"

    request: SensitivityRequest | None = None
    """What was asked for."""
    stage: str
    """Name of the stage."""
    model: str
    """The model that the figures come from."""
    variables: tuple[Variable, ...]
    """The parameters; of hinges that do the same but for signs, one stands for all."""
    alike: tuple[tuple[str, ...], ...]
    """Names of the parameters that each stands for, itself first."""
    figures: tuple[Figure, ...]
    """The figures."""
    values: Array
    """Values of the figures, in the units of their quantities, shape (f,)."""
    slopes: Array
    """Change of each figure per SI unit of each parameter, shape (f, d)."""
    left_out: dict[str, str]
    """Why a parameter is not among them, by its name."""
    provenance: Provenance
    """Where it comes from."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        slopes, parts, changes = self.slopes.T, self.elasticities.T, self.changes().T
        return {
            **picked(self, "stage", "model"),
            "figures": [
                {**picked(f, "name", "quantity", "axis"), "value": plain(v), "unit": f.shown.unit}
                for f, v in zip(self.figures, self.values, strict=True)
            ],
            "parameters": [
                {
                    "name": variable.name,
                    "alike": list(self.alike[k]),
                    **picked(variable, "value=usual", "unit=si_unit"),
                    "slopes": plain(slopes[k]),
                    "elasticities": plain(parts[k]),
                    "step": plain(self.steps()[k]),
                    "changes": plain(changes[k]),
                }
                for k, variable in enumerate(self.variables)
            ],
            **picked(self, "left_out", "provenance"),
        }

    @property
    def length(self) -> float | None:
        """What lengths are asked to change by [m]; None for 1 % of each."""
        return None if self.request is None else self.request.length

    @property
    def point(self) -> Array:
        """Values of the parameters, shape (d,)."""
        return np.array([v.usual for v in self.variables])

    @property
    def vanishing(self) -> np.ndarray:
        """Whether a figure is nothing but rounding, so that no change is a part of it."""
        zeros = np.array([figure.shown.zero for figure in self.figures])
        return ~(np.abs(self.values) > zeros)

    @property
    def elasticities(self) -> Array:
        r"""Per cent of each figure per per cent of each parameter.

        :math:`\partial\ln y/\partial\ln p`, shape (f, d); NaN where figure or parameter is zero.
        """
        value = np.where(self.vanishing, np.nan, self.values)
        point = np.where(self.point == 0.0, np.nan, self.point)
        return self.slopes * point / value[:, None]

    def steps(self, length: float | None = None) -> Array:
        """Return what each parameter changes by: 1 % of it, or lengths by a length [m].

        By that of the request where none is given. A length that is zero changes by 10 um; shape
        (d,).
        """
        length = self.length if length is None else length
        steps = SHARE * self.point
        for k, variable in enumerate(self.variables):
            if variable.dimension == "length" and (length is not None or steps[k] == 0.0):
                steps[k] = LENGTH if length is None else length
        return steps

    def changes(self, length: float | None = None) -> Array:
        """Return the change of each figure, in the unit of its quantity, by `steps`.

        Those that are rounding are nothing; shape (f, d).
        """
        zeros = np.array([figure.shown.zero for figure in self.figures])
        found = self.slopes * self.steps(length)
        return np.where(np.abs(found) < zeros[:, None], 0.0, found)


def sensitivities(
    family: Family,
    figures: Sequence[Figure],
    model: str = "lumped",
    left_out: dict[str, str] | None = None,
) -> Sensitivities:
    r"""Return what the variables of a family do to figures of its stage as it is described.

    Slopes are those of `flexstage.studies.explore.jacobian` at the usual values, whatever the
    bounds; of hinges, the means of those to either side, and hinges that do the same are one.

    Parameters
    ----------
    family : Family
        The stage, and what is varied.
    figures : sequence of Figure
        What is looked at.
    model : str
        ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` or ``solid``.
    left_out : dict, optional
        Parameters that are no variables already, and why.

    Returns
    -------
    Sensitivities
        Slopes; what the stage cannot be varied by is left out with the reason.

    Raises
    ------
    ModelError
        Nothing is varied, or nothing is looked at.

    Notes
    -----
    Where several hinges have the largest stress alike, as mirror images have, it has a bend by one
    of them alone, and the mean of both sides says as much of each. Two axes of one frequency have
    no slopes of their own.

    Validity: small changes. A figure that is the largest of several has a bend where another one
    becomes it.

    Examples
    --------
    The frequency of a guide goes with the root of its mass: a thicker plate leaves it as it is.

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
        raise ModelError("sensitivities need a parameter and a figure at least")
    point = family.usual
    slopes_of = _mean_of_sides if isinstance(family, HingeFamily) else jacobian
    values, slopes = slopes_of(family, point, figures, model)
    reasons = dict(left_out or {})
    known = np.isfinite(values)
    lost = np.isnan(slopes[known]).all(axis=0) if known.any() else np.ones(len(point), dtype=bool)
    for k in np.flatnonzero(lost):
        reasons[family.names[k]] = _fault(family, figures, model, int(k))
    kept = np.flatnonzero(~lost)
    found = Sensitivities(
        stage=family.stage(point).name,
        model=model,
        variables=tuple(family.variables[k] for k in kept),
        alike=tuple((family.names[k],) for k in kept),
        figures=tuple(figures),
        values=values,
        slopes=slopes[:, kept],
        left_out=reasons,
        provenance=provenance(family.stage(point), {"slopes": _ways(family, model)}),
    )
    return _grouped(found, family) if isinstance(family, HingeFamily) else found


def variables_by(
    template: StageTemplate, patterns: Sequence[str] = ()
) -> tuple[tuple[Variable, ...], dict[str, str]]:
    """Return the parameters of some names, all where none is given, and why others are none.

    A pattern is a name, or one with ``*`` and ``?``. Lengths that are zero are among them.

    Raises
    ------
    ModelError
        No parameter has such a name.
    """
    known = {p.name: p for p in template.parameters}
    wanted = dict.fromkeys(
        known if not patterns else matching_names(known, patterns, template.source)
    )
    about = {v.name: v for v in every_variable(template)}
    variables, left_out = [], {}
    for name in dict.fromkeys(wanted):
        parameter = known[name]
        if name in about:
            variables.append(about[name])
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
            left_out[name] = _why(parameter)
    return tuple(variables), left_out


def _why(parameter: StageParameter) -> str:
    """Say why a parameter cannot change continuously."""
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


def _ways(family: Family, model: str) -> str:
    """Say what the slopes are."""
    if isinstance(family, HingeFamily):
        return "difference quotients, of each hinge by itself"
    if model == "lumped":
        return "derivatives, of what no analysis gives difference quotients"
    return "difference quotients, of stages that are modelled anew"


def _mean_of_sides(
    family: Family, point: Array, figures: Sequence[Figure], model: str
) -> tuple[Array, Array]:
    """Values of figures, shape (f,), and their central difference quotients, shape (f, d)."""
    # a part of the range of each
    steps = 1e-5 * np.diag(np.ptp(family.bounds, axis=1))
    found = evaluate(
        family, np.concatenate((point[None], point + steps, point - steps)), figures, model
    )
    above, below = np.split(found.values[1:], 2)
    return found.values[0], ((above - below) / (2.0 * np.diag(steps)[:, None])).T


def _fault(family: Family, figures: Sequence[Figure], model: str, k: int) -> str:
    """Say why a variable has no slope: what the stage says to a small step either way."""
    step = 1e-3 * float(np.ptp(family.bounds[k]))
    around = family.usual + step * np.outer([1.0, -1.0], np.eye(len(family.names))[k])
    faults = evaluate(family, around, figures, model).faults
    return next((fault for fault in faults if fault), "no figure follows it")


def _grouped(found: Sensitivities, family: HingeFamily) -> Sensitivities:
    """Let one hinge stand for those of the same notch that do the same, with their mean."""
    profiles = {hinge.name: hinge.profile for hinge in family.template.stage().hinges}
    places = dict(zip(family.names, family.places, strict=True))
    # mirror images do the same the other way round
    rows = np.abs(np.nan_to_num(found.slopes)).T
    # hinges are alike if what they do differs by less than this of the largest, or of the figure
    tolerance = 1e-3 * rows.max(axis=0, initial=0.0)
    unseen = np.where(found.vanishing, 0.0, 5e-5 * np.abs(np.nan_to_num(found.values)) / LENGTH)
    tolerance = np.maximum(tolerance, unseen)
    groups: list[list[int]] = []
    for k, variable in enumerate(found.variables):
        hinge, part = places[variable.name]
        for group in groups:
            first, own = places[found.variables[group[0]].name]
            same = part == own and profiles[hinge] == profiles[first]
            if same and bool(np.all(np.abs(rows[k] - rows[group[0]]) <= tolerance)):
                group.append(k)
                break
        else:
            groups.append([k])
    firsts = [group[0] for group in groups]
    means = [np.abs(found.slopes[:, group]).mean(axis=1) for group in groups]
    return replace(
        found,
        variables=tuple(found.variables[k] for k in firsts),
        alike=tuple(tuple(found.variables[k].name for k in group) for group in groups),
        slopes=np.copysign(np.array(means).T, found.slopes[:, firsts]),
    )
