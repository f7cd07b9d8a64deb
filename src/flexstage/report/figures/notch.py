"""The contour of a notch."""

from typing import TYPE_CHECKING

from flexstage.hinges import Profile
from flexstage.report.figures.shapes import notch_contour
from flexstage.report.figures.style import BODY, INK, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MM = 1e3


def draw_notch(profile: Profile) -> "Figure":
    """Draw the contour of a notch to scale, in millimetres, with the neck in the middle."""
    half = 0.5 * profile.neck_thickness
    right = [(x * _MM, depth * _MM) for x, depth in notch_contour(profile)]
    edge = [(-x, depth) for x, depth in reversed(right)] + right
    x = [place for place, _ in edge]
    upper = [half * _MM + depth for _, depth in edge]
    lower = [-half * _MM - (0.0 if profile.one_sided else depth) for _, depth in edge]
    figure = new_figure(4.5, 3.2)
    axes = figure.subplots()
    dress(axes)
    axes.fill_between(x, lower, upper, facecolor=BODY, edgecolor=INK, linewidth=1.0)
    axes.set(xlabel="along the hinge [mm]", ylabel="across [mm]", aspect="equal")
    entitle(axes, f"{profile.kind} notch, neck {profile.neck_thickness * _MM:g} mm")
    return figure
