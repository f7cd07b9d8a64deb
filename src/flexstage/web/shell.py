"""The frame of every view: navigation, units, theme, and STOP while a stage is connected."""

import asyncio
import gc
import time
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from nicegui import Client, app, background_tasks, ui

from flexstage.report.figures.style import css_variables
from flexstage.web.access_control import SESSION
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, Panel, PanelHeading, choice, pages_of, quiet_button, show_job
from flexstage.web.sessions import ANGLES, AUTOMATIC, LENGTHS, THEMES
from flexstage.web.views import START, VIEWS, PanelView


def build_page(panel: Panel) -> None:
    """Build the page of a browser: the frame, and the view of its address."""
    page = Page(panel, ui.context.client.request.scope[SESSION])
    ui.colors(
        primary="#0b5c94", link="#0b5c94", negative="#b3261e", positive="#00704f", warning="#8a5a00"
    )
    ui.dark_mode(page.preferences.dark)
    ui.add_css(
        f":root {{ {css_variables()} }} body.body--dark {{ {css_variables(dark=True)} }}"
        f" .on-paper {{ {css_variables()} background: var(--paper); }}"
    )
    ui.page_title("flexstage")
    main = ui.element("main").classes("view")
    with main:
        routes = {view.path: partial(_show, page, view) for view in VIEWS}
        views = ui.sub_pages({"/": partial(_show, page, START), **routes})
    with ui.header().classes("bar"):
        ui.link("flexstage", "/").classes("product")
        _navigation()
        with ui.row().classes("tools items-center no-wrap"):
            _stop(page)
            _jobs(page)
            _settings(page, views)
    ui.skip_link("To the content", target=main)
    _exempt_modules_from_collection()


@cache
def _exempt_modules_from_collection() -> None:
    """Exempt what the first page imported from garbage collection.

    A full collection that visits all modules would delay answers by a quarter of a second.
    """
    gc.collect()
    gc.freeze()


def _show(page: Page, view: PanelView) -> None:
    page.leave()
    ui.page_title(f"{view.name} · flexstage")
    PanelHeading(view.name, 1).classes("hidden-title")
    view.build(page)


def _navigation() -> None:
    links: dict[str, ui.link] = {}
    with ui.element("nav").props('aria-label="Views"').classes("views"):
        for view in VIEWS:
            with ui.link(target=view.path) as link:
                ui.icon(view.icon).props("aria-hidden=true")
                ui.label(view.name)
                ui.tooltip(view.purpose)
            links[view.path] = link

    def mark(path: str) -> None:
        current = path.partition("?")[0]
        for target, link in links.items():
            link.props(add="aria-current=page") if current == target else link.props(
                remove="aria-current"
            )

    router = ui.context.client.sub_pages_router
    router.on_path_changed(mark)
    mark(router.current_path)


def _stop(page: Page) -> None:
    """Add the STOP button and the Escape key; both stop every connected stage."""
    emergency_stop = page.panel.emergency_stop

    def stop() -> None:
        if emergency_stop.active:
            emergency_stop.stop()
            ui.notify("Stopped", type="warning", position="top")

    button = ui.button("STOP", icon="dangerous", on_click=stop).classes("stop")
    button.props('color=negative unelevated aria-keyshortcuts="Escape"')
    button.bind_visibility_from(emergency_stop, "active")
    with button:
        ui.tooltip("Stop every connected stage (Esc)")

    def on_key(event: Any) -> None:
        if event.action.keydown and event.key == "Escape":
            stop()

    ui.keyboard(on_key=on_key, ignore=[])


def _jobs(page: Page) -> None:
    """Add the jobs of this browser to the bar, with progress, also after a reload."""
    delay = 2.0  # [s]

    def running() -> list[BackgroundJob]:
        now = time.time()
        jobs = page.panel.jobs.of(page.session.id)
        return [job for job in jobs if not job.is_over and now - job.began > delay]

    with quiet_button(icon="hourglass_top").props("text-color=white") as button:
        badge = ui.badge().props("floating color=warning")
        with ui.menu().props('role=dialog aria-label="Work in progress"') as menu:
            column = ui.column().classes("settings jobs")
    button.props["aria-label"] = "Work in progress"

    def show() -> None:
        column.clear()
        with column:
            for job in running():
                show_job(page, job)

    def update() -> None:
        if page.client.has_socket_connection:
            page.panel.access.keep_alive(page.session)
        count = len(running())
        badge.text = str(count)
        button.visible = count > 0
        if not count:
            menu.close()

    menu.on("before-show", show)
    ui.timer(0.5, update)


def _settings(page: Page, views: Any) -> None:
    preferences = page.preferences
    dark = ui.dark_mode(preferences.dark)

    def choose(name: str, event: Any) -> None:
        page.session.preferences = replace(page.session.preferences, **{name: event.value})
        dark.value = page.preferences.dark
        if name != "theme":
            views.refresh()

    fields = (
        ("length", "Lengths", (AUTOMATIC, *LENGTHS)),
        ("angle", "Angles", (AUTOMATIC, *ANGLES)),
        ("theme", "Theme", THEMES),
    )
    with (
        ui.button(icon="tune").props('flat color=white aria-label="Units and theme"'),
        ui.menu().props('role=dialog aria-label="Units and theme"'),
        ui.column().classes("settings"),
    ):
        for name, label, values in fields:
            choice(list(values), getattr(preferences, name), label, partial(choose, name))
        quiet_button("Log out", icon="logout", on_click=partial(_log_out, page))


def _log_out(page: Page) -> None:
    """End the session: its pages are redirected to the login page and then deleted."""
    page.panel.access.end(page.session)

    async def end(clients: list[Client]) -> None:
        for client in clients:
            client.run_javascript("location.href = '/'")
        await asyncio.sleep(1.0)
        for client in clients:
            if not client.is_deleted:
                client.delete()

    background_tasks.create(end(pages_of(page.session)))


# Plotly resizes a chart once more after it was removed, and rejects the promise
_LEFT_CHARTS = """<script>
addEventListener("unhandledrejection", (event) => {
  if (/displayed plot div/.test(String(event.reason))) event.preventDefault();
});
</script>"""


def add_style() -> None:
    """Add the style of the panel to every page."""
    # the loading bar of Quasar has no accessible name
    app.config.quasar_config["loadingBar"]["skipHijack"] = True
    app.add_static_files("/static", Path(__file__).with_name("static"))
    ui.add_head_html(f'<link rel="stylesheet" href="/static/panel.css">{_LEFT_CHARTS}', shared=True)
