"""Sources of a STAGE: a built-in design, a stage file or a drawing, and its parameters."""

import os
from collections.abc import Callable, Mapping
from functools import cache
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.base.choose import nearest
from flexstage.base.errors import StageError
from flexstage.files.expression import dimension_named
from flexstage.files.nodes import plain, read_text
from flexstage.files.parameters import require_known, settings_of
from flexstage.quantities.units import DIMENSIONS
from flexstage.stage import Stage
from flexstage.stage.designs.parameters import ParameterSet, StageParameter, Topology, entries_of
from flexstage.stage.designs.registry import (
    DESIGNS,
    PARAMETER_SETS,
    build,
    construct,
    design,
    design_parameters,
    some_of,
)
from flexstage.stage.drawing import DRAWINGS
from flexstage.stage.file import STAGE_FILE

if TYPE_CHECKING:
    from flexstage.stage.drawing.requests import DrawingOptions


def find_stage(
    source: str | os.PathLike[str],
    set: Mapping[str, object] | None = None,
    *,
    drawing: "DrawingOptions | None" = None,
) -> Stage:
    """Return a built-in stage, or read one from a stage file or out of a drawing.

    Parameters
    ----------
    source : str or os.PathLike
        Name of a built-in design, or path of a stage file or a drawing (DXF, STEP).
    set : mapping, optional
        Parameters of the design or of the file by name, with dots for those of a group, and their
        values as a stage file has them, ``{"x.lever_neck": "0.45 mm"}``; a number is in SI units.
    drawing : DrawingOptions, optional
        Data of a drawing beyond its file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, the file is invalid, or it has no such
        parameter.

    Examples
    --------
    >>> find_stage("vgtu-piezo").name
    'vgtu-piezo'
    >>> find_stage("parallelogram", {"leg_spacing": "35 mm"}).hinges[0].at[0]
    -0.0175
    >>> find_stage("parallelogram", {"leg_spacing": 0.035}).hinges[0].at[0]
    -0.0175
    """
    text = os.fspath(source)
    set = si_settings(text, set)
    if drawing is not None and Path(text).suffix.lower() not in DRAWINGS:
        raise StageError(
            f"options of a drawing apply to drawings only ({', '.join(DRAWINGS)}), got "
            f"'{text[:200]}'"
        )
    if text.casefold() in DESIGNS:
        return construct(*chosen_design(text.casefold(), set)) if set else design(text)
    path = _file(text)
    if path.suffix.lower() in DRAWINGS:
        from flexstage.stage.drawing.drawn_stage import stage_of_drawing
        from flexstage.stage.drawing.requests import DrawingOptions

        for name in set or {}:
            require_known(f"the drawing '{text}'", name, (), StageError)
        return stage_of_drawing(path, drawing or DrawingOptions())
    from flexstage.stage.file import read_stage

    return read_stage(path, designs=build, set=set)


def si_settings(source: str, settings: Mapping[str, object] | None) -> Mapping[str, object]:
    """Return settings of a design or file in which a number has the SI unit of its quantity."""
    values = dict(settings or {})
    numbers = [n for n, v in values.items() if isinstance(v, Real) and not isinstance(v, bool)]
    if numbers:
        units = {p.name: DIMENSIONS[p.dimension].si for p in parameters_of(source) if p.dimension}
        values |= {n: f"{values[n]} {units[n]}" for n in numbers if n in units}
    return values


def parameters_of(source: str | os.PathLike[str]) -> tuple[StageParameter, ...]:
    """Return the parameters of a built-in design or of a stage file, which `find_stage` sets.

    Parameters
    ----------
    source : str or os.PathLike
        Name of a built-in design, or path of a stage file.

    Returns
    -------
    tuple of StageParameter
        Those of a file in its order, then the dimensions of the design that it names.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, or the file is invalid.

    Examples
    --------
    >>> neck = next(p for p in parameters_of("vgtu-piezo") if p.name == "x.lever_neck")
    >>> neck.text, neck.value, neck.dimension
    ('0.55 mm', 0.00055, 'length')
    """
    text = os.fspath(source)
    if text.casefold() in DESIGNS:
        return parameters_in(text.casefold(), None)
    path = _file(text)
    if path.suffix.lower() in DRAWINGS:
        return ()  # what a drawing says is fixed: `flexstage import` gives its necks names
    return parameters_in(text, read_text(path, STAGE_FILE.noun, StageError))


def parameters_in(
    source: str,
    file: str | None,
    set: Mapping[str, object] | None = None,
    designed: Callable[[tuple[Topology, ParameterSet | None, Any]], None] | None = None,
) -> tuple[StageParameter, ...]:
    """Return the parameters of a built-in design, or of the text of a file, with settings.

    `designed` receives family, built-in design and dimensions of the design that a file names.
    """
    if file is None:
        return _in_design(chosen_design(source, set or {})[2])
    from flexstage.stage.file import file_parameters

    dimensions: list[Any] = []

    def on_design(name: str, settings: Mapping[str, object]) -> None:
        selection = design_parameters(name, settings)
        dimensions.append(selection[2])
        if designed is not None:
            designed(selection)

    file_settings = file_parameters(file, on_design, set=set, source=source)
    return (
        *(
            StageParameter(
                name=name,
                value=float(entry.amount.value),
                dimension=dimension_named(entry.amount.powers) or "",
                text=entry.text,
                description=entry.description,
            )
            for name, entry in file_settings.items()
        ),
        *(parameter for entry in dimensions for parameter in _in_design(entry)),
    )


def _in_design(dimensions: Any) -> tuple[StageParameter, ...]:
    return tuple(e for e in entries_of(dimensions) if isinstance(e, StageParameter))


def _file(text: str) -> Path:
    """Return the path of an existing stage file."""
    path = Path(text)
    if not text or not _exists(path):
        # a file that lies there, by another ending or a letter less, before a design of such a name
        # similar names without their ending: a name of five letters shares four with many files
        neighbours = {Path(name).stem: name for name in _files_in_folder(path)}
        file = neighbours.get(nearest(path.stem, neighbours, 0.75) or "")
        near = (
            str(path.with_name(file))
            if file
            else nearest(text, DESIGNS, 0.7 if path.suffix else 0.4)
        )
        hint = f"did you mean '{near}'?" if near else f"the designs are {some_of(DESIGNS)}"
        raise StageError(f"no built-in design and no file is called '{text[:200]}': {hint}")
    return path


def chosen_design(
    name: str, settings: Mapping[str, object]
) -> tuple[Topology, ParameterSet | None, Any]:
    """Return family, built-in design and dimensions of a design with settings."""
    design = _names_of(name)
    # another kind of what stands there has parameters of its own, which are checked as in a file
    anew = tuple(setting.removesuffix("kind") for setting in settings if setting.endswith(".kind"))
    for setting in settings:
        if not setting.startswith(anew or ("kind",)) or setting in design:
            require_known(f"the design '{name}'", setting, design, StageError)
    values: Any = plain(settings_of(settings, StageError))
    return design_parameters(name, values)


@cache
def _names_of(name: str) -> tuple[str, ...]:
    return tuple(entry.name for entry in entries_of(PARAMETER_SETS[name].parameters))


def _files_in_folder(path: Path) -> list[str]:
    """Return the names of the stage files in the folder of a path."""
    try:
        return [p.name for p in path.parent.iterdir() if p.suffix in (".yaml", ".yml", *DRAWINGS)]
    except (OSError, ValueError):  # no such folder, or a name that none can have
        return []


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long for any file
        return False
