"""Virtual measurements of a stage: made with scatter, read with noise, and labelled as such."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.virtual.as_built import AsBuilt

__all__ = ["AsBuilt"]

import_on_use(__name__)
