"""Fields of a page that hold those of a request: their names, units, ranges and help are its."""

import math
from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.base.errors import FlexstageError
from flexstage.files.ranges import Range
from flexstage.files.request import Request, RequestField, request_fields
from flexstage.files.schema import field_texts
from flexstage.quantities.units import parse
from flexstage.web.page import Page, in_page_words


class RequestForm:
    """What makes the fields of a request.

    Parameters
    ----------
    page
        The page, which says what is wrong with a value.
    request
        Returns the request as it is.
    take
        Takes another value of a field, by its name.
    wrong
        Holds why fields do not have the value that stands in the form.
    """

    def __init__(
        self,
        page: Page,
        request: Callable[[], Request],
        take: Callable[[str, Any], object],
        wrong: dict[str, FlexstageError] | None = None,
    ) -> None:
        self._page, self._request, self._take = page, request, take
        self.wrong = {} if wrong is None else wrong

    def choice(self, name: str, options: Any = None) -> ui.select:
        """Show a field that is one of some words, or several of them."""
        asked, value = self._asked(name)
        options = list(asked.words) if options is None else options
        many = asked.holds_tuple
        field = ui.select(
            options,
            # a word of its own may stand for nothing
            value=list(value) if many else "" if value is None and "" in options else value,
            label=asked.label,
            multiple=many,
        )
        field.on_value_change(
            lambda e: self._taken(name, lambda: tuple(e.value) if many else e.value or None)
        )
        return field.props("outlined dense options-dense").tooltip(self._told(name))

    def tick(self, name: str, words: str = "") -> ui.checkbox:
        """Show a field that is so or is not."""
        asked, value = self._asked(name)
        label = f"{asked.label}: {words}" if words else asked.label
        box = ui.checkbox(label, value=value).props("dense")
        box.on_value_change(lambda e: self._taken(name, lambda: bool(e.value)))
        return box.tooltip(self._told(name))

    def text(self, name: str, placeholder: str = "") -> ui.input:
        """Show a field as it is written on a command line."""
        asked, value = self._asked(name)
        shown = "" if value == asked.default else ",".join(asked.texts(value))
        field = ui.input(asked.label, value=shown, placeholder=placeholder)

        def read(text: str) -> Any:
            return asked.read(text) if text.strip() else asked.default

        field.on_value_change(lambda e: self._taken(name, lambda: read(e.value or "")))
        return field.props("outlined dense debounce=800").tooltip(self._told(name))

    def number(self, name: str, placeholder: str = "") -> ui.number:
        """Show a field that is a number; one that is emptied is as usual."""
        asked, value = self._asked(name)
        unit, factor = self._unit(asked)
        whole, bounds = asked.value is int, asked.range or Range()
        low, high = (
            end * factor if math.isfinite(end) else None for end in (bounds.low, bounds.high)
        )
        field = ui.number(
            f"{asked.label} [{unit}]" if unit else asked.label,
            value=value if value is None or whole else float(f"{value * factor:.9g}"),
            placeholder=placeholder,
            min=low,
            max=high,
        ).props("outlined dense stack-label debounce=600")

        def read(number: float | None) -> Any:
            if number is None:
                return asked.default
            return int(number) if whole else number / factor

        field.on_value_change(lambda e: self._taken(name, lambda: read(e.value)))
        return field.tooltip(self._told(name))

    def _asked(self, name: str) -> tuple[RequestField, Any]:
        request = self._request()
        return request_fields(type(request))[name], getattr(request, name)

    def _told(self, name: str) -> str:
        """Return what a field is, as the help of its command says it."""
        return in_page_words(field_texts(type(self._request()))[name])

    def _taken(self, name: str, value: Callable[[], Any]) -> None:
        self.wrong.pop(name, None)
        with self._page.sentences():
            try:
                self._take(name, value())
            except FlexstageError as error:
                self.wrong[name] = error
                raise

    def _unit(self, field: RequestField) -> tuple[str, float]:
        """Return the unit that numbers are shown in, and how many of it are one in SI units."""
        if field.is_share:
            return "%", 100.0
        if field.dimension is None:
            return "", 1.0
        if field.dimension.name == "length" and not field.written.bare:
            return self._page.preferences.length_unit()
        unit = field.written.bare or field.dimension.units[0]
        return unit, 1.0 / parse(f"1 {unit}", field.dimension.name)
