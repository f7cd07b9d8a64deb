"""The front panel: the functions of the library as pages in a browser."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.web.options import PanelOptions
    from flexstage.web.server import serve

__all__ = ["PanelOptions", "serve"]

import_on_use(__name__)
