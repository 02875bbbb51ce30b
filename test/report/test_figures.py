"""The pictures: every line has a name, a unit and a look of its own; no key hides a line; titles fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from msls_ros.flights.scenarios import shipped
from msls_ros.report import flight_figures, page_figures
from msls_ros.report.chart import Line, Marks, Panel
from msls_ros.report.charts import Drawn
from msls_ros.report.style import derivative_unit

TIME = np.arange(0.0, 10.0, 0.02)
WAVE = np.sin(7.0 * TIME)
EFFECTORS = ("de", "da", "dr")


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the figures that are written, laid out."""
    found: list[Figure] = []

    def keep(figure: Figure, path: Path) -> None:
        figure.draw_without_rendering()
        found.append(figure)

    for module in (page_figures, flight_figures):
        monkeypatch.setattr(module, "write_png", keep)
    return found


def keys_of(figure: Figure) -> list[Legend]:
    return [*figure.legends, *(key for axes in figure.axes if (key := axes.get_legend()) is not None)]


def assert_nothing_is_hidden(figure: Figure) -> None:
    for key in keys_of(figure):
        box = key.get_window_extent()
        assert figure.bbox.x0 - 1.0 <= box.x0 and box.x1 <= figure.bbox.x1 + 1.0
        for axes in figure.axes:
            if axes.axison:
                inside = axes.get_window_extent().padded(-1.0)
                assert not inside.overlaps(box), [text.get_text() for text in key.get_texts()]


def test_a_chart_of_the_report_has_a_key_beside_its_lines_and_names_its_marks(
    written: list[Figure], tmp_path: Path
) -> None:
    lines = [Line(name, TIME, WAVE) for name in ("left outer elevon", "left inner elevon", "right elevon", "rudder")]
    trust = [Line("measured", TIME, WAVE, 7), Line("predicted", TIME, 0.9 * WAVE, 0)]
    panels = [Panel("deflections [deg]", lines), Panel("dP/dt [rad/s²]", trust)]
    marks = Marks((0.0, 10.0), [4.02], [4.0])
    page_figures.save_figures([Drawn("flight", "Flight", "", panels)], marks, tmp_path)
    (figure,) = written
    assert_nothing_is_hidden(figure)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["alarm", "true change"]
    heads = [key.get_title().get_text() for key in keys_of(figure)[1:]]
    assert heads == ["deflections [deg]", "dP/dt [rad/s²]"]
    looks = [
        (to_hex(line.get_color()), line.get_linestyle())
        for line in figure.axes[1].lines
        if line.get_label() in ("measured", "predicted")
    ]
    assert len(set(looks)) == 2 and looks[0][0] != looks[1][0]


@pytest.mark.parametrize("faults", [[(4.0, 4.0)], []])
def test_the_pictures_of_the_demo_hide_nothing_and_name_each_unit(
    faults: list[tuple[float, float]], written: list[Figure], tmp_path: Path
) -> None:
    alarms = [4.02] if faults else []
    columns = np.tile(0.1 * WAVE[:, None], (1, 9))
    flown = flight_figures.Flown("an aircraft that is described at length, " * 4, faults, alarms)
    small = 0.01 * np.ones(len(TIME))
    flight_figures.plot_dither(tmp_path, TIME, columns[:, :3], EFFECTORS, small, 1.2 * small, 0.1 * columns, flown)
    flight_figures.plot_states(tmp_path, TIME, columns, WAVE, WAVE, columns[:, :2], EFFECTORS[:2], flown)
    for figure in written:
        assert_nothing_is_hidden(figure)
        for axes in figure.axes:
            if axes.axison:
                assert "[" in axes.get_title(loc="left"), axes.get_title(loc="left")
    names = [[text.get_text() for key in keys_of(figure) for text in key.get_texts()] for figure in written]
    assert names[0][:3] == ["limit of acceleration", "predicted acceleration", "realised acceleration, the last 1 s"]
    assert names[0][3:] == names[1] == (["fault", "alarm"] if faults else [])


def test_the_title_of_every_shipped_scenario_fits_into_its_picture() -> None:
    for scenario in shipped().values():
        title = f"b43 = dPdot/d ddt, estimated and true\n{scenario.description}; sensor noise typical, seed 1000"
        figure, _ = flight_figures.new_figure(2, title)
        figure.draw_without_rendering()
        assert figure._suptitle is not None  # type: ignore[attr-defined]
        box = figure._suptitle.get_window_extent()  # type: ignore[attr-defined]
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1, title


@pytest.mark.parametrize(
    ("row", "column", "unit"),
    [
        ("P", "ddt", "1/s²"), ("P", "Q", "1/s"), ("P", "u", "1/(m s)"), ("u", "w", "1/s"), ("u", "Q", "m/s"),
        ("u", "Theta", "m/s²"), ("w", "ddt", "m/s²"), ("Theta", "Q", "1"), ("P", "flow", ""), ("load", "ddt", ""),
    ],
)  # fmt: skip
def test_a_number_of_a_or_b_has_the_unit_of_its_row_over_that_of_its_column(row: str, column: str, unit: str) -> None:
    assert derivative_unit(row, column, ("ddt",)) == unit
