"""Tables of what a rotary table needs of the stage that centres its scale."""

from flexstage.centring.error_budget import expanded_uncertainty
from flexstage.centring.geometry import ARCSEC
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Table, table
from flexstage.studies.scale import JudgedStage, Need, ScaleStudy, displayed
from flexstage.studies.settings import DriveSetting, MoveSettings

_DISTRIBUTIONS = {"sine": "amplitude", "limits": "half-range", "normal": "std. deviation"}


def budget_table(study: ScaleStudy) -> Table:
    """Return the error budget in arcsec, before and after centring."""
    reading = study.table.tolerance.reading
    rows = [
        (
            before.cause,
            "" if before.order is None else str(before.order),
            _DISTRIBUTIONS[before.distribution],
            *map(_arcsec, (before.each, before.mean, after.each, after.mean)),
        )
        for before, after in zip(study.mounted, study.centred, strict=True)
    ]
    return table(
        f"{study.table.name}: errors of a reading, arcsec",
        (
            "<cause", "order", "<size", "as mounted: one head", "mean of heads",
            "centred: one head", "mean of heads",
        ),
        rows,
        notes=(
            f"95 % uncertainty of {_READINGS[reading]}: "
            f"{_arcsec(expanded_uncertainty(study.table, study.table.scale.eccentricity))} arcsec "
            f"as mounted, {_arcsec(expanded_uncertainty(study.table, study.allowed))} arcsec with "
            f"an eccentricity of {displayed(study.allowed, 'm')}, "
            f"{_arcsec(study.table.tolerance.error)} arcsec allowed",
        ),
    )  # fmt: skip


_READINGS = {"mean": "the mean of all heads", "each": "each head"}


def _arcsec(value: float) -> str:
    return number(value / ARCSEC, 3)


def needs_table(study: ScaleStudy) -> Table:
    """Return what the stage must have."""
    return table(
        "What the stage needs",
        ("<quantity", "<axis", "<", "value"),
        [
            (n.what, n.axis, "at least" if n.least else "at most", displayed(n.limit, n.unit))
            for n in study.needs
        ],
    )


def stages_table(study: ScaleStudy) -> Table:
    """Return the judged stages, the suitable ones first."""
    ordered = sorted(study.stages, key=lambda judged: not judged.suits)
    return table(
        f"Stages by the {study.model} model",
        ("stage", "<suits", "<reason"),
        [(judged.name, "yes" if judged.suits else "no", judged.reason) for judged in ordered],
    )


def one_stage_table(judged: JudgedStage) -> Table:
    """Return every need of one stage, with its value and margin."""

    def cells(need: Need) -> tuple[str, ...]:
        known = need.value is not None
        return (
            need.what,
            need.axis,
            f"{'≥' if need.least else '≤'} {displayed(need.limit, need.unit)}",
            displayed(need.value, need.unit) if need.value is not None else "–",
            number(need.margin, 3) if known and need.margin is not None else "–",
            "yes" if need.met else "no",
        )

    return table(
        judged.name,
        ("<quantity", "<axis", "needed", "has", "margin", "<met"),
        [cells(need) for need in judged.needs],
    )


def settings_table(settings: MoveSettings) -> Table:
    """Return the settings of the drives, in their order, and what a head reads after each."""

    def cells(d: DriveSetting) -> tuple[str, ...]:
        return (
            d.drive,
            f"{1e6 * d.elongation:+.3f}",
            f"{d.voltage:+.4g} V" if d.turns is None else _turned(d.turns),
            _turned(-d.back) if d.back else "",
            f"{1e6 * d.eccentricity:.3f}",
            "" if settings.radius is None else _arcsec(d.eccentricity / settings.radius),
        )

    chances = ", ".join(
        f"{100.0 * p:.0f} % after {k}" for k, p in enumerate(settings.success, start=1)
    )
    notes = ()
    if settings.target is not None:
        notes = (f"below {displayed(settings.target, 'm')}: {chances} measured moves",)
    return table(
        f"Move of {settings.stage}, drive by drive",
        (
            "drive", "elongation, µm", "setting", "~first back", "eccentricity after, µm",
            "one head reads, arcsec",
        ),
        [cells(d) for d in settings.drives],
        notes=notes,
    )  # fmt: skip


def _turned(turns: float) -> str:
    """Return a rotation in full turns and degrees."""
    full = int(turns)
    degrees = f"{360.0 * (turns - full):+.1f} deg"
    return f"{full:+d} turn{'s' if abs(full) > 1 else ''} {degrees}" if full else degrees
