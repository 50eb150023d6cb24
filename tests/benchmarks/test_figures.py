"""The page of figures is what the data give, and data that cannot be a section are refused."""

import json
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from tests.benchmarks.figures import PAGE, TOPICS, USUAL, Picture, Table, Topic, recorded_flights, rendered, topics
from tests.benchmarks.flight_table import KEPT, read

TOPIC = Topic(
    "Speed", "2026-11-22", USUAL, ["gcs-mosaic benchmark DIR"], tables=[Table(["scale", "s"], [["1", "1.30"]])]
)


def test_the_page_is_what_the_data_give() -> None:
    """If not: put new figures into the files and run `python -m tests.benchmarks.figures`; the page itself is not edited."""
    assert PAGE.read_text(encoding="utf-8") == rendered(topics())


@pytest.mark.long
def test_every_topic_tells_day_and_machine_and_has_a_command() -> None:
    for topic in topics():
        assert date.fromisoformat(topic.written) <= date.today(), topic.title
        assert topic.machine, topic.title
        assert "`" in rendered([topic]).partition("## Further benchmarks")[0].partition(topic.written)[2], topic.title


def test_a_section_has_all_that_its_topic_tells() -> None:
    page = rendered(
        [replace(TOPIC, says="What it costs.", notes=["Less at night."], pictures=[Picture("a.png", "A", "draw")])]
    )
    section = page.partition("## Speed\n\n")[2].partition("\n\n## ")[0]
    assert section.split("\n\n") == [
        "2026-11-22: `gcs-mosaic benchmark DIR`",
        "What it costs.",
        "| scale | s |\n|---|---|\n| 1 | 1.30 |",
        "Less at night.",
        "![A](../../.readme/a.png)",
        "A: `draw`",
    ]


def test_another_machine_and_an_earlier_state_are_told() -> None:
    page = rendered([replace(TOPIC, machine="a Raspberry Pi 5", state="before the adjustment")])
    assert "2026-11-22, a Raspberry Pi 5 (before the adjustment): `gcs-mosaic" in page


def test_a_command_is_never_broken() -> None:
    command = "python -m tests.benchmarks.flights --scale " + ",".join("0.25" for _ in range(20))
    page = rendered([replace(TOPIC, says=f"{'Words before it. ' * 7}`{command}` and after it.")])
    assert f"`{command}`" in page


@pytest.mark.parametrize("rows", [[], [["1"]], [["1", "1.30", "s"]]])
def test_a_table_without_rows_or_with_other_cells_is_refused(rows: list[list[str]]) -> None:
    with pytest.raises(ValueError, match="2 cells"):
        rendered([replace(TOPIC, tables=[Table(["scale", "s"], rows)])])


@pytest.mark.parametrize("change", [{"mesured": "2026-11-22"}, {"written": None}])
def test_a_key_too_many_or_too_few_is_refused(tmp_path: Path, change: dict[str, str | None]) -> None:
    entry = json.loads(next(TOPICS.glob("*.json")).read_text(encoding="utf-8")) | change
    (tmp_path / "one.json").write_text(json.dumps({key: value for key, value in entry.items() if value}))
    with pytest.raises(TypeError):
        topics(tmp_path)


def test_recorded_flights_are_those_that_the_benchmark_keeps() -> None:
    kept = read(KEPT)["copr at 0.25"]
    row = next(row for row in recorded_flights() if row[0] == "copr")
    assert row[1] == f"{kept.placed} of {kept.frames}"
    assert float(row[5]) == pytest.approx(kept.ortho_px, abs=0.005)
