"""The page in a real Chromium: its answer to "Is anything wrong?" in each situation."""

import dataclasses
import json

import pytest

from tests.twin_server.serve.situations import SITUATIONS, WELL
from twin_server.pipeline.analysis.evidence import EvidenceDesk
from twin_server.serve.routes.page import MESSAGES

pytestmark = [pytest.mark.browser, pytest.mark.long]

TWINS = {f"lab.s{number}": name for number, name in enumerate(SITUATIONS)}
MOODS = {"act": "bad", "watch": "waiting", "cannot_say": "waiting", "no": "good"}
READ = """async () => {
  const { showConclusion } = await import('/assets/conclusion.js');
  const { twins } = await (await fetch('/api/v1/twins')).json();
  return Object.fromEntries(twins.map((state) => {
    const banner = document.body.appendChild(document.createElement('div'));
    showConclusion(banner, state, null, []);
    const one = (selector) => banner.querySelector(selector)?.textContent ?? null;
    const findings = [...banner.querySelectorAll('li')].map((item) => item.textContent);
    const said = { said: one('strong'), next: one('em'), findings };
    banner.remove();
    return [state.id, { ...banner.dataset, hidden: banner.hidden, ...said }];
  }));
}"""


@pytest.fixture(scope="module")
def house(serving):
    """A server with a twin in each situation: all else of it, up to the page, is as ever."""

    def evidence(desk, twin_id, reasons, suspects=()):
        return dataclasses.replace(WELL, **SITUATIONS[TWINS[twin_id]][0])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EvidenceDesk, "evidence", evidence)
        server = serving()
        for twin_id in TWINS:
            body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
            assert server.client.put(f"/api/v1/twins/{twin_id}", json=body).status_code == 201
        yield server


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_banner_answers_in_each_situation(house, visit, language):
    assert len({json.dumps(told, default=repr) for told in SITUATIONS.values()}) >= 30
    messages = json.loads((MESSAGES / f"{language}.json").read_text(encoding="utf-8"))
    page = visit(house, f"?lang={language}#")
    # The fleet shows a card of each, with the same answer as the banner of the twin.
    page.locator(".card[data-answer]").nth(len(TWINS) - 1).wait_for()
    cards = (
        "all => Object.fromEntries(all.map(({ dataset }) => [dataset.twin, dataset.answer]))"
    )
    answers = page.locator(".card").evaluate_all(cards)
    banners = page.evaluate(READ)
    for twin_id, name in TWINS.items():
        _, answer, kinds = SITUATIONS[name]
        told = banners[twin_id]
        assert answers[twin_id] == answer, name
        assert (told["answer"], told["state"]) == (answer, MOODS[answer]), name
        assert messages[f"conclusion.{answer}"] in told["said"], name
        assert not told["hidden"], name
        # Each kind of finding once, the most urgent first, and what to do about that.
        each = [messages[f"finding.{kind}"] for kind in dict.fromkeys(kinds)]
        assert len(told["findings"]) == len(each), name
        for found, words in zip(told["findings"], each, strict=True):
            assert found.casefold().startswith(words.casefold()), name
        act = messages[f"next.{kinds[0]}"] if kinds else None
        assert (told["next"] or "").endswith(act or ""), name
        assert (told["next"] is None) == (act is None), name
    assert page.complaints == []
