"""What holds of the study's claims, in sentences made of the figures of a comparison."""

import math
from collections.abc import Sequence

from flexstage.studies.traditional import SPAN, Reduction, TraditionalComparison


def claim_verdict(found: TraditionalComparison) -> str:
    """Say against which traditional stages the claim holds, by motion across."""
    return (
        f"The claim, {100.0 * found.claim:.0f} % less than a traditional stage, "
        f"{_against(found.reductions())}."
    )


def verdict(found: TraditionalComparison) -> tuple[str, ...]:
    """Say in sentences what of the claims holds, by the figures of a comparison."""
    own = found.own
    across = own.median("across")
    printed = "" if found.measured is None else f" ({1e6 * found.measured:.2f} µm were measured)"
    implied = found.implied
    worse = max(own.axes.values(), key=lambda axis: axis.figures("across")[0])
    legs = " and ".join(sorted({f"{1e3 * v:.0f}" for v in found.legs.values()}))
    sentences = [
        f"The worse axis of {own.title} goes {_um(across)} µm across over its stroke"
        f"{printed}, median of {found.samples} stages as made.",
        f"Of that rigid bodies go {_um(worse.geometry)} µm, elastic ones {_um(abs(worse.bending))} "
        f"µm more; what manufacture adds has a deviation of {_um(worse.manufacture)} µm.",
        claim_verdict(found),
        f"By yaw it {_against(found.reductions('yaw'))}.",
        f"Against a single parallelogram it holds where legs are at most "
        f"{1e3 * found.longest_leg:.1f} mm from neck to neck, by their arc alone; those of the "
        f"stage have {legs} mm.",
    ]
    if found.knows_straightness:
        sentences.insert(3, f"By straightness it {_against(found.reductions('straightness'))}.")
    if implied is not None:
        sentences.append(
            f"With what was measured of the stage, the claim is of a traditional stage that goes "
            f"{1e6 * implied:.2f} µm across."
        )
    return tuple(sentences)


def drift_verdict(found: TraditionalComparison) -> tuple[str, ...]:
    """Say in sentences what symmetry does for the drift with temperature."""
    own, lame = found.own, found.asymmetric
    words = []
    for load, name in (
        ("temperature", "a uniform kelvin"),
        ("temperature gradient x", f"a kelvin over {1e3 * SPAN:.0f} mm in x"),
        ("temperature gradient y", f"a kelvin over {1e3 * SPAN:.0f} mm in y"),
    ):
        one, other = (math.hypot(*s.drift[load][:2]) for s in (own, lame))
        words.append(f"{1e9 * one:.0f} nm instead of {1e9 * other:.0f} nm by {name}")
    less = [math.hypot(*s.drift["temperature"][:2]) for s in (own, *found.others)]
    better = [s.title for s, v in zip(found.others, less[1:], strict=True) if v < less[0]]
    worse = [s.title for s, v in zip(found.others, less[1:], strict=True) if v >= less[0]]
    ranks = [f"less than {_listed(worse)}"] * bool(worse) + [f"more than {_listed(better)}"] * bool(
        better
    )
    helps = 1.0 - less[0] / math.hypot(*lame.drift["temperature"][:2])
    change = (
        f"takes {100.0 * helps:.0f} % off" if helps >= 0.0 else f"adds {-100.0 * helps:.0f} % to"
    )
    return (
        f"With guide legs on both sides the platform drifts {_listed(words)}: symmetry "
        f"{change} what a uniform change does, and does not remove it, since the drives and levers "
        "of either axis stand on one side of it.",
        f"By a uniform kelvin it drifts {' and '.join(ranks)}.",
    )


def _against(rows: Sequence[Reduction]) -> str:
    """Say against which stages a claim holds, and against which it does not."""
    parts = []
    for holds, words in ((True, "holds against"), (False, "does not hold against")):
        named = [f"{r.against} ({_by(r.reduction)})" for r in rows if r.holds == holds]
        if named:
            parts.append(f"{words} {_listed(named)}")
    return ", and ".join(parts)


def _um(value: float) -> str:
    """Write a length in micrometres."""
    return f"{1e6 * value:.3f}"


def _by(reduction: float) -> str:
    """Say how a figure lies to that of another stage."""
    if reduction >= 0.0:
        return f"{100.0 * reduction:.0f} % below it"
    times = 1.0 - reduction
    return f"{times:.1f} times as much" if times < 9.95 else f"{times:.0f} times as much"


def _listed(words: Sequence[str]) -> str:
    """Join words as a sentence does."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
