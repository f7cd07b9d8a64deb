"""Errors that flexstage raises on purpose.

Each class is also the built-in that a caller would expect, so ``except ValueError`` works for a
user who does not know this module. The message is one sentence: what is wrong, what was got, what
is allowed, how to mend it.
"""

#: What is said where finite elements are asked for and their library is not there.
NO_FINITE_ELEMENTS = (
    "finite elements need the package ngsolve, which is not installed (there is no wheel of it "
    "for Linux or Windows on ARM): take the model of rigid bodies (lumped), or another computer"
)


class FlexstageError(Exception):
    """Base of every error that flexstage raises on purpose."""


class UnitError(FlexstageError, ValueError):
    """A text that should be a quantity is not one, or has the wrong unit."""


class StageError(FlexstageError, ValueError):
    """A stage description, or the file that holds it, is not a possible stage."""


class HingeError(FlexstageError, ValueError):
    """A hinge profile has impossible dimensions, or a method is not defined for it."""


class RecordError(FlexstageError, ValueError):
    """A record of data, or the file that holds it, cannot be used as it is."""


class ModelError(FlexstageError, ValueError):
    """A model is asked for something that it cannot give."""


class ConvergenceError(FlexstageError, RuntimeError):
    """An iteration ended before it reached its tolerance."""


class LimitError(FlexstageError, RuntimeError):
    """A motion is asked for that leaves the limits of a stage; nothing has been moved."""


class NotConnectedError(FlexstageError, ConnectionError):
    """There is no link to an instrument, or it was lost."""


class ControllerError(FlexstageError, RuntimeError):
    """An instrument refused a command, or answered what it should not.

    Parameters
    ----------
    message : str
        The sentence.
    code : int, optional
        The number of the error that the controller gave.
    """

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code


class PlanError(FlexstageError, ValueError):
    """An experiment plan, or the file that holds it, cannot be carried out as it is."""


class WorkerError(FlexstageError, RuntimeError):
    """Processes or a cluster that share the work cannot be used, or were lost."""
