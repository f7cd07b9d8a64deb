"""Sections of the report on where its results end, and what they rest on."""

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexstage.report.study import Study


def validity_section(study: "Study") -> str:
    """Return where the stage and its models stop being valid; empty where nothing is said of it."""
    notes = dict.fromkeys(note for a in study.analyses.values() for note in a.validity)
    notes = tuple(dict.fromkeys((*study.stage.notes, *notes)))
    return f'<div class="columns">{_list(notes)}</div>' if notes else ""


def provenance_section(study: "Study") -> str:
    """Return what the results rest on: settings of each model, versions, hash of the stage."""
    entries: list[tuple[str, str]] = []
    for name, analysis in study.analyses.items():
        settings = ", ".join(f"{k}: {v}" for k, v in analysis.provenance.settings.items())
        entries.append((f"{name}, {analysis.system.order} coordinates", settings))
    for title, of in (
        ("flexstage", lambda origin: origin.version),
        ("description, SHA-256", lambda origin: origin.input_hash),
        ("computed", lambda origin: origin.created),
        ("with", lambda origin: f"Python {origin.python}, {origin.machine}"),
    ):
        values = dict.fromkeys(of(analysis.provenance) for analysis in study.analyses.values())
        entries.append((title, "; ".join(values)))
    material = study.stage.material
    entries.append(("material", f"{material.name}: {material.source}"))
    rows = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in entries)
    return f"<dl>{rows}</dl>"


def _list(notes: tuple[str, ...]) -> str:
    if len(notes) == 1:
        return f"<p>{escape(notes[0])}</p>"
    return f"<ul>{''.join(f'<li>{escape(note)}</li>' for note in notes)}</ul>"
