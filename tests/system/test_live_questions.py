"""What pages ask of live charts, without a browser: who is answered, and with what."""

import gc
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.web.live_chart import PATH, SharedHistories
from flexstage.web.live_history import POSITION, VOLTAGE, LiveChannel, LiveHistory
from tests.panel import HERE, simulated

ASKED = {"mode": "time", "length": "0.2"}


def test_a_chart_has_its_units_and_its_data_on_the_page_alone(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/")
        require_units(user, panel)
        await require_answers(user, panel)

    simulated(tmp_path, look)


def require_units(user: Any, panel: Any) -> None:
    from nicegui.events import GenericEventArguments

    from flexstage.web.live_chart import LiveChart
    from flexstage.web.page import Page

    (session,) = panel.access._sessions.values()
    session.preferences = replace(session.preferences, length="nm")
    history = LiveHistory([LiveChannel("u", VOLTAGE), LiveChannel("x", POSITION)], 100.0)
    with user:
        chart = LiveChart(Page(panel, session), history, loop=("x", "u"))
        assert [c["unit"] for c in chart.props["channels"]] == ["V", "nm"]
        assert chart.props["channels"][1]["factor"] == 1e9
        assert chart.props["pair"] == [1, 0]
        assert LiveChart(Page(panel, session), history).props["pair"] == [0, 1]
        # a browser sees again what it chose, but not of other channels
        chart._keep(GenericEventArguments(sender=chart, client=chart.client, args={"hidden": [1]}))
        assert LiveChart(Page(panel, session), history).props["view"] == {"hidden": [1]}
        other = LiveHistory([LiveChannel("z", POSITION)], 100.0)
        assert LiveChart(Page(panel, session), other).props["view"] == {}
        with pytest.raises(ModelError, match="no channel 'y'; the channels are u, x"):
            LiveChart(Page(panel, session), history, loop=("x", "y"))


async def require_answers(user: Any, panel: Any) -> None:
    history = LiveHistory([LiveChannel("x", POSITION)], 100.0)
    panel.state(SharedHistories)[history.key] = history
    address = PATH + history.key
    history.append(np.arange(30) / 100.0, np.arange(30.0)[:, None])
    ask = user.http_client.get
    answer = await ask(address, params=ASKED)
    assert answer.headers["cache-control"] == "no-store"
    assert np.frombuffer(answer.content, "<f4", 21, 8 * (10 + 21)).tolist() == [*range(9, 30)]
    # a sentence of the library is one for the page; what no page asks is refused
    answer = await ask(address, params=ASKED | {"mode": "spectrum"})
    assert answer.headers["content-type"].startswith("text/plain")
    assert answer.text == "a spectrum needs 64 samples, got 21"
    known = {"generation": f"{history.generation}", "tier": "0", "after": "1e999"}
    for wrong in ({"mode": "radar"}, {"length": "long"}, {"length": "0"}, known):
        assert (await ask(address, params=ASKED | wrong)).status_code == 400
    assert (await ask("/live/none", params=ASKED)).status_code == 204
    assert (await user.http_client.post(address, params=ASKED)).status_code == 403
    # nobody without a session
    transport = user.http_client._transport
    async with httpx.AsyncClient(transport=transport, base_url=HERE) as stranger:
        assert (await stranger.get(address, params=ASKED)).status_code == 401
    # a history that nobody holds is gone
    del history
    gc.collect()
    assert (await ask(address, params=ASKED)).status_code == 204
