"""How long a command may be."""

from flexstage.errors import PlanError

_MOST_SAMPLES = 5_000_000


def require_size(size: float, kind: str) -> None:
    """Refuse a command that would not fit into memory, before it is made."""
    if size > _MOST_SAMPLES:
        raise PlanError(
            f"the command '{kind}' would have {size:.0f} samples, and at most {_MOST_SAMPLES} are "
            "allowed: make it shorter, or lower command_rate"
        )
