"""Form fields for the fields of a request, with its names, units, ranges and help."""

import math
from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.base.errors import FlexstageError
from flexstage.files.ranges import Range
from flexstage.files.request import Request, RequestField, request_fields
from flexstage.files.schema import field_texts
from flexstage.quantities.units import parse
from flexstage.web.page import Page, display_text


class RequestForm:
    """Builder of the form fields of a request.

    Parameters
    ----------
    page
        The page, which shows errors of a value.
    request
        Returns the present request.
    assign
        Assigns a new value to a field, by its name.
    errors
        Errors of the fields whose text in the form is invalid.
    """

    def __init__(
        self,
        page: Page,
        request: Callable[[], Request],
        assign: Callable[[str, Any], object],
        errors: dict[str, FlexstageError] | None = None,
    ) -> None:
        self._page, self._request, self._assign_value = page, request, assign
        self.errors = {} if errors is None else errors

    def choice(self, name: str, options: Any = None) -> ui.select:
        """Show a field with one or several of a list of options."""
        spec, value = self._field(name)
        options = list(spec.words) if options is None else options
        is_multiple = spec.holds_tuple
        field = ui.select(
            options,
            # an empty option may represent no value
            value=list(value) if is_multiple else "" if value is None and "" in options else value,
            label=spec.label,
            multiple=is_multiple,
        )
        field.on_value_change(
            lambda e: self._assign(name, lambda: tuple(e.value) if is_multiple else e.value or None)
        )
        return field.props("outlined dense options-dense").tooltip(self._help(name))

    def tick(self, name: str, words: str = "") -> ui.checkbox:
        """Show a field that is true or false."""
        spec, value = self._field(name)
        label = f"{spec.label}: {words}" if words else spec.label
        box = ui.checkbox(label, value=value).props("dense")
        box.on_value_change(lambda e: self._assign(name, lambda: bool(e.value)))
        return box.tooltip(self._help(name))

    def text(self, name: str, placeholder: str = "") -> ui.input:
        """Show a field as text in the syntax of the command line."""
        spec, value = self._field(name)
        content = "" if value == spec.default else ",".join(spec.texts(value))
        field = ui.input(spec.label, value=content, placeholder=placeholder)

        def read(raw: str) -> Any:
            return spec.read(raw) if raw.strip() else spec.default

        field.on_value_change(lambda e: self._assign(name, lambda: read(e.value or "")))
        return field.props("outlined dense debounce=800").tooltip(self._help(name))

    def number(self, name: str, placeholder: str = "") -> ui.number:
        """Show a field that is a number; an empty field has the default."""
        spec, value = self._field(name)
        unit, factor = self._unit(spec)
        is_integer, bounds = spec.value is int, spec.range or Range()
        low, high = (
            end * factor if math.isfinite(end) else None for end in (bounds.low, bounds.high)
        )
        field = ui.number(
            f"{spec.label} [{unit}]" if unit else spec.label,
            value=value if value is None or is_integer else float(f"{value * factor:.9g}"),
            placeholder=placeholder,
            min=low,
            max=high,
        ).props("outlined dense stack-label debounce=600")

        def read(number: float | None) -> Any:
            if number is None:
                return spec.default
            return int(number) if is_integer else number / factor

        field.on_value_change(lambda e: self._assign(name, lambda: read(e.value)))
        return field.tooltip(self._help(name))

    def _field(self, name: str) -> tuple[RequestField, Any]:
        request = self._request()
        return request_fields(type(request))[name], getattr(request, name)

    def _help(self, name: str) -> str:
        """Return the help of a field, as its command prints it."""
        return display_text(field_texts(type(self._request()))[name])

    def _assign(self, name: str, value: Callable[[], Any]) -> None:
        self.errors.pop(name, None)
        with self._page.show_errors():
            try:
                self._assign_value(name, value())
            except FlexstageError as error:
                self.errors[name] = error
                raise

    def _unit(self, field: RequestField) -> tuple[str, float]:
        """Return the displayed unit of a field, and its factor from SI."""
        if field.is_share:
            return "%", 100.0
        if field.dimension is None:
            return "", 1.0
        if field.dimension.name == "length" and not field.written.bare:
            return self._page.preferences.length_unit()
        unit = field.written.bare or field.dimension.units[0]
        return unit, 1.0 / parse(f"1 {unit}", field.dimension.name)
