"""What a drawing says in words: the lines of its title block and its notes."""

import flexstage
from flexstage.hinges.profile import ARC_TOLERANCE, CurvedProfile
from flexstage.stage import Stage


def millimetres(value: float, digits: int = 6) -> str:
    """Write a length [m] in millimetres, without the unit and without zeros at its end.

    Examples
    --------
    >>> millimetres(0.35e-3), millimetres(-0.0)
    ('0.35', '0')
    """
    text = f"{value * 1e3:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def title_lines(stage: Stage) -> list[tuple[str, str]]:
    """Return what stands in the title block: label and text of each line."""
    return [
        ("Stage", stage.name),
        ("Title", stage.title or "-"),
        ("Material", stage.material.name),
        ("Thickness", f"{millimetres(stage.thickness)} mm"),
        ("Units", "mm"),
        ("Made by", f"flexstage {flexstage.__version__}"),
    ]


def notes(stage: Stage, *, kerf: float | None, start_hole: float, order: str) -> list[str]:
    """Return the notes of a drawing."""
    profiles = {h.profile.kind for h in stage.hinges if isinstance(h.profile, CurvedProfile)}
    lines = ["Contours are those of the finished part; mounting holes are drilled."]
    if profiles:
        lines.append(
            f"Notches ({', '.join(sorted(profiles))}): arcs within {ARC_TOLERANCE * 1e9:.0f} nm of "
            "the profile, with common tangents."
        )
    if kerf is None:
        lines.append("No wire path: the shop sets the offset.")
    else:
        lines += [
            f"WIRE_PATH is the centre of the wire, {millimetres(0.5 * kerf)} mm inside the waste, "
            f"for a cut {millimetres(kerf)} mm wide (wire and both spark gaps).",
            f"Re-entrant corners keep a fillet of {millimetres(0.5 * kerf)} mm.",
            f"Start holes: diameter {millimetres(start_hole)} mm, one for each closed cut.",
            f"Order of cutting: {order}.",
        ]
    return lines
