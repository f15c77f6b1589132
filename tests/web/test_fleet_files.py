"""docs/fleet: the dashboard and the alerts use figures that `/metrics` has, and no others."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from bridge.web.metrics import metrics

DOCS = Path(__file__).parents[2] / "docs" / "fleet"
DASHBOARD = json.loads((DOCS / "grafana.json").read_text())
ALERTS: list[dict[str, Any]] = [
    rule
    for group in yaml.safe_load((DOCS / "alerts.yaml").read_text())["groups"]
    for rule in group["rules"]
]
EXPORTED = {
    name + ("_total" if kind == "counter" else "")
    for name, kind in re.findall(r"^# TYPE (\S+) (\S+)$", metrics({}), re.MULTILINE)
}
QUERIES = {
    **{
        panel["title"]: target["expr"]
        for panel in DASHBOARD["panels"]
        for target in panel["targets"]
    },
    **{rule["alert"]: rule["expr"] for rule in ALERTS},
}


@pytest.mark.parametrize("title", QUERIES)
def test_a_query_uses_figures_that_there_are(title: str) -> None:
    """A figure that is renamed takes its queries along."""
    used = set(re.findall(r"wisco2mqtt_\w+", QUERIES[title]))
    assert used or "up{" in QUERIES[title]
    assert used <= EXPORTED


def test_each_figure_is_on_the_dashboard() -> None:
    """Nothing is exported that is shown nowhere."""
    shown = {name for query in QUERIES.values() for name in re.findall(r"wisco2mqtt_\w+", query)}
    assert shown == EXPORTED


def test_panels_have_places_and_numbers_of_their_own() -> None:
    """Grafana would lay one over the other."""
    panels = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    places = {(panel["gridPos"]["x"], panel["gridPos"]["y"]) for panel in panels}
    assert len(places) == len(panels)


def test_each_alert_waits_and_says_where() -> None:
    """No alert for a moment's fault; each one names the cabinet."""
    for rule in ALERTS:
        assert re.fullmatch(r"\d+m", rule["for"])
        assert "{{ $labels.cabinet }}" in rule["annotations"]["summary"]


def test_the_rules_and_targets_agree_on_names() -> None:
    """The job and the labels that queries ask for are those of the scrape configuration."""
    (job,) = yaml.safe_load((DOCS / "prometheus.yaml").read_text())["scrape_configs"]
    assert job["job_name"] == "wisco2mqtt"
    assert all(set(one["labels"]) == {"site", "cabinet"} for one in job["static_configs"])
