"""The cache: arrays and results on disk, by the content that they were computed from."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.files.cache.cache import Cache, open_cache
    from flexstage.files.cache.memory import Memory

__all__ = ["Cache", "Memory", "open_cache"]

import_on_use(__name__)
