"""Start: links to the views by purpose, and sessions of closed browsers."""

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

_PURPOSES = {
    "Design a stage": ("design", "analyse", "explore", "report"),
    "Evaluate measurements": ("hysteresis", "centring"),
    "Operate a stage": ("bench",),
}


def build(page: Page) -> None:
    """Build the view."""
    views = {view.module: view for view in VIEWS}
    PanelHeading(START.purpose)
    with div("purposes"):
        for name, modules in _PURPOSES.items():
            with panel():
                PanelHeading(name)
                for module in modules:
                    with ui.link(target=views[module].path).classes("purpose"):
                        ui.icon(views[module].icon).props("aria-hidden=true")
                        ui.label(views[module].name)
                        remark(views[module].purpose)
    reconnect_time = 5.0  # a browser that left so recently may be reloading [s]
    abandoned = [
        (session, ago)
        for session, ago in page.panel.access.sessions()
        if ago > reconnect_time and session.existing_state(DesignState) and not pages_of(session)
    ]
    if abandoned:
        with panel():
            PanelHeading("Continue the work of a closed browser")
            for session, ago in abandoned:
                with ui.row().classes("items-center"):
                    ui.label(_session_text(session, ago))
                    quiet_button("Reopen", on_click=partial(_take_over, page, session))


def _session_text(session: Session, ago: float) -> str:
    """Return user, open stage and age of a session."""
    design, forms = session.existing_state(DesignState), session.existing_state(BenchForms)
    user = forms.operator.strip() if forms is not None else ""
    changed = len(design.now.values) if design is not None else 0
    text = design.now.name if design is not None else ""
    text += f", {changed} parameters changed" if changed > 1 else ", changed" if changed else ""
    return f"{user or f'browser {session.id[:4]}'}: {text}; last seen {_ago(ago)} ago"


def _ago(seconds: float) -> str:
    return f"{seconds / 3600.0:.0f} h" if seconds > 5400.0 else f"{1.0 + seconds // 60.0:.0f} min"


def _take_over(page: Page, abandoned: Session) -> None:
    if pages_of(abandoned):
        show_error("another browser has opened this session meanwhile")
        return
    page.panel.access.take_over(page.session, abandoned)
    # this page belongs to the former session of the browser
    ui.run_javascript("location.href = '/design'")
