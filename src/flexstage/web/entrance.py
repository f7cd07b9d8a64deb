"""The pages before the front panel: on the way in, the password, and a refusal."""

from html import escape

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>{head}
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 16px/1.5 sans-serif; max-width: 34rem; margin: 15vh auto; padding: 0 1rem; }}
input, button {{ font: inherit; padding: .4rem .7rem; }}
form {{ display: flex; gap: .6rem; align-items: end; flex-wrap: wrap; }}
label {{ display: grid; gap: .2rem; }}
</style></head><body><main><h1>flexstage</h1>{body}</main></body></html>
"""


def page_of_entrance() -> str:
    """Return the page that goes on to the panel."""
    return _PAGE.format(
        title="flexstage",
        head='<meta http-equiv="refresh" content="0; url=/">',
        body='<p><a href="/">To the front panel</a></p>',
    )


def page_of_password(action: str, said: str = "") -> str:
    """Return the page that asks for the password, with what was wrong before."""
    alert = f'<p role="alert">{escape(said.capitalize())}.</p>' if said else ""
    return _PAGE.format(
        title="flexstage: password",
        head="",
        body=f'{alert}<form method="post" action="{action}"><label>Password'
        '<input type="password" name="password" autocomplete="current-password" required autofocus>'
        "</label><button>Open the front panel</button></form>",
    )


def page_of_refusal(reason: str, enter: str | None = None) -> str:
    """Return the page that says why a request was refused, and how to come in."""
    way = (
        f'<p><a href="{enter}">Enter the password</a>.</p>'
        if enter
        else "<p>Open the newest address that <code>flexstage serve</code> printed; each opens the "
        "panel once, in one browser.</p>"
    )
    return _PAGE.format(
        title="flexstage: refused", head="", body=f"<p>Refused: {escape(reason)}.</p>{way}"
    )
