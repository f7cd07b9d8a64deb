"""Start: what a person has come to do, and what was open in a browser that is gone."""

from functools import partial

from nicegui import ui

from flexstage.web.bench.state import BenchForms
from flexstage.web.design.state import DesignState
from flexstage.web.page import (
    Page,
    PanelHeading,
    div,
    pages_of,
    panel,
    quiet_button,
    remark,
    show_error,
)
from flexstage.web.sessions import Session
from flexstage.web.views import START, VIEWS

_WAYS = {
    "Design a stage": ("design", "analyse", "explore", "report"),
    "Measure one": ("hysteresis", "centring"),
    "Drive one": ("bench",),
}


def build(page: Page) -> None:
    """Make the view."""
    views = {view.module: view for view in VIEWS}
    PanelHeading(START.purpose)
    with div("purposes"):
        for name, modules in _WAYS.items():
            with panel():
                PanelHeading(name)
                for module in modules:
                    with ui.link(target=views[module].path).classes("way"):
                        ui.icon(views[module].icon).props("aria-hidden=true")
                        ui.label(views[module].name)
                        remark(views[module].purpose)
    on_its_way = 5.0  # a browser that was seen so short a while ago is about to be back [s]
    left = [
        (session, ago)
        for session, ago in page.panel.access.sessions()
        if ago > on_its_way and session.opened(DesignState) and not pages_of(session)
    ]
    if left:
        with panel():
            PanelHeading("Go on with what was open in a browser that is gone")
            for session, ago in left:
                with ui.row().classes("items-center"):
                    ui.label(_told(session, ago))
                    quiet_button("Open it again", on_click=partial(_go_on, page, session))


def _told(session: Session, ago: float) -> str:
    """Say whose it was, what was open, and when."""
    design, forms = session.opened(DesignState), session.opened(BenchForms)
    who = forms.operator.strip() if forms is not None else ""
    changed = len(design.now.values) if design is not None else 0
    what = design.now.name if design is not None else ""
    what += f", {changed} parameters changed" if changed > 1 else ", changed" if changed else ""
    return f"{who or f'browser {session.id[:4]}'}: {what}; last seen {_ago(ago)} ago"


def _ago(seconds: float) -> str:
    return f"{seconds / 3600.0:.0f} h" if seconds > 5400.0 else f"{1.0 + seconds // 60.0:.0f} min"


def _go_on(page: Page, left: Session) -> None:
    if pages_of(left):
        show_error("another browser has opened that meanwhile")
        return
    page.panel.access.take_over(page.session, left)
    # the page itself is of the session that this browser had
    ui.run_javascript("location.href = '/design'")
