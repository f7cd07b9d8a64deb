"""Errors that flexstage raises on purpose.

Each class is also the built-in exception that a caller would expect, so ``except ValueError`` works
for a user who does not know this module. A message says what is wrong, which value it was, what is
allowed and how to correct it.
"""

#: Message where the library of finite elements is missing.
NO_FINITE_ELEMENTS = (
    "finite elements need the package ngsolve, which is not installed (there is no wheel of it "
    "for Linux or Windows on ARM): use the model of rigid bodies (lumped), or another computer"
)


class FlexstageError(Exception):
    """Base of every error that flexstage raises on purpose."""


class UnitError(FlexstageError, ValueError):
    """A text is not a quantity, or has the wrong unit."""


class StageError(FlexstageError, ValueError):
    """A stage description, or the file that holds it, is not a possible stage."""


class HingeError(FlexstageError, ValueError):
    """A hinge profile has impossible dimensions, or a method is not defined for it."""


class RecordError(FlexstageError, ValueError):
    """A record of data, or the file that holds it, cannot be used as it is."""


class ModelError(FlexstageError, ValueError):
    """A model cannot compute a requested result."""


class ConvergenceError(FlexstageError, RuntimeError):
    """An iteration ended before it reached its tolerance."""


class LimitError(FlexstageError, RuntimeError):
    """A commanded motion exceeds the limits of a stage; no axis has moved."""


class NotConnectedError(FlexstageError, ConnectionError):
    """There is no connection to an instrument, or it was lost."""


class ControllerError(FlexstageError, RuntimeError):
    """An instrument rejected a command, or returned an invalid answer.

    Parameters
    ----------
    message : str
        The message.
    code : int, optional
        Error number returned by the controller.
    """

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code


class PlanError(FlexstageError, ValueError):
    """An experiment plan, or the file that holds it, cannot be carried out as it is."""


class WorkerError(FlexstageError, RuntimeError):
    """Processes or a cluster that share the work cannot be used, or were lost."""
